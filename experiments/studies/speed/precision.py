"""Work-precision diagrams as in SciMLBenchmarks (Rackauckas et al.): processor time over error, and who is faster."""

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from experiments.lab.parts import Picture, Section, Table
from experiments.lab.study import Cell, Frames
from experiments.studies.solvers import comparison, compiled
from experiments.studies.solvers.approaches import named
from experiments.studies.solvers.comparison import APPROACH, CALL, CONTACT, CVODE, HEYOKA, LANES, PLAIN, SCIPY, SWEEP

ERRORS = {f"1e-{k}": float(f"1e-{k}") for k in range(3, 13)}  # m/s, at which solvers are compared
SHOWN = ("1e-4", "1e-6", "1e-8", "1e-10")  # of them in the table
RTOLS = (1e-2, 3e-3, 1e-3, 3e-4, *(float(f"1e-{k}") for k in range(4, 14)))
STEPS = tuple(np.geomspace(1.2, 0.1, 8).round(3).tolist())  # of plain C, in the units of a contact
SEARCH = {4: 1e-2, 6: 1e-3, 8: 1e-4}  # of plain C: for each order, the relative change at which a search ends
SOLVERS = {  # colour (legible on a light and on a dark page), marker, and which of ours it is compared with
    SWEEP: ("#0072B2", "o", ""), CALL: ("#56B4E9", "s", ""), PLAIN: ("#D55E00", "^", SWEEP),
    CVODE: ("#CC79A7", "v", SWEEP), HEYOKA: ("#009E73", "D", CALL), LANES: ("#B8A000", "d", SWEEP),
    SCIPY: ("#808080", "x", CALL),
}  # fmt: skip
PICTURES = {  # by name: what is computed, error, and words for them
    "speed_approaches": (APPROACH, "velocity_error", "Whole approaches: error of V_p, m/s"),
    "speed_contacts": (CONTACT, "velocity_error", "First contacts alone: error of the object's velocity, m/s"),
    "speed_trajectories": (APPROACH, "path_error", "Whole approaches: largest error of the object's velocity at eight "
                           "times, m/s"),
}  # fmt: skip
COLUMNS = ("scene", "what", "solver", "setting", "microseconds", "velocity_error", "path_error", "miscounted")


