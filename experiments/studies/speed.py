"""`impact-gym study speed`: work-precision diagrams (error against time), as in SciMLBenchmarks (Rackauckas et al.)."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import fields
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
from experiments.studies.solvers import contenders
from experiments.studies.solvers.approaches import Solution, named
from experiments.studies.solvers.contenders import CAREFUL, JUDGES, OURS, PEER, power

COMPARED = (1e-4, 1e-6, 1e-8, 1e-10)  # m/s, errors of V_p at which contenders are compared
FINE = 1e-6  # m/s, an error in COMPARED; the answer has the time ratios at this error
RTOLS = tuple(float(f"1e-{k}") for k in range(3, 14))
RIVALS = {CAREFUL: tuple(f"{CAREFUL} {method}" for method in contenders.METHODS), PEER: (PEER,)}
LONGEST = 400.0  # s, time limit of a cell, including the time in which heyoka compiles
EDGES = (1e-16, 1e1)  # m/s; errors outside these limits are drawn at the limit
STYLES: dict[str, dict[str, Any]] = {
    OURS: {"color": SERIES[0], "marker": "o", "linestyle": "-", "linewidth": 2.4, "markersize": 4, "zorder": 3},
    CAREFUL: {"color": OTHERS, "marker": "s", "linestyle": "--", "linewidth": 1.2, "markersize": 4},
    PEER: {"color": SERIES[1], "marker": "^", "linestyle": "--", "linewidth": 1.2, "markersize": 4},
}


def cells_of_times(quick: bool, frames: Frames) -> Iterator[Cell]:
    """Yield a cell for each rival on each named approach."""
    rtols, rounds = ((1e-3, 1e-6, 1e-9), 1) if quick else (RTOLS, 3)
    for row in frames["truth"].iter_rows(named=True):
        truth = {field.name: row[field.name] for field in fields(Solution) if not math.isnan(row[field.name])}
        for rival, names in RIVALS.items():
            settings = [[name, rtol] for rtol in rtols for name in (OURS, *names) if name != OURS or rtol > 1e-13]
            arguments = {"approach": row["scene"], "truth": truth, "settings": settings, "rounds": rounds}
            yield Cell({"scene": row["scene"], "rival": rival}, arguments)


def cheapest(rows: pl.DataFrame, names: Sequence[str], error: float) -> Row | None:
    """Return the fastest row whose error, like the errors at all finer settings, is at most `error` (m/s)."""
    keeps = (pl.col("velocity_error") <= error).fill_null(value=False).cast(pl.Int8).cum_min().over("contender") == 1
    kept = rows.filter(pl.col("contender").is_in(names)).sort("setting").filter(keeps).sort("microseconds")
    return kept.row(0, named=True) if kept.height else None


def ratios(times: pl.DataFrame, errors: Sequence[float] = COMPARED) -> pl.DataFrame:
    """Return a row for each approach, rival and error: the times (µs) of our solver and the rival, and their ratio."""
    rows = []
    for (scene, rival), cell in times.group_by("scene", "rival", maintain_order=True):
        failed = cell.filter(pl.col("contender") != OURS)["failure"].unique().to_list()
        for error in errors:
            best = [cheapest(cell, names, error) for names in ([OURS], RIVALS[str(rival)])]
            ours, theirs = (None if each is None else each["microseconds"] for each in best)
            row = {"scene": scene, "rival": rival, "error": error, "ours": ours, "theirs": theirs}
            row |= {"ratio": theirs / ours if ours and theirs else None}
            rows.append(row | {"failure": "; ".join(sorted(filter(None, failed)))})
    return pl.DataFrame(rows, infer_schema_length=None)


def answer(found: pl.DataFrame) -> str:
    """Return in words where a rival is faster than impact_gym, and the best rival's time ratio at the error FINE."""
    known = found.filter(pl.col("ratio").is_not_null()).sort("ratio", maintain_order=True)
    faster = [
        f"{row['rival']} takes {row['ratio']:.2f} times as long as impact_gym on '{row['scene']}' at "
        f"{power(row['error'])} m/s"
        for row in known.filter(pl.col("ratio") < 1.0).iter_rows(named=True)
    ]
    words = f"Faster than impact_gym: {'; '.join(faster)}." if faster else "No rival is faster than impact_gym."
    best = known.filter(error=FINE).unique("scene", keep="first").sort("ratio").to_dicts()
    if best:
        first, last = (f"{factor(row['ratio'])} ('{row['scene']}', {row['rival']})" for row in (best[0], best[-1]))
        words += f" At an error of {power(FINE)} m/s in V_p the best rival takes {first} to {last} times as long."
    return words


