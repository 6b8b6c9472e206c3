"""Work-precision diagrams (error against time), as in SciMLBenchmarks (Rackauckas et al.)."""

import math
from collections.abc import Iterator
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
from experiments.lab.study import Cell, Frames
from experiments.studies.solvers import contenders
from experiments.studies.solvers.approaches import Solution
from experiments.studies.solvers.contenders import HEYOKA, OURS, SCIPY, power

FINE, OTHER = 1e-6, (1e-4, 1e-8, 1e-10)  # m/s, errors of V_p at which contenders are compared
RTOLS = tuple(float(f"1e-{k}") for k in range(3, 14))
CONTENDERS = {OURS: (OURS,), HEYOKA: (HEYOKA,), SCIPY: tuple(f"{SCIPY} {method}" for method in contenders.METHODS)}
LONGEST = 800.0  # s, time limit of a cell, including the time in which heyoka compiles
EDGES = (1e-16, 1e1)  # m/s; errors outside these limits are drawn at the limit
STYLES: dict[str, dict[str, Any]] = {
    OURS: {"color": SERIES[0], "marker": "o", "linestyle": "-", "linewidth": 2.4, "markersize": 4, "zorder": 3},
    SCIPY: {"color": OTHERS, "marker": "s", "linestyle": "--", "linewidth": 1.2, "markersize": 4},
    HEYOKA: {"color": SERIES[1], "marker": "^", "linestyle": "--", "linewidth": 1.2, "markersize": 4},
}


def cells(quick: bool, frames: Frames) -> Iterator[Cell]:
    """Yield a cell for each named approach, which times all contenders in turn."""
    rtols, rounds = ((1e-3, 1e-6, 1e-9), 1) if quick else (RTOLS, 5)
    names = sum(CONTENDERS.values(), ())
    settings = [[name, rtol] for rtol in rtols for name in names if name != OURS or rtol > 1e-13]
    for row in frames["truth"].iter_rows(named=True):
        truth = {field.name: row[field.name] for field in fields(Solution) if not math.isnan(row[field.name])}
        arguments = {"approach": row["scene"], "truth": truth, "settings": settings, "rounds": rounds}
        yield Cell({"scene": row["scene"], "description": row["description"]}, arguments)


def cheapest(rows: pl.DataFrame, contender: str, error: float) -> float | str:
    """Return the least time (µs) of a setting whose error, like the errors at finer settings, is at most `error` (m/s).

    If there is none, return the failures of the contender, or "not reached".
    """
    rows = rows.filter(pl.col("contender").is_in(CONTENDERS[contender])).sort("setting")
    keeps = (pl.col("velocity_error") <= error).fill_null(value=False).cast(pl.Int8).cum_min().over("contender") == 1
    times = rows.filter(keeps)["microseconds"].to_list()
    return min(times) if times else "; ".join(sorted({*rows["failure"]} - {"", None})) or "not reached"


def table_of(times: pl.DataFrame, error: float) -> Table:
    """Return the times of all contenders at an error (m/s) and their ratios to ours, a row for each approach."""
    lines = []
    for (scene, what), cell in times.group_by("scene", "description", maintain_order=True):
        ours, *theirs = (cheapest(cell, name, error) for name in CONTENDERS)
        ratio = (factor(each / ours) if isinstance(each, float) and isinstance(ours, float) else "-" for each in theirs)
        shown = (f"{each:,.0f}" if isinstance(each, float) else each for each in (ours, *theirs))
        lines.append([str(scene), str(what), *shown, *ratio])
    heads = (*(f"{name} (µs)" for name in CONTENDERS), *(f"{name} / {OURS}" for name in [*CONTENDERS][1:]))
    caption = (f"Processor time of an approach, fastest setting with an error of at most {power(error)} m/s in V_p; "
               f"{SCIPY}: only of the approach's contacts")  # fmt: skip
    return Table(caption, ("approach", "what it is", *heads), lines, "speed-cheapest" if error == FINE else "")


def about_times(times: pl.DataFrame) -> tuple[str, list[Section]]:
    """Return answer and sections of the table `times`."""
    found = table_of(times, FINE)
    words = []
    for head, *ratios in zip(found.head, *found.rows, strict=True):
        if "/" in head and (known := sorted(float(each.replace(",", "")) for each in ratios if each != "-")):
            words.append(f"{head} {factor(known[0])} to {factor(known[-1])}")
    answer = f"Ratios of processor time at an error of {power(FINE)} m/s in V_p: {', '.join(words)}."
    return answer, [
        Section("Who is cheapest at an error", [
            found,
            "Each time is of the fastest setting that keeps the error, if every finer setting keeps the error, too. "
            "One process times all solvers in turn.",
        ]),
        Section("Who is cheapest at other errors", [table_of(times, each) for each in OTHER], folded=True),
        Section("Error of the object's velocity against time", [drawn(times)]),
        Section("What is compared, and how fair it is", [
            "Truth: the slow independent solver (experiments/reference) with DOP853 at rtol "
            f"{power(contenders.TRUE_RTOL)}.",
            "impact_gym: the whole call of simulate, flights and records included, on one core.",
            "heyoka: the same equations, in the root of the penetration, where they are smooth. Only the calls of the "
            "library count, flights included, on one thread; compiling does not count.",
            "SciPy: RK45, DOP853, LSODA, Radau with events through the same slow solver. Only the time inside contacts "
            "counts, because these methods compute no flights. Equations are Python functions, as SciPy requires.",
            "Time: processor time of the shortest of many calls, in several rounds. Calls over 0.2 s are made once.",
        ]),
    ]  # fmt: skip


def drawn(times: pl.DataFrame) -> Picture:
    """Draw the error of V_p against time, a panel for each approach."""
    scenes = dict(times.select("scene", "description").unique(maintain_order=True).iter_rows())
    lines, columns = ceil(len(scenes) / 3), min(len(scenes), 3)
    figure = Figure(figsize=(3.6 * columns, 3.7 * lines))
    panels: Any = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)
    handles = [Line2D([], [], label=name, **style) for name, style in STYLES.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=9)
    error = pl.col("velocity_error").fill_nan(None).fill_null(EDGES[1]).clip(*EDGES)
    shown = times.filter(pl.col("microseconds").is_finite()).sort("setting", descending=True).with_columns(error)
    for axes, (scene, description) in zip(panels.flat, scenes.items(), strict=False):
        for (name,), curve in shown.filter(scene=scene).group_by("contender", maintain_order=True):
            style, wrong = STYLES[str(name).partition(" ")[0]], curve.filter(pl.col("failure") != "")
            axes.plot(curve["microseconds"], curve["velocity_error"], **style)
            axes.plot(wrong["microseconds"], wrong["velocity_error"], **style | {"linestyle": ""}, mfc="white")
        axes.set(xscale="log", yscale="log", ylim=(EDGES[0] / 3, EDGES[1] * 3))
        axes.set(xlabel="processor time per approach (µs)", ylabel="error of V_p (m/s)")
        axes.label_outer()
        axes.set_title("\n".join(wrap(f"{scene}: {description}", 44)), fontsize=9)
    what = "Error of V_p against time per approach, a panel for each approach, a curve for each contender."
    caption = (
        "Down and left is better. Open marks: the number of contacts or of snap-throughs is wrong, an alarm is wrong "
        f"or V_p is wrong by over {contenders.TOO_WRONG:g} m/s. Errors outside the axes are drawn at their edge."
    )
    return Picture("velocity_error", figure, what, caption)
