"""`impact-gym study stability`: robustness on 10,000 random scenes.

    `storm`     a row for each scene, with what physics says about the run
    `promises`  what was promised of the storm, and whether it is met; agreement with the independent solver

A scene on which a solver hangs or crashes is a row like any other.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.lab.charts import SERIES
from experiments.lab.parts import Picture, Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Row, Study
from experiments.studies.solvers import approaches
from experiments.studies.solvers.contenders import JUDGES
from experiments.studies.solvers.solutions import power
from experiments.studies.stability import promises
from experiments.studies.stability.storm import storm_row, truth_row

SCENES, QUICK_SCENES = 10_000, 200
HANG = 120.0  # s, without an answer of ours
EVERY, FIRST = 50, 17  # one scene in so many is judged by the independent solver: 2 %; the scenes are random themselves
PATIENCE = 60.0  # s of processor time for each method of the truth
SHOWN = 200  # failures on the page
COUPLINGS = {"rigid": SERIES[1], "spring": SERIES[4], "bistable": SERIES[3]}


def cells_of_storm(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield the scenes of the storm."""
    for number in range(QUICK_SCENES if quick else SCENES):
        yield Cell({"scene": number}, {"number": number})


def blank(labels: Row) -> Row:
    """Return the row of a scene of which no number is known."""
    return approaches.storm(labels["scene"]).about


def sampled(scenes: int) -> range:
    """Return the numbers of the random sample of so many scenes."""
    return range(FIRST, scenes, EVERY)


def cells_of_truth(quick: bool, frames: Frames) -> Iterator[Cell]:
    """Yield the random sample."""
    for number in sampled(frames["storm"].height):
        yield Cell({"scene": number}, {"number": number, "patience": 10.0 if quick else PATIENCE})


def analyse(frames: Frames, quick: bool) -> Findings:
    """Hold the storm against what was promised."""
    storm, judging = frames["storm"], frames["truth"]
    judged, unknown = promises.agreement(storm, judging), judging.filter(~promises.FINISHED)
    broken, apart = promises.failures(storm), judged.filter(pl.col("apart") != "")
    verdicts = [*promises.over_storm(storm), promises.over_agreement(judged, unknown.height)]
    missed, failing = sum(not verdict.met for verdict in verdicts), broken["scene"].n_unique()
    of = f"{storm.height:,} random scenes"
    answer = f"All {len(verdicts)} promises are kept on {of}."
    if missed:
        answer = f"{missed} of {len(verdicts)} promises are missed on {of}; scenes that break at least one: {failing}."
    rows = [[text, finding, "met" if met else "missed"] for text, finding, met in verdicts]
    described = {"what it is": "{description}"}
    failures = {"scene": "{scene}", "promise": "{promise}", "reason": "{reason}", **described}
    differences = {"scene": "{scene}", "difference": "{apart}", **described}
    reasons = {"scene": "{scene}", "why": "{failure}", **described}
    return Findings(answer, [
        Section("What was promised", [Table("", ("promise", "found", ""), rows), shares_above(storm, judged)]),
        Section(f"Every failure: {broken.height}", [
            Table.of(f"The first {SHOWN} at most; all: failures.csv", broken.head(SHOWN), failures)
            if broken.height else "None.",
        ], folded=broken.height > 20),
        Section("Not as the independent solver has it", [
            Table.of("", apart, differences) if apart.height else "None.",
            Table.of("What the independent solver could not do", unknown, reasons),
        ]),
        Section("How it is checked", checks()),
    ], {"failures": broken, "agreement": judged})  # fmt: skip


