"""`impact-gym study speed`: work-precision diagrams, after the manner of SciMLBenchmarks (Rackauckas and others)."""

from collections.abc import Iterator, Sequence
from math import ceil
from textwrap import wrap
from typing import Any

import polars as pl
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.lab.charts import OTHERS, SERIES
from experiments.lab.page import factor
from experiments.lab.parts import Picture, Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Row, Study
from experiments.studies.solvers.approaches import named
from experiments.studies.solvers.contenders import CAREFUL, JUDGES, METHODS, OURS, TIMES, TOO_WRONG, timed
from experiments.studies.solvers.growth import GROWTH, grown
from experiments.studies.solvers.peers import PEERS
from experiments.studies.solvers.solutions import ERRORS, SECOND_RTOL, TRUE_RTOL, Solution, power, true_row

COMPARED = (1e-4, 1e-6, 1e-8, 1e-10)  # m/s in V_p, at which contenders are compared
FINE = 1e-6  # m/s, of those, that the answer names
RTOLS = tuple(float(f"1e-{k}") for k in range(3, 14))
RIVALS = {CAREFUL: tuple(f"{CAREFUL} {method}" for method in METHODS)} | {name: (name,) for name in PEERS}
"""Rivals, each with its contenders; an approach is timed with one rival at a time, and ours in turns with it."""
LONGEST = 400.0  # s, for a rival on one approach, with what it compiles
EDGES = (1e-16, 1e1)  # of errors that are drawn; what is outside is drawn at the edge
STYLES: dict[str, dict[str, Any]] = {
    name: {"color": colour, "marker": mark, "linestyle": line, "linewidth": width, "markersize": 4}
    for name, colour, mark, line, width in zip(
        (OURS, *RIVALS), (SERIES[0], OTHERS, *SERIES[1:]), "os^Dv*", ("-", *5 * ("--",)), (2.4, *5 * (1.2,)),
        strict=False,
    )
}  # fmt: skip
WRONG: dict[str, Any] = {"marker": "o", "linestyle": "", "color": "#555555", "markerfacecolor": "white"}
AXES = dict(zip(TIMES, ("processor time per approach (µs)", "processor time of all contacts (µs)"), strict=True))


