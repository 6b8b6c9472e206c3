"""`impact-gym study speed`: work-precision diagrams, after the manner of SciMLBenchmarks (Rackauckas and others)."""

from collections.abc import Iterator, Sequence
from math import ceil
from textwrap import wrap
from typing import Any

import polars as pl
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.lab.charts import SERIES
from experiments.lab.page import factor
from experiments.lab.parts import Picture, Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Row, Study
from experiments.studies.solvers.approaches import named
from experiments.studies.solvers.contenders import CAREFUL, JUDGES, METHODS, OURS, TOO_WRONG, timed
from experiments.studies.solvers.solutions import ERRORS, SECOND_RTOL, TRUE_RTOL, Solution, power, true_row

FINE = 1e-6  # m/s in V_p, at which contenders are compared
RTOLS = tuple(float(f"1e-{k}") for k in range(3, 13))
OF_SCIPY = tuple(f"{CAREFUL} {method}" for method in METHODS)
EDGES = (1e-16, 1e1)  # of errors that are drawn; what is outside is drawn at the edge
STYLES: dict[str, dict[str, Any]] = {
    name: {"color": colour, "marker": mark, "linestyle": line, "linewidth": width, "markersize": 4}
    for name, colour, mark, line, width in zip(
        (OURS, *OF_SCIPY), SERIES, "os^Dv", ("-", *4 * ("--",)), (2.4, *4 * (1.2,)), strict=False
    )
}
WRONG: dict[str, Any] = {"marker": "o", "linestyle": "", "color": "#555555", "markerfacecolor": "white"}


