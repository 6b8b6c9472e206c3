"""The page of `impact-gym design`: compares the designs and other couplings with the paper's rule on the test set."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from experiments.design.options import CHOSEN, FRONT, PAPER, DesignOptions
from experiments.lab import grid
from experiments.lab.charts import SERIES
from experiments.lab.parts import Picture, Section, Table, percent
from experiments.lab.statistics import Comparison, Estimate, Front, Resamples, quantile_groups
from experiments.lab.study import Findings, Frames
from impact_gym.quantities import QUANTITIES

LABELS = {FRONT: "best design for each approach time", CHOSEN: "chosen design"}
BINS = 5  # groups of test scenarios by the object's distance, equally many scenarios in each
ENTRY = ("line", "allowed", "seed", "loss", "rule", "design", "parameters")
"""Columns that identify an `Entry` of the study; `design` and `parameters` are JSON."""


def mean(rows: pl.DataFrame, name: str) -> float:
    """Return the mean of a column."""
    return float(rows[name].to_numpy().mean())


def summary(frame: pl.DataFrame) -> list[dict[str, Any]]:
    """Return a row for each `Entry` that was played on the test set, ordered by line and then by mean approach time."""
    paper = mean(frame.filter(line=PAPER), "object_velocity")
    rows = []
    for labels, played in grid.groups(frame, *ENTRY):
        entry, velocity = dict(zip(ENTRY, labels, strict=True)), mean(played, "object_velocity")
        numbers = ", ".join(f"{name} {with_unit(name, value)}" for name, value in json.loads(entry["design"]).items())
        rows.append({
            **{name: entry[name] for name in ("line", "seed", "allowed", "loss")},
            "approach_time": mean(played, "approach_time"), "object_velocity": velocity,
            "lower": 1.0 - velocity / paper, "deflection": np.max(played["deflection"].to_numpy()),
            "stroke": np.max(played["stroke"].to_numpy()), "peak_force": float(np.quantile(played["peak_force"], 0.95)),
            "second_blow": np.mean(played["contact_count"].to_numpy() > 1),
            "missed": int(played["missed"].sum()), "excess": float(played["excess"][0]), "design": numbers,
            "controller": f"{entry['rule']}: {', '.join(f'{value:.6g}' for value in json.loads(entry['parameters']))}",
        })  # fmt: skip
    lines = list(dict.fromkeys(row["line"] for row in rows))
    return sorted(rows, key=lambda row: (lines.index(row["line"]), row["approach_time"]))


def with_unit(name: str, value: float) -> str:
    """Return a number of a design with its unit."""
    return f"{value:.4g} {QUANTITIES[name].unit.removeprefix('-')}".strip()


def reduction(line: pl.DataFrame, paper: pl.DataFrame) -> Estimate:
    """Return 1 - (V_p of `line` / V_p of the paper's rule), both at the mean approach time of the paper's rule."""
    resamples = Resamples(len(paper))

    def front(rows: pl.DataFrame) -> Front:
        each = [played for _, played in grid.groups(rows, "allowed")]
        times, velocities = (
            np.stack([resamples.means(played[name].to_numpy()) for played in each], axis=1)
            for name in ("approach_time", "object_velocity")
        )
        return times, velocities

    return Comparison.of_fronts(front(line), front(paper)).reduction


def chart(rows: Sequence[dict[str, Any]]) -> Figure:
    """Return a figure of mean V_p against mean approach time; the front's designs are labelled with deflections."""
    figure = Figure(figsize=(8.4, 4.8))
    axes = figure.subplots()
    lines: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        lines.setdefault(row["line"], []).append(row)
    others = [name for name in lines if name not in (*LABELS, PAPER)]
    for name, colour in {**dict(zip(others, SERIES[2:], strict=False)), CHOSEN: SERIES[1], FRONT: SERIES[0]}.items():
        points = ([row[measure] for row in lines[name]] for measure in ("approach_time", "object_velocity"))
        style = "s" if name == FRONT else "o-"
        axes.plot(*points, style, color=colour, label=LABELS.get(name, name), markersize=5)
    for row in lines[FRONT]:
        place = row["approach_time"], row["object_velocity"]
        text = f"{1e3 * row['deflection']:.1f} mm"
        axes.annotate(text, place, xytext=(5, 6), textcoords="offset points", fontsize=8)
    (paper,) = lines[PAPER]
    axes.plot(paper["approach_time"], paper["object_velocity"], "k*", markersize=12, label=PAPER)
    axes.set(xlabel="mean approach time (s)", ylabel="mean $V_p$ (m/s)", ylim=(0.0, None))
    axes.legend(fontsize=9)
    return figure


def analyse(options: DesignOptions, frames: Frames, _: bool) -> Findings:
    """Compare the designs and couplings on the test set."""
    frame = frames["designs"]
    rows, paper = summary(frame), frame.filter(line=PAPER)
    lines = {name: played for (name,), played in grid.groups(frame, "line") if name != PAPER}
    gains = {name: reduction(played, paper) for name, played in lines.items()}
    chosen = lines[CHOSEN].filter(allowed=options.typical)
    velocities, of_paper = (played["object_velocity"].to_numpy() for played in (chosen, paper))
    fifths = [mask for mask, *_ in quantile_groups(chosen["distance"].to_numpy(), BINS)]
    least = min(1.0 - velocities[mask].mean() / of_paper[mask].mean() for mask in fifths)
    moved = max(row["deflection"] for row in rows if row["line"] == CHOSEN)
    design = json.loads(chosen["design"][0])
    numbers = ", ".join(f"{name} {with_unit(name, value)}" for name, value in design.items())
    missed = f" It misses {chosen['missed'].sum()} of {chosen.height} objects." if chosen["missed"].any() else ""
    pad = f" with a pad of {options.pad}" if options.pad else ""
    answer = (
        f"Chosen: {numbers}{pad}. At the mean approach time of the paper's rule it leaves the object "
        f"{percent(gains[CHOSEN])} slower than the paper's rule with the paper's spring; in no fifth of the distances "
        f"less than {100 * least:.1f} %. Before the first touch its tool moves at most {1e3 * moved:.1f} mm against "
        f"the flange. Its set-up: {options.file.name}.{missed}"
    )
    gained = [(LABELS.get(name, name), percent(gain)) for name, gain in gains.items()]
    scaled = [{**row, **{name: 1e3 * row[name] for name in ("deflection", "stroke")}} for row in rows]
    caption = (
        "Down and left is better; test scenarios, which no search used. Beside each design of the front: largest "
        "deflection of its coupling before the first touch. A line is one coupling with a controller searched for each "
        "approach time."
    )
    alt = "Mean approach time against mean V_p: designs, the chosen design, others and the paper's rule."
    read = "Interpolated between the two approach times beside the paper's; the scenarios are resampled."
    return Findings(answer, [
        Section("Approach time against V_p", [
            Picture("front", chart(rows), alt, caption),
            Table(read, ("coupling", "V_p lower at the paper's approach time, 95 % interval"), gained),
        ]),
        Section("All of them", [Table.of("", scaled, {
            "coupling": "{line}", "time allowed (paper's = 1)": "{allowed:.2f}", "approach (s)": "{approach_time:.4f}",
            "V_p (m/s)": "{object_velocity:.4f}", "lower": "{lower:.1%}", "deflection (mm)": "{deflection:.1f}",
            "stroke (mm)": "{stroke:.1f}", "peak force, 95 % (N)": "{peak_force:.0f}",
            "second blow": "{second_blow:.1%}", "missed": "{missed}", "beyond its limits": "{excess:.2g}",
            "design": "{design}",
        })]),
    ], {"summary": pl.DataFrame(rows, infer_schema_length=None)})  # fmt: skip