def cells_of_truth(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield the named approaches."""
    for approach in named():
        yield Cell({"scene": approach.name}, {"approach": approach.name})


def cells_of_times(quick: bool, frames: Frames) -> Iterator[Cell]:
    """Yield the named approaches with each rival, the truth and what is tried there."""
    rtols, rounds = ((1e-3, 1e-6, 1e-9), 1) if quick else (RTOLS, 3)
    for row in frames["truth"].iter_rows(named=True):
        truth = Solution.of_row(row).numbers
        for rival, contenders in RIVALS.items():
            settings = [[name, rtol] for rtol in rtols for name in (OURS, *contenders) if name != OURS or rtol > 1e-13]
            tried = {"approach": row["scene"], "truth": truth, "settings": settings, "rounds": rounds}
            yield Cell({"scene": row["scene"], "rival": rival}, tried)


def no_times(labels: Row) -> Row:
    """Return the row of a rival that crashed or took too long."""
    return {"contender": RIVALS[labels["rival"]][0], "setting": FINE}


def cells_of_growth(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield what our time may grow with."""
    for name, (_axis, values) in GROWTH.items():
        yield Cell({"quantity": name}, {"quantity": name, "values": values[:: 3 if quick else 1]})


def cheapest(rows: pl.DataFrame, names: Sequence[str], error: float, by: str = TIMES[0]) -> Row | None:
    """Return the row with the least time that keeps `error` (m/s in V_p), at it and at every finer setting there is.

    An error that is small at one setting by the chance of its sign does not count. `by` is one of TIMES.
    """
    keeps = (pl.col("velocity_error") <= error).fill_null(value=False).cast(pl.Int8).cum_min().over("contender") == 1
    kept = rows.filter(pl.col("contender").is_in(names)).sort("setting").filter(keeps & pl.col(by).is_finite()).sort(by)
    return kept.row(0, named=True) if kept.height else None


def ratios(times: pl.DataFrame, errors: Sequence[float] = COMPARED) -> pl.DataFrame:
    """Return how many times as long each rival takes as we do, at each error: of an approach, and of its contacts.

    Our contacts are a small difference of times: the median of those measured beside each rival counts.
    """
    rows, alone = [], pl.col(TIMES[1])
    median = alone.median().over("scene", "contender", "setting")
    times = times.with_columns(pl.when(contender=OURS).then(median).otherwise(alone).alias(TIMES[1]))
    for (scene, rival), cell in times.group_by("scene", "rival", maintain_order=True):
        for error in errors:
            row: dict[str, Any] = {"scene": scene, "rival": rival, "error": error}
            for by in TIMES:
                best = [cheapest(cell, names, error, by) for names in ([OURS], RIVALS[str(rival)])]
                ours, theirs = (None if each is None else each[by] for each in best)
                comparable = (rival, by) != (CAREFUL, TIMES[0])
                ratio = theirs / ours if ours and theirs and comparable else None
                row |= {f"{by}_ours": ours, by: theirs, f"{by}_ratio": ratio}
            failed = cell.filter(pl.col("contender") != OURS)["failure"].unique().to_list()
            rows.append(row | {"failure": "; ".join(sorted(filter(None, failed)))})
    return pl.DataFrame(rows, infer_schema_length=None)


def faster(found: pl.DataFrame) -> str:
    """Return the sentence that names the rivals that are faster than we are, and where."""
    lines = [
        f"{row['rival']} takes {row[f'{by}_ratio']:.2f} times as long as impact_gym on {what} of '{row['scene']}' at "
        f"{power(row['error'])} m/s"
        for by, what in zip(TIMES, ("the whole approach", "the contacts"), strict=True)
        for row in found.filter(pl.col(f"{by}_ratio") < 1.0).iter_rows(named=True)
    ]
    return f"Faster than impact_gym: {'; '.join(lines)}." if lines else "No rival is faster than impact_gym anywhere."


def answer(found: pl.DataFrame) -> str:
    """Return who is faster, and by how much we are at FINE beside the best rival of each approach."""
    words = [faster(found)]
    for by, what in zip(TIMES, ("the whole approach", "the contacts alone"), strict=True):
        best = found.filter(pl.col("error") == FINE, pl.col(f"{by}_ratio").is_not_null()).sort(f"{by}_ratio")
        best = best.unique("scene", keep="first").sort(f"{by}_ratio")
        if best.height:
            first, last = best.row(0, named=True), best.row(-1, named=True)
            words.append(
                f"At an error of {power(FINE)} m/s in V_p the best rival takes {factor(first[f'{by}_ratio'])} "
                f"('{first['scene']}', {first['rival']}) to {factor(last[f'{by}_ratio'])} ('{last['scene']}', "
                f"{last['rival']}) times as long as impact_gym for {what}."
            )
    return " ".join(words)


def table_of(found: pl.DataFrame, truths: pl.DataFrame) -> Table:
    """Return the one table: a row for each approach and error, ours and each rival's times."""
    lines = []
    for (scene, error), rows in found.group_by("scene", "error", maintain_order=True):
        n = max(truths.filter(scene=scene)["contacts"].item(), 1)
        ours = rows.select(pl.col(f"{by}_ours").min() for by in TIMES).row(0)
        cells = [cell_of(ours[0], ours[1], n, "-")]
        for row in rows.iter_rows(named=True):
            approach = None if row["rival"] == CAREFUL else row[TIMES[0]]
            cells.append(cell_of(approach, row[TIMES[1]], n, row["failure"] or "not reached"))
        lines.append([f"{scene!s}, {power(float(str(error)))}", *cells])
    head = ("approach, error (m/s)", OURS, *found["rival"].unique(maintain_order=True))
    return Table("µs of an approach / of a contact", head, lines)


def cell_of(approach: float | None, contacts: float | None, n: int, otherwise: str) -> str:
    """Return the two times of a cell, or what stands there without them."""
    if contacts is None:
        return otherwise
    return f"{'-' if approach is None else f'{approach:.0f}'} / {contacts / n:.1f}"


def analyse(frames: Frames, quick: bool) -> Findings:
    """Compare contenders at each error, and draw error against time and time against what it grows with."""
    truths, times = frames["truth"], frames["times"]
    doubt, load = truths["velocity_error_doubt"].to_numpy().max(), times["load"].drop_nulls().to_numpy()
    found, names = ratios(times), [*ERRORS]
    compiled = times.group_by("rival", maintain_order=True).agg(pl.col("first_seconds").max()).iter_rows()
    compiling = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in compiled if name in PEERS and seconds)
    differ = (pl.col("second_contacts") != pl.col("contacts")) | (pl.col("second_passes") != pl.col("passes"))
    return Findings(answer(found), [
        Section("Who is cheapest at an error", [
            table_of(found, truths),
            "Each contender at its cheapest setting that keeps the error there and at every finer setting tried, so "
            "that no lucky sign counts. Each rival takes turns with impact_gym in one process.",
        ]),
        Section("Error of the object's velocity against time", [drawn(names[0], times, truths, by) for by in TIMES]),
        Section("What our time grows with", [growth(frames["growth"])] if "growth" in frames else []),
        Section("The other errors", [drawn(name, times, truths) for name in names[1:]], folded=True),
        Section("What is compared, and how fair it is", [
            f"Truth: the slow independent solver (experiments/reference) with DOP853 at rtol {power(TRUE_RTOL)}. Radau "
            f"at {power(SECOND_RTOL)} differs by at most {doubt:.1e} m/s in V_p; the "
            f"number of contacts or snap-throughs differs in {truths.filter(differ).height} approaches.",
            "impact_gym: the whole call of simulate, flights and records included, on one core. Its contacts alone: "
            "runs that end behind each contact, less runs that end before it; the median over all rivals' rows.",
            "heyoka, numbalsoda, diffrax: the same equations, written once, in the root of the penetration, where they "
            "are smooth. Only the calls of the library count, flights by it included, on one thread. Compiling is "
            "apart; the first call took at most (its own thread's processor time): "
            f"{compiling or 'none was there'}. numbalsoda has no events for "
            "LSODA; a compiled search on its output finds them, which counts.",
            "SciPy: RK45, DOP853, LSODA, Radau with events through the same slow solver. Only the time inside contacts "
            "counts; its flights are exact and free of charge. Equations are Python functions, as SciPy asks.",
            "Time: processor time, so that other work on the machine counts little; the best of several rounds in "
            f"which both take turns; calls over 0.2 s once. Load while they were timed: {load.min():.2f} to "
            f"{load.max():.2f}.",
        ]),
    ], {"ratios": found})  # fmt: skip