def cells_of_truth(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield the named approaches."""
    for approach in named():
        yield Cell({"scene": approach.name}, {"approach": approach.name})


def cells_of_times(quick: bool, frames: Frames) -> Iterator[Cell]:
    """Yield the named approaches, each with its truth and what is tried there."""
    ours, theirs, rounds = ((1e-3, 1e-6, 1e-9), (1e-6,), 1) if quick else (RTOLS, RTOLS, 3)
    settings = [(OURS, rtol) for rtol in ours] + [(name, rtol) for name in OF_SCIPY for rtol in theirs]
    for row in frames["truth"].iter_rows(named=True):
        truth = Solution.of_row(row).numbers
        tried = {"settings": [list(setting) for setting in settings], "rounds": rounds}
        yield Cell({"scene": row["scene"]}, {"approach": row["scene"], "truth": truth, **tried})


def cheapest(rows: pl.DataFrame, names: Sequence[str], error: float) -> Row | None:
    """Return the row with the least time that keeps `error` (m/s in V_p), at it and at every finer setting there is.

    An error that is small at one setting by the chance of its sign does not count.
    """
    keeps = (pl.col("velocity_error") <= error).fill_null(value=False).cast(pl.Int8).cum_min().over("contender") == 1
    kept = rows.filter(pl.col("contender").is_in(names)).sort("setting").filter(keeps).sort("microseconds")
    return kept.row(0, named=True) if kept.height else None


def compared(scene: str, description: str, rows: pl.DataFrame) -> tuple[float | None, list[str]]:
    """Return how many times longer SciPy takes at FINE, None if one does not get there, and a row of the table."""
    ours, theirs = cheapest(rows, [OURS], FINE), cheapest(rows, OF_SCIPY, FINE)
    words = f"{scene}: {description}"
    if ours is None or theirs is None:
        return None, [words, "-" if ours is None else f"{ours['microseconds']:.0f} µs", "not reached", ""]
    ratio = theirs["microseconds"] / ours["microseconds"]
    by = f"{theirs['contender']}, rtol {power(theirs['setting'])}"
    return ratio, [words, f"{ours['microseconds']:.0f} µs", factor(ratio), by]


def analyse(frames: Frames, quick: bool) -> Findings:
    """Compare contenders at FINE, and draw each error against time."""
    truths, times = frames["truth"], frames["times"]
    doubt, load = truths["velocity_error_doubt"].to_numpy().max(), times["load"].to_numpy()
    lines = [
        compared(scene, description, times.filter(scene=scene))
        for scene, description in truths.select("scene", "description").iter_rows()
    ]
    ratios, names = [ratio for ratio, _ in lines if ratio is not None], [*ERRORS]
    answer = f"No comparison with SciPy at {power(FINE)} m/s: one of the two does not get there."
    if ratios:
        answer = (
            f"At the same error in the velocity V_p that the object keeps, {power(FINE)} m/s, one whole approach is "
            f"{factor(min(ratios))} to {factor(max(ratios))} times faster with impact_gym than with the fastest of "
            "SciPy's solvers on the contacts alone."
        )
    head = ("approach", "impact_gym", "SciPy takes times as long", "by")
    table = Table(f"Time at an error in V_p of {power(FINE)} m/s", head, [line for _, line in lines])
    differ = (pl.col("second_contacts") != pl.col("contacts")) | (pl.col("second_passes") != pl.col("passes"))
    return Findings(answer, [
        Section("Who is cheapest at an error", [
            table,
            "Each contender at its cheapest setting that keeps the error there and at every finer setting tried, so "
            "that no lucky sign counts. The contenders of an approach are timed in turns, in one run.",
        ]),
        Section("Error of the object's velocity against time", [drawn(names[0], times, truths)]),
        Section("The other errors", [drawn(name, times, truths) for name in names[1:]], folded=True),
        Section("What is compared, and how fair it is", [
            f"Truth: the slow independent solver (experiments/reference) with DOP853 at rtol {power(TRUE_RTOL)}. Radau "
            f"at {power(SECOND_RTOL)} differs by at most {doubt:.1e} m/s in V_p; the "
            f"number of contacts or snap-throughs differs in {truths.filter(differ).height} approaches.",
            "impact_gym: the whole call of simulate, flights and records included, on one core.",
            "SciPy: RK45, DOP853, LSODA, Radau with events through the same slow solver. Only the time inside contacts "
            "counts; its flights are exact and free of charge, which favours SciPy. Equations are Python functions, as "
            "SciPy asks; the search for events, more careful than that of solve_ivp, is included.",
            "Time: processor time of the one thread that each uses, so that other work on the machine does not count; "
            "the best of several rounds in which all contenders take turns; calls over 0.2 s once. Load while they "
            f"were timed: {load.min():.2f} to {load.max():.2f}.",
        ]),
    ])  # fmt: skip


def drawn(column: str, times: pl.DataFrame, truths: pl.DataFrame) -> Picture:
    """Draw one error against time, a panel for each approach; grey below what the truth itself is known to."""
    lines, columns = ceil(truths.height / 3), min(truths.height, 3)
    figure = Figure(figsize=(3.6 * columns, 3.7 * lines))
    panels: Any = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)
    handles = [Line2D([], [], label=name, **style) for name, style in STYLES.items()]
    handles.append(Line2D([], [], label="failure: wrong contacts, snap-throughs, alarm, V_p", **WRONG))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=9)
    error = pl.col(column).fill_nan(None).fill_null(EDGES[1]).clip(*EDGES)  # no answer is as wrong as can be
    shown = times.filter(pl.col("microseconds").is_finite()).sort("setting", descending=True).with_columns(error)
    for axes, truth in zip(panels.flat, truths.iter_rows(named=True), strict=False):
        for name in reversed(STYLES):  # ours on top
            curve = shown.filter(scene=truth["scene"], contender=name)
            wrong = curve.filter(pl.col("failure") != "")
            axes.plot(curve["microseconds"], curve[column], **STYLES[name])
            axes.plot(wrong["microseconds"], wrong[column], **STYLES[name] | {"linestyle": ""}, mfc="white")
        axes.axhspan(EDGES[0], max(truth[f"{column}_doubt"], EDGES[0]), color="#bbbbbb", alpha=0.4, linewidth=0)
        axes.set(xscale="log", yscale="log", ylim=(EDGES[0] / 3, EDGES[1] * 3))
        axes.set(xlabel="time per approach (µs)", ylabel=ERRORS[column])
        axes.label_outer()
        axes.set_title("\n".join(wrap(f"{truth['scene']}: {truth['description']}", 44)), fontsize=9)
    what = f"{ERRORS[column]} against time per approach, a panel for each approach, a curve for each contender"
    caption = (
        "Down and left is better. Open marks: the number of contacts or of snap-throughs is wrong, the alarm is missed "
        f"or V_p is wrong by more than {TOO_WRONG:g} m/s. Grey: below what two methods of the slow solver agree to. "
        "Errors outside the axes are drawn at their edge."
    )
    return Picture(column, figure, what, caption)


STUDY = Study(
    name="speed",
    question="How fast is the solver at a given error?",
    measurements=(
        Measurement("truth", cells_of_truth, true_row, depends=JUDGES),
        Measurement("times", cells_of_times, timed, depends=(*SOLVER, *JUDGES), processes=0),
    ),
    analyse=analyse,
)
