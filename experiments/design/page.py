"""The page of a study of designs: its front, the chosen design and its gain, and whether it is the optimum."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from agents.baselines.rule import Floats
from experiments.design.run import Entry
from experiments.design.study import CHOSEN, FRONT, GRID, PAPER, SEEDS, Study
from experiments.lab.charts import OBJECT, SERIES, TOOL
from experiments.lab.comparison import Comparison
from experiments.lab.experiment import write
from experiments.lab.statistics import Estimate, Resamples, estimate, quantile_groups
from experiments.lab.tables import Row
from impact_gym.quantities import QUANTITIES

Lines = Mapping[str, Sequence[Entry]]
"""The entries of each coupling by the name of its line, in the order of their approach times."""
LABELS = {FRONT: "best design for each approach time", CHOSEN: "chosen design"}
TRADE_OFF = ("approach_time", "object_velocity")
BINS = 5  # of distances


def lines_of(entries: Sequence[Entry]) -> dict[str, list[Entry]]:
    """Return the entries by the name of their line, each line in the order of its approach times."""
    ordered = sorted(entries, key=lambda entry: entry.mean("approach_time"))
    names = dict.fromkeys(entry.line for entry in entries)
    return {name: [entry for entry in ordered if entry.line == name] for name in names}


def reduction(line: Sequence[Entry], paper: Entry) -> Estimate:
    """Return by which share a line's V_p is below that of the paper's rule, at the mean approach time of that rule."""
    resamples = Resamples(len(paper.results["object_velocity"]))
    ours, theirs = (
        [resamples.means(np.array([entry.results[name] for entry in entries])[None]) for name in TRADE_OFF]
        for entries in (line, [paper])
    )
    return Comparison.of_fronts((ours[0], ours[1]), (theirs[0], theirs[1])).reduction


def row(entry: Entry, paper: Entry) -> Row:
    """Return the row of an entry, beside the paper's rule."""
    velocity, results = entry.mean("object_velocity"), entry.results
    return {
        "line": entry.line,
        "seed": entry.seed,
        "allowed": entry.allowed,
        "approach_time": entry.mean("approach_time"),
        "object_velocity": velocity,
        "lower": 1.0 - velocity / paper.mean("object_velocity"),
        "loss": entry.loss,
        "deflection": float(results["deflection"].max()),
        "stroke": float(results["stroke"].max()),
        "peak_force": float(np.quantile(results["peak_force"], 0.95)),
        "second_blow": float((results["contact_count"] > 1).mean()),
        "missed": int(results["missed"].sum()),
        "excess": results["excess"].item(),
        "design": ", ".join(f"{name} {with_unit(name, value)}" for name, value in entry.rig.design.items()),
        "controller": f"{entry.rig.rule}: {', '.join(f'{value:.6g}' for value in entry.rig.parameters)}",
    }


def sentence(row: Row) -> str:
    """Return a row in words."""
    parts = [
        f"{row['line']} at {row['allowed']:g}: V_p {row['object_velocity']:.4f} m/s, {row['lower']:.1%} less, at "
        f"{row['approach_time']:.4f} s",
        f"deflection {1e3 * row['deflection']:.1f} mm, stroke {1e3 * row['stroke']:.1f} mm, a second blow in "
        f"{row['second_blow']:.1%}, missed {row['missed']}",
        f"BEYOND ITS LIMITS by {row['excess']:.2g}" if row["excess"] else "",
        row["design"],
    ]
    return "; ".join(filter(None, parts))


def with_unit(name: str, value: float) -> str:
    """Return a number of a design with its unit."""
    return f"{value:.4g} {QUANTITIES[name].unit.removeprefix('-')}".strip()


def _point(entry: Entry) -> tuple[float, float]:
    """Return mean approach time (s) and V_p (m/s)."""
    time, velocity = map(entry.mean, TRADE_OFF)
    return time, velocity


def front_chart(lines: Lines) -> Figure:
    """Return approach time against V_p, each design of the front with its largest deflection in free flight."""
    figure = Figure(figsize=(8.4, 4.8))
    axes = figure.subplots()
    others = [name for name in lines if name not in (*LABELS, PAPER)]
    for name, colour in {**dict(zip(others, SERIES[2:], strict=False)), CHOSEN: TOOL, FRONT: OBJECT}.items():
        style = "s" if name == FRONT else "o-"
        points = zip(*map(_point, lines[name]), strict=True)
        axes.plot(*points, style, color=colour, label=LABELS.get(name, name), markersize=5)
    for entry in lines[FRONT]:
        text = f"{1e3 * entry.results['deflection'].max():.1f} mm"
        axes.annotate(text, _point(entry), xytext=(5, 6), textcoords="offset points", fontsize=8)
    axes.plot(*_point(lines[PAPER][0]), "k*", markersize=12, label=PAPER)
    axes.set(xlabel="mean approach time (s)", ylabel="mean $V_p$ (m/s)", ylim=(0.0, None))
    axes.legend(fontsize=9)
    return figure