def growth(rows: pl.DataFrame) -> Picture:
    """Draw our time over each quantity."""
    figure = Figure(figsize=(11.0, 6.4))
    panels: Any = figure.subplots(2, 3, squeeze=False)
    for axes, ((name,), curve) in zip(panels.flat, rows.group_by("quantity", maintain_order=True), strict=False):
        axes.plot(curve["value"], curve["microseconds"], marker="o", markersize=4, color=SERIES[0])
        scale = "linear" if name == "contacts" else "log"
        axes.set(xscale=scale, ylim=(0.0, None), xlabel=GROWTH[str(name)][0], ylabel="time per approach (µs)")
    for axes in panels.flat[rows["quantity"].n_unique() :]:
        axes.set_axis_off()
    return Picture("growth", figure, "Time per approach of impact_gym against five quantities.", "One thread.")


def drawn(column: str, times: pl.DataFrame, truths: pl.DataFrame, by: str = TIMES[0]) -> Picture:
    """Draw one error against one of TIMES, a panel for each approach; grey below what the truth itself is known to."""
    lines, columns = ceil(truths.height / 3), min(truths.height, 3)
    figure = Figure(figsize=(3.6 * columns, 3.7 * lines))
    panels: Any = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)
    handles = [Line2D([], [], label=name, **style) for name, style in STYLES.items()]
    handles.append(Line2D([], [], label="wrong answer", **WRONG))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=9)
    error = pl.col(column).fill_nan(None).fill_null(EDGES[1]).clip(*EDGES)  # no answer is as wrong as can be
    shown = times.filter(pl.col(by).is_finite()).sort("setting", descending=True).with_columns(error)
    for axes, truth in zip(panels.flat, truths.iter_rows(named=True), strict=False):
        here = shown.filter(scene=truth["scene"])
        for name in reversed(here["contender"].unique(maintain_order=True).to_list()):
            style = STYLES[name if name in STYLES else CAREFUL] | {"zorder": 3 if name == OURS else 2}
            curve = here.filter(contender=name)
            curve = curve.filter(rival=curve["rival"][0])  # ours is there beside each rival
            wrong = curve.filter(pl.col("failure") != "")
            axes.plot(curve[by], curve[column], **style)
            axes.plot(wrong[by], wrong[column], **style | {"linestyle": ""}, mfc="white")
        axes.axhspan(EDGES[0], max(truth[f"{column}_doubt"], EDGES[0]), color="#bbbbbb", alpha=0.4, linewidth=0)
        axes.set(xscale="log", yscale="log", ylim=(EDGES[0] / 3, EDGES[1] * 3))
        axes.set(xlabel=AXES[by], ylabel=ERRORS[column])
        axes.label_outer()
        axes.set_title("\n".join(wrap(f"{truth['scene']}: {truth['description']}", 44)), fontsize=9)
    what = f"{ERRORS[column]} against time per approach, a panel for each approach, a curve for each contender"
    caption = (
        "Down and left is better. Open marks: the number of contacts or of snap-throughs is wrong, the alarm is missed "
        f"or V_p is wrong by more than {TOO_WRONG:g} m/s. Grey: below what two methods of the slow solver agree to. "
        "Errors outside the axes are drawn at their edge."
    )
    return Picture(column if by == TIMES[0] else f"{column}_contacts", figure, what, caption)


STUDY = Study(
    name="speed",
    question="How fast is the solver at a given error?",
    measurements=(
        Measurement("truth", cells_of_truth, true_row, depends=JUDGES),
        Measurement("times", cells_of_times, timed, (*SOLVER, *JUDGES), failed=no_times, seconds=LONGEST, processes=1),
        Measurement("growth", cells_of_growth, grown, processes=1),
    ),
    analyse=analyse,
)
