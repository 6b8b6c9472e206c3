"""Studies of this project itself: the paper's statements, speed, stability, what the gain is made of, operators, rates.

Each is a module or package with a `STUDY`; `impact-gym study NAME` runs it.
"""

import importlib

from experiments.lab.study import Study

NAMES = ("paper", "speed", "stability", "gain", "teleop", "bench")


def load(name: str) -> Study:
    """Return the study of this name."""
    study: Study = importlib.import_module(f"experiments.studies.{name}").STUDY
    return study
