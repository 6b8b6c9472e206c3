"""Studies of this project. `impact-gym study NAME` runs `STUDY` of the module `experiments.studies.NAME`."""

import importlib

from experiments.lab.study import Study

NAMES = ("paper", "speed", "stability", "gain", "teleop", "bench", "stock")


def load(name: str) -> Study:
    """Return the study `name`, one of NAMES."""
    study: Study = importlib.import_module(f"experiments.studies.{name}").STUDY
    return study
