"""Studies of this project itself. `impact-gym study NAME` runs one of NAMES.

Each study is a module or package with an object `STUDY`.
"""

import importlib

from experiments.lab.study import Study

NAMES = ("paper", "speed", "stability", "gain", "teleop", "bench")


def load(name: str) -> Study:
    """Return the study of this name."""
    study: Study = importlib.import_module(f"experiments.studies.{name}").STUDY
    return study
