"""`impact-gym study speed`: time of an approach at an error and by robot; step rates; shorter trainings.

Times at an error are compared as in the work-precision diagrams of SciMLBenchmarks (Rackauckas et al.).
"""

from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Study
from experiments.studies import QUESTIONS
from experiments.studies.solvers import comparison
from experiments.studies.speed import precision, rates, trainings

LONGEST = 3600.0  # s, time limit of a cell, on a machine with much other work; alone, a cell takes a minute


def analyse(frames: Frames, quick: bool) -> Findings:
    """Return the sections of the tables that were measured."""
    found = [precision.about_times(frames["times"])] if "times" in frames else []
    found += [rates.about(name, frames[name]) for name in rates.TABLES if name in frames]
    found += [trainings.about(frames["trainings"])] if "trainings" in frames else []
    return Findings(" ".join(answer for answer, _ in found), [each for _, sections in found for each in sections])


STUDY = Study(
    name="speed",
    question=QUESTIONS["speed"],
    measurements=(
        Measurement(
            "times", precision.cells, comparison.timed, (*SOLVER, *comparison.JUDGES), seconds=LONGEST, processes=1,
            failed=lambda _: {"solver": comparison.SWEEP},
        ),
        # processes=0, because other processes are limited to one thread
        Measurement("cost", lambda quick, _: [Cell({}, {"quick": quick})], rates.cost,
                    ("impact_gym", "agents.setups", "experiments.lab.scenes"), processes=0),
        Measurement("environments", lambda quick, _: [Cell({}, {"quick": quick})], rates.stepped,
                    ("impact_gym", "agents"), processes=0),
        Measurement(
            "rates", lambda quick, _: [Cell({"set-up": name}, {"name": name, "quick": quick}) for name in rates.SETUPS],
            rates.three_rates, ("impact_gym", "agents"), processes=0,
        ),
        Measurement("trainings", trainings.cells, trainings.trained, ("impact_gym", "agents"), seconds=LONGEST,
                    processes=1),
    ),
    analyse=analyse,
    packages=("gymnasium", "torch", "stable-baselines3"),
)  # fmt: skip
