"""`impact-gym study stability`: robustness of the solver on 10,000 random scenes, the storm."""

from experiments.lab.parts import Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Study
from experiments.studies import QUESTIONS
from experiments.studies.solvers import approaches
from experiments.studies.solvers.contenders import JUDGES
from experiments.studies.stability import promises
from experiments.studies.stability.storm import storm_row, truth_row

SCENES = 10_000  # number of random scenes
HANG = 120.0  # s, time limit of one scene, of each solver
EVERY, FIRST = 50, 17  # the independent solver also solves scenes 17, 67, 117, ...


def analyse(frames: Frames, quick: bool) -> Findings:
    """Return which of `promises.PROMISES` are kept, and tables of the scenes that break a promise."""
    rows, truth = frames["storm"], frames["truth"]
    judged, broken = promises.agreement(rows, truth), promises.failures(rows)
    found = [*(each.finding(rows) for each in promises.PROMISES), promises.over_agreement(judged)]
    missed, failing = sum(row["kept"] != "yes" for row in found), broken["scene"].n_unique()
    of = f"{rows.height:,} random scenes"
    answer = f"All {len(found)} promises are kept on {of}."
    if missed:
        answer = f"{missed} of {len(found)} promises are missed on {of}; scenes that break at least one: {failing}."
    caption = "Scenes that break a promise; median and largest value of the promised number"
    return Findings(answer, [
        Section("What was promised", [
            Table.of(caption, found, {name: f"{{{name}}}" for name in found[0]}, "stability-promises"),
            "failures.csv lists the scenes that break a promise, agreement.csv the scenes that the independent solver "
            "also solved (apart: the solvers differ), truth.csv its results. It failed in "
            f"{truth.filter(~promises.FINISHED).height} of {truth.height} scenes.",
        ]),
        Section("How it is checked", [
            "Scenes: every coupling with every robot, every published law of dissipation, several exponents. Scene k "
            "depends on the number k alone: experiments.studies.solvers.approaches.storm(k), with the ranges.",
            "Time (ms): processor time of one simulate without trace; the shorter of two if the first took over 20 ms. "
            "Errors of momentum and energy, pull: see the docstrings of experiments/studies/stability/storm.py.",
        ]),
    ], {"failures": broken, "agreement": judged})  # fmt: skip


STUDY = Study(
    name="stability",
    question=QUESTIONS["stability"],
    measurements=(
        Measurement(
            "storm",
            lambda quick, _: [Cell({"scene": k}, {"number": k}) for k in range(SCENES // 50 if quick else SCENES)],
            storm_row, (*SOLVER, *JUDGES), lambda labels: approaches.storm(labels["scene"]).about, HANG,
        ),
        Measurement(
            "truth", lambda _, of: [Cell({"scene": k}, {"number": k}) for k in range(FIRST, of["storm"].height, EVERY)],
            truth_row, JUDGES, lambda labels: approaches.storm(labels["scene"]).about, HANG,
        ),
    ),
    analyse=analyse,
)  # fmt: skip
