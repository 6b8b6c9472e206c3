"""`impact-gym study stability`: robustness of the solver on 10,000 random scenes, the storm."""

from collections.abc import Iterator

from experiments.lab.parts import Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Row, Study
from experiments.studies.solvers import approaches
from experiments.studies.solvers.contenders import JUDGES
from experiments.studies.stability import promises
from experiments.studies.stability.storm import storm_row, truth_row

SCENES, QUICK_SCENES = 10_000, 200
HANG = 120.0  # s, time limit of one scene
EVERY, FIRST = 50, 17  # the independent solver also solves scenes 17, 67, 117, ...
PATIENCE = 60.0  # s, limit of the processor time of each method of the independent solver
SHOWN = 200  # largest number of failures on the page


def unknown_row(labels: Row) -> Row:
    """Return the row of a scene whose run did not finish."""
    return approaches.storm(labels["scene"]).about


def cells_of_truth(quick: bool, frames: Frames) -> Iterator[Cell]:
    """Yield a cell for each scene that the independent solver also solves."""
    for number in range(FIRST, frames["storm"].height, EVERY):
        yield Cell({"scene": number}, {"number": number, "patience": 10.0 if quick else PATIENCE})


def analyse(frames: Frames, quick: bool) -> Findings:
    """Return the page: which of `promises.PROMISES` are kept, and which runs break a promise."""
    storm, judging = frames["storm"], frames["truth"]
    judged, unknown = promises.agreement(storm, judging), judging.filter(~promises.FINISHED)
    broken, apart = promises.failures(storm), judged.filter("apart")
    verdicts = [(each.text, each.finding(storm), each.broken(storm).is_empty()) for each in promises.PROMISES]
    verdicts.append(promises.over_agreement(judged, unknown.height))
    missed, failing = sum(not met for *_, met in verdicts), broken["scene"].n_unique()
    of = f"{storm.height:,} random scenes"
    answer = f"All {len(verdicts)} promises are kept on {of}."
    if missed:
        answer = f"{missed} of {len(verdicts)} promises are missed on {of}; scenes that break at least one: {failing}."
    rows = [[text, finding, "met" if met else "missed"] for text, finding, met in verdicts]
    columns = {"scene": "{scene}", "coupling": "{coupling}"}
    differing = {"V_p, relative difference": "{velocity_error}", "contacts": "{contacts}, not {true_contacts}"}
    differing |= {"snap-throughs": "{passes}, not {true_passes}", "failure": "{failure}"}
    return Findings(answer, [
        Section("What was promised", [Table("", ("promise", "found", ""), rows)]),
        Section(f"Every failure: {broken.height}", [
            Table.of(f"The first {SHOWN} at most; all: failures.csv", broken.head(SHOWN),
                     columns | {"promise": "{promise}", "number": "{reason}"})
            if broken.height else "None.",
        ], folded=broken.height > 20),
        Section("Differences from the independent solver", [
            Table.of("", apart, columns | differing) if apart.height else "None.",
            Table.of("Scenes in which the independent solver failed", unknown, columns | {"why": "{failure}"}),
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
    question="Is the solver stable on random scenes?",
    measurements=(
        Measurement(
            "storm",
            lambda quick, _: [Cell({"scene": k}, {"number": k}) for k in range(QUICK_SCENES if quick else SCENES)],
            storm_row, (*SOLVER, *JUDGES), unknown_row, HANG,
        ),
        Measurement("truth", cells_of_truth, truth_row, JUDGES, unknown_row, 3 * PATIENCE),
    ),
    analyse=analyse,
)  # fmt: skip
