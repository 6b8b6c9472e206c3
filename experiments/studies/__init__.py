"""Studies of this project. `impact-gym study NAME` runs the object `STUDY` of the module or package NAME."""

import importlib

from experiments.lab.study import Study

NAMES = ("paper", "speed", "stability", "gain", "teleop", "bench")


def load(name: str) -> Study:
    """Return the study of this name."""
    study: Study = importlib.import_module(f"experiments.studies.{name}").STUDY
    return study