def checks() -> list[str]:
    """Return how scenes are drawn and runs are checked."""
    ranges, others = (
        ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in drawn.items())
        for drawn in (approaches.RANGES, approaches.OTHERS)
    )
    return [
        "Scenes: every coupling with every robot, every published law of dissipation, "
        f"{len({*approaches.EXPONENTS})} pairs of exponents. Scene k follows from the number k alone: "
        "experiments.studies.solvers.approaches.storm(k).",
        f"Ranges: {ranges}; 5 % of these draws are an end of the range. Besides: {others} (SI units, logarithmic, but "
        "what begins at 0). A fifth never brakes.",
        "Time: processor time of one simulate without trace, the better of two where the first took over 20 ms.",
        "Momentum: the residual of the paper's eq. 20 that the run reports, and the impulse against what the object "
        "gained; over the impulse of that contact.",
        "Energy: what the contact force took from tool and object, from approach and separation velocity and the work, "
        f"along the trace, of all else that acts on it. May be negative by {power(promises.ENERGY)} of the energy that "
        "went to and fro, and by the doubt of the quadrature.",
        "No pull: contact force of the trace never below 0, V_p never lower after a contact than before it; from point "
        "to point of a trace to 1e-8 of the tool's speed, which is rtol.",
        "A hundredth of rtol: every scene that was traced is run once more at 1e-10. Where sliders hop through their "
        "alignment again and again, errors grow exponentially.",
    ]


def share_above(axes: Axes, values: pl.Series, floor: float, bar: float, name: str, **style: Any) -> None:
    """Draw which share of the scenes is above a value; what is below `floor` is drawn there."""
    numbers = values.drop_nulls().to_numpy().astype(np.float64)
    ordered = np.sort(np.maximum(numbers[np.isfinite(numbers)], floor))
    size = len(ordered)
    if not size:
        return
    # every one of the worst, and no more of the rest than can be told apart
    places = np.unique(size - np.unique(np.geomspace(1, size, 400).astype(int)))
    axes.plot(ordered[places], 100 * (1 - places / size), drawstyle="steps-pre", **style)
    axes.axvline(bar, color="black", linewidth=0.9, linestyle=(0, (4, 2)))
    axes.set(xscale="log", yscale="log", xlabel=name)


def shares_above(storm: pl.DataFrame, judged: pl.DataFrame) -> Picture:
    """Draw which share of the scenes is above a time, number of steps, momentum error, error of V_p."""
    figure = Figure(figsize=(10.8, 6.6))
    panels: Any = figure.subplots(2, 2, sharey=True)
    for coupling, colour in COUPLINGS.items():
        of, sample = (rows.filter(pl.col("coupling").str.starts_with(coupling)) for rows in (storm, judged))
        momentum = of.select(momentum=promises.BUDGET)["momentum"]
        for axes, values, floor, bar, name in (
            (panels[0, 0], of["milliseconds"], 1e-2, promises.SLOWEST, "time of a run (ms)"),
            (panels[0, 1], of["steps"], 1, 1e6, "steps of a run"),
            (panels[1, 0], momentum, 1e-16, promises.MOMENTUM, "momentum error over impulse"),
            (panels[1, 1], sample["velocity_error"], 1e-16, promises.AGREEMENT, "error of V_p, relative"),
        ):
            share_above(axes, values, floor, bar, name, color=colour, label=coupling)
    for axes in panels[:, 0]:
        axes.set_ylabel("scenes above (%)")
    panels[0, 0].legend(title="coupling")
    what = (
        "Share of scenes above a time, a number of steps, a momentum error and an error of V_p, a curve per coupling."
    )
    caption = (
        "How many scenes are above a value, by coupling, with and without a robot. Dashed: the bar; for steps, where a "
        "run gives up. The error of V_p is against the independent solver, over the random 2 %."
    )
    return Picture("storm", figure, what, caption)


STUDY = Study(
    name="stability",
    question="Does the solver stand random scenes?",
    measurements=(
        Measurement("storm", cells_of_storm, storm_row, (*SOLVER, *JUDGES), blank, HANG),
        Measurement("truth", cells_of_truth, truth_row, JUDGES, blank, 3 * PATIENCE),
    ),
    analyse=analyse,
)