def cells(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield a cell for each named approach, and for its first contact, which times all solvers in turn."""
    rtols, steps, rows, rounds = ((1e-3, 1e-9), (0.5,), 64, 1) if quick else (RTOLS, STEPS, comparison.ROWS, 5)
    plain = [[PLAIN, [order, step, SEARCH[order]]] for order, step in product(SEARCH, steps)]
    scipy = [[f"{SCIPY}: {method}", rtol] for method, rtol in product(comparison.METHODS, rtols[1::3])]
    arguments = {"rounds": rounds, "rows": rows, "programs": compiled.DIGEST}
    for name, what in product(named(), (APPROACH, CONTACT)):
        others = (SWEEP, CVODE, HEYOKA, LANES if what == CONTACT else CALL)
        settings = [*plain, *([solver, rtol] for rtol in rtols for solver in others), *scipy]
        yield Cell({"scene": name, "what": what}, {"approach": name, "what": what, "settings": settings, **arguments})


def fronts(times: pl.DataFrame, error: str = "velocity_error") -> pl.DataFrame:
    """Return the settings of each solver that no other of its settings beats in both time and `error`."""
    found = times.filter(pl.col("microseconds").is_not_null(), pl.col(error).is_not_null())
    found = found.with_columns(pl.col("solver").str.split(":").list.first(), pl.col(error).clip(1e-16))
    best = pl.col("microseconds").cum_min().shift(1).over("scene", "what", "solver")
    return found.sort(error, "microseconds").filter(best.is_null() | (pl.col("microseconds") < best))


def draw(figure: Any, times: pl.DataFrame, name: str) -> None:
    """Draw a picture of PICTURES: a panel for each approach, a line for each solver. `times` has COLUMNS."""
    what, error, words = PICTURES[name]
    front, panels = fronts(times.filter(what=what), error), figure.subplots(2, 3, sharex=True, sharey=True)
    for panel, (scene, (description, _)) in zip(panels.flat, named().items(), strict=True):
        panel.set_title(f"{scene}\n{description}", fontsize=7)
        for solver, (colour, marker, usual) in SOLVERS.items():
            line, style = front.filter(scene=scene, solver=solver), {"color": colour, "marker": marker, "ms": 3}
            panel.loglog(line[error], line["microseconds"], label=solver, lw=1.0 if usual else 2.0, **style)
        panel.tick_params(labelsize=8)
        panel.grid(alpha=0.3)
    figure.supxlabel(words, fontsize=9)
    figure.supylabel("processor time, µs", fontsize=9)
    drawn = {line.get_label(): line for panel in panels.flat for line in panel.lines if len(line.get_xdata())}
    figure.legend([*drawn.values()], [*drawn], fontsize=8, ncols=7, loc="outside upper center")


def least(times: pl.DataFrame, error: float) -> dict[tuple[str, str, str], float]:
    """Return the least time (µs) of scene, what is computed and solver, at an error of V_p of at most `error` (m/s)."""
    rows = fronts(times).filter(pl.col("velocity_error") <= error)
    found = rows.group_by("scene", "what", "solver").agg(pl.col("microseconds").min())
    return {(scene, what, solver): value for scene, what, solver, value in found.iter_rows()}


def ahead(times: pl.DataFrame) -> str:
    """Return which solvers take less time than ours, where, and how much."""
    at, found = {name: least(times, error) for name, error in ERRORS.items()}, []
    for (solver, (*_, usual)), what in product(SOLVERS.items(), (APPROACH, CONTACT)):
        gains, most = dict[str, list[str]](), 0.0
        for scene, (error, of) in product(named(), at.items()):
            ours, theirs = (
                of.get((scene, what, each), np.inf) for each in (usual if what == APPROACH else SWEEP, solver)
            )
            if usual and theirs < ours:
                gains.setdefault(scene, []).append(error)
                most = max(most, ours / theirs)
        if gains:
            where = ", ".join(f"{scene} {' to '.join(dict.fromkeys((of[0], of[-1])))}" for scene, of in gains.items())
            found.append(f"{solver}, {what} ({where}; at most {most:.2g} times as fast)")
    return "; ".join(found) or "nobody"


def about_times(times: pl.DataFrame) -> tuple[str, list[Section]]:
    """Return answer and sections of the table `times`."""
    who, pictures, lines = ahead(times), [], []
    for name, (_, _, words) in PICTURES.items():
        draw(figure := Figure(figsize=(9.0, 5.2)), times, name)
        pictures.append(Picture(name, figure, f"Processor time of six approaches over the error. {words}"))
    shown = [solver for solver in SOLVERS if solver != LANES]
    for scene, error in product(named(), SHOWN):
        found = [least(times, ERRORS[error]).get((scene, APPROACH, solver)) for solver in shown]
        lines.append(
            [f"{scene}, {error}", *("-" if each is None else f"{float(f'{each:.3g}'):,.15g}" for each in found)]
        )
    miscounts = list[list[str]]()
    for solver in (PLAIN, SWEEP):
        timed = times.filter(pl.col("microseconds").is_not_null(), solver=solver, what=APPROACH)
        wrong = timed.filter(pl.col("miscounted") > 0)["miscounted"]
        words = f"with {len(wrong)} of {len(timed)} settings, up to {max(wrong, default=0)} of {comparison.ROWS:,}"
        miscounts.append([f"contacts miscounted by {solver}", f"{words} approaches"])
    every = pl.concat([fronts(times, error) for error in ("velocity_error", "path_error")]).unique(maintain_order=True)
    rows = [["" if cell is None else f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row]
            for row in every.select(COLUMNS).sort("scene", "what", "solver", "microseconds").iter_rows()]  # fmt: skip
    reasons = times.filter(pl.col("failure").str.starts_with(comparison.GAVE_UP))
    return f"Faster than impact_gym somewhere: {who}.", [
        Section("Time over error", [
            Table("Who is ahead, and who counts contacts wrongly", ("", "where"),
                  [["faster than impact_gym", who], *miscounts], "speed-ahead"),
            *pictures,
            Table("Processor time of a whole approach at an error of V_p of at most so many m/s; -: not reached",
                  ("approach, error", *(f"{solver} (µs)" for solver in shown)), lines, "speed-cheapest"),
            f"Medians of five rounds of all solvers in turn, one thread. Batches: {comparison.ROWS:,} objects of other "
            "masses; error: the largest of eight, beside experiments/reference with DOP853 at rtol 1e-13. A contact "
            "alone of sweep and plain C: the difference of two calls. docs/speed.md says what each solver does.",
            *reasons.select(pl.format("{}: {}", "solver", "failure")).to_series().unique(maintain_order=True),
        ]),
        Section("All settings", [Table("Settings that no other of the same solver beats", COLUMNS, rows,
                                       "speed-precision")], folded=True),
    ]  # fmt: skip