def table_of(found: pl.DataFrame) -> Table:
    """Return the table of times: a row for each approach and error, a column for impact_gym and each rival."""
    lines = []
    for (scene, error), rows in found.group_by("scene", "error", maintain_order=True):
        ours = rows["ours"].drop_nulls().to_list()
        cells = [f"{min(ours):.0f}" if ours else "-"]
        for row in rows.iter_rows(named=True):
            cells.append(row["failure"] or "not reached" if row["theirs"] is None else f"{row['theirs']:.0f}")
        lines.append([f"{scene}, {power(float(str(error)))}", *cells])
    head = ("approach, error (m/s)", OURS, *found["rival"].unique(maintain_order=True))
    return Table("µs of an approach; SciPy: only of its contacts", head, lines)


def analyse(frames: Frames, quick: bool) -> Findings:
    """Compare contenders at each error, and draw the error against time."""
    truths, times = frames["truth"], frames["times"]
    doubt = truths["velocity_doubt"].to_numpy().max()
    found = ratios(times)
    differ = (pl.col("second_contacts") != pl.col("contacts")) | (pl.col("second_passes") != pl.col("passes"))
    return Findings(answer(found), [
        Section("Who is cheapest at an error", [
            table_of(found),
            "Each time is of the fastest setting that keeps the error, if every finer setting keeps the error, too. "
            "In one process each rival is timed in turn with impact_gym.",
        ]),
        Section("Error of the object's velocity against time", [drawn(times, truths)]),
        Section("What is compared, and how fair it is", [
            "Truth: the slow independent solver (experiments/reference) with DOP853 at rtol "
            f"{power(contenders.TRUE_RTOL)}. Radau at {power(contenders.SECOND_RTOL)} differs by at most {doubt:.1e} "
            f"m/s in V_p; the number of contacts or passes differs in {truths.filter(differ).height} approaches.",
            "impact_gym: the whole call of simulate, flights and records included, on one core.",
            "heyoka: the same equations, in the root of the penetration, where they are smooth. Only the calls of the "
            "library count, flights included, on one thread; compiling does not count.",
            "SciPy: RK45, DOP853, LSODA, Radau with events through the same slow solver. Only the time inside contacts "
            "counts, because these methods compute no flights. Equations are Python functions, as SciPy requires.",
            "Time: processor time, the best of several rounds. Calls over 0.2 s are made once.",
        ]),
    ], {"ratios": found})  # fmt: skip


def drawn(times: pl.DataFrame, truths: pl.DataFrame) -> Picture:
    """Draw the error of V_p against time, a panel for each approach."""
    lines, columns = ceil(truths.height / 3), min(truths.height, 3)
    figure = Figure(figsize=(3.6 * columns, 3.7 * lines))
    panels: Any = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)
    handles = [Line2D([], [], label=name, **style) for name, style in STYLES.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=9)
    error = pl.col("velocity_error").fill_nan(None).fill_null(EDGES[1]).clip(*EDGES)
    shown = times.filter(pl.col("microseconds").is_finite()).sort("setting", descending=True).with_columns(error)
    for axes, truth in zip(panels.flat, truths.iter_rows(named=True), strict=False):
        for (name,), curve in shown.filter(scene=truth["scene"]).group_by("contender", maintain_order=True):
            curve = curve.filter(rival=curve["rival"][0])  # each rival's cell has a curve of impact_gym; one is drawn
            style, wrong = STYLES[str(name).partition(" ")[0]], curve.filter(pl.col("failure") != "")
            axes.plot(curve["microseconds"], curve["velocity_error"], **style)
            axes.plot(wrong["microseconds"], wrong["velocity_error"], **style | {"linestyle": ""}, mfc="white")
        axes.axhspan(EDGES[0], max(truth["velocity_doubt"], EDGES[0]), color="#bbbbbb", alpha=0.4, linewidth=0)
        axes.set(xscale="log", yscale="log", ylim=(EDGES[0] / 3, EDGES[1] * 3))
        axes.set(xlabel="processor time per approach (µs)", ylabel="error of V_p (m/s)")
        axes.label_outer()
        axes.set_title("\n".join(wrap(f"{truth['scene']}: {truth['description']}", 44)), fontsize=9)
    what = "Error of V_p against time per approach, a panel for each approach, a curve for each contender."
    caption = (
        "Down and left is better. Open marks: the number of contacts or of snap-throughs is wrong, an alarm is wrong "
        f"or V_p is wrong by over {contenders.TOO_WRONG:g} m/s. Grey: the difference between two methods of the slow "
        "solver. Errors outside the axes are drawn at their edge."
    )
    return Picture("velocity_error", figure, what, caption)


STUDY = Study(
    name="speed",
    question="How fast is the solver at a given error?",
    measurements=(
        Measurement(
            "truth", lambda *_: [Cell({"scene": each.name}, {"approach": each.name}) for each in named()],
            contenders.true_row, JUDGES,
        ),
        Measurement(
            "times", cells_of_times, contenders.timed, (*SOLVER, *JUDGES), seconds=LONGEST, processes=1,
            failed=lambda labels: {"contender": RIVALS[labels["rival"]][0], "setting": FINE},
        ),
    ),
    analyse=analyse,
)  # fmt: skip