def grid_chart(seeds: Sequence[Entry], grid: Sequence[Entry], study: Study) -> Figure:
    """Return a grid over two free numbers as a map of V_p where it was searched, and where the seeds ended."""
    figure = Figure(figsize=(7.6, 4.4))
    axes = figure.subplots()

    def places(entries: Sequence[Entry]) -> list[Floats]:
        return [free.searched([entry.rig.design[free.name] for entry in entries]) for free in study.numbers]

    across, up = places(grid)
    levels = axes.tricontourf(across, up, [entry.loss for entry in grid], levels=12, cmap="viridis_r")
    axes.plot(across, up, ".", color="white", label="grid, a search of its controller each")
    axes.plot(*places(seeds), "o", color=OBJECT, markeredgecolor="black", label="joint search, a seed each")
    for free, count, axis in zip(study.numbers, study.grid or (), (axes.xaxis, axes.yaxis), strict=True):
        values = free.spread(count)
        axis.set_ticks(free.searched(values), [f"{value:.3g}" for value in values])
        unit = QUANTITIES[free.name].unit
        axis.set_label_text(free.name if unit == "-" else f"{free.name} ({unit})")
    axes.grid(color=TOOL, alpha=0.1)
    axes.legend(loc="upper right", fontsize=8, frameon=True)
    figure.colorbar(levels, label="V_p where searched (m/s)")
    return figure


def optimum(seeds: Sequence[Entry], grid: Sequence[Entry], paper: Entry) -> dict[str, Any]:
    """Return a row for each seed and for the best of the grid, with the interval of its V_p on the test set."""
    best, resamples = min(grid, key=lambda entry: entry.loss), Resamples(len(paper.results["object_velocity"]))
    table = [
        row(entry, paper) | {"velocity": estimate(resamples.means(entry.results["object_velocity"]))}
        for entry in (*sorted(seeds, key=lambda entry: entry.seed), best)
    ]
    *velocities, of_best = (line["velocity"] for line in table)
    values = [velocity.value for velocity in velocities]
    within = sum(velocity.low <= of_best.value <= velocity.high for velocity in velocities)
    return {"table": table, "count": len(grid), "within": within, "spread": max(values) - min(values)}


def write_page(study: Study, entries: Sequence[Entry], file: str, runs: Any) -> Path:
    """Write the page of a study, and return its path.

    Args:
        study: what was asked for.
        entries: as `run` returns them.
        file: name of the chosen design's set-up, beside the page.
        runs: notes of what made it.
    """
    lines = lines_of(entries)
    seeds, grid = lines.pop(SEEDS, []), lines.pop(GRID, [])
    (paper,) = lines[PAPER]
    chosen = next(entry for entry in lines[CHOSEN] if entry.allowed == study.typical)
    gains = {name: reduction(line, paper) for name, line in lines.items() if name != PAPER}
    velocities, of_paper = (entry.results["object_velocity"] for entry in (chosen, paper))
    fifths = [mask for mask, *_ in quantile_groups(chosen.results["distance"], BINS)]
    rows = {name: [row(entry, paper) for entry in line] for name, line in lines.items()}
    table = [each for line in rows.values() for each in line]
    content = {
        "setup": study.arm.name,
        "gains": {LABELS.get(name, name): gain for name, gain in gains.items()},
        "gain": gains[CHOSEN],
        "design": {name: with_unit(name, value) for name, value in chosen.rig.design.items()},
        "pad": chosen.rig.pad,
        "deflection": max(each["deflection"] for each in rows[CHOSEN]),
        "least": min(1.0 - velocities[mask].mean() / of_paper[mask].mean() for mask in fifths),
        "rows": table,
        "file": file,
        "optimum": optimum(seeds, grid, paper) if grid else None,
    }
    figures = {"front": front_chart(lines)}
    figures |= {"grid": grid_chart(seeds, grid, study)} if grid else {}
    tables = {"designs": table, "grid": [row(entry, paper) for entry in (*seeds, *grid)]}
    return write("design", study.out, tables, figures, content, runs)
