"""The page of `impact-gym design`: comparison of designs and other couplings with the paper's rule on the test set."""

import json
from collections.abc import Sequence
from typing import Any

import polars as pl
from matplotlib.figure import Figure

from experiments.design.options import CHOSEN, FRONT, PAPER, DesignOptions
from experiments.lab import grid
from experiments.lab.charts import OTHERS, SERIES
from experiments.lab.parts import Picture, Section, Table, percent
from experiments.lab.statistics import Estimate, Resamples, estimate, velocity_at_time_of
from experiments.lab.study import Findings, Frames
from impact_gym.quantities import QUANTITIES

LABELS = {FRONT: "best design for each approach time", CHOSEN: "chosen design"}
ENTRY = ("line", "allowed", "seed", "loss", "rule", "design", "parameters")  # columns of `experiments.design.study.Row`


def summary(frame: pl.DataFrame) -> list[dict[str, Any]]:
    """Return a row for each candidate that played the test set, sorted by line of the chart and mean approach time."""
    paper = frame.filter(line=PAPER)["object_velocity"].mean()
    each = frame.group_by(ENTRY, maintain_order=True).agg(
        pl.mean("approach_time", "object_velocity"),
        pl.max("deflection", "stroke"),
        pl.quantile("peak_force", 0.95, "linear"),
        pl.sum("missed"),
        pl.first("excess"),
        lower=1.0 - pl.mean("object_velocity") / paper,
        second_blow=(pl.col("contact_count") > 1).mean(),
    )
    lines = each["line"].unique(maintain_order=True).to_list()
    rows = sorted(each.to_dicts(), key=lambda row: (lines.index(row["line"]), row["approach_time"]))
    for row in rows:
        row["design"] = in_words(row["design"])
        parameters = ", ".join(f"{value:.6g}" for value in json.loads(row.pop("parameters")))
        row["controller"] = f"{row.pop('rule')}: {parameters}"
    return rows


def in_words(design: str) -> str:
    """Return a design (JSON) as text: names, values and units."""
    units = {name: QUANTITIES[name].unit.removeprefix("-") for name in json.loads(design)}
    return ", ".join(f"{name} {value:.4g} {units[name]}".strip() for name, value in json.loads(design).items())


def reduction(line: pl.DataFrame, paper: pl.DataFrame) -> Estimate:
    """Return 1 - V_p(`line`) / V_p(`paper`) at the mean approach time of `paper`, which is the paper's rule."""
    resamples = Resamples(len(paper))
    ours, theirs = (
        grid.front_of(rows.rename({"allowed": "weight"}).with_row_index("episode"), resamples) for rows in (line, paper)
    )
    return estimate(1.0 - velocity_at_time_of(theirs, ours) / theirs[1][:, 0])


def chart(rows: Sequence[dict[str, Any]]) -> Figure:
    """Return a figure of mean V_p against mean approach time."""
    figure, others = Figure(figsize=(8.4, 4.8)), iter(SERIES[2:])
    axes = figure.subplots()
    styles = {PAPER: ("*", "k"), FRONT: ("s", SERIES[0]), CHOSEN: ("o-", SERIES[1])}
    for name in dict.fromkeys(row["line"] for row in rows):
        style, colour = styles.get(name) or ("o-", next(others, OTHERS))
        places = [(row["approach_time"], row["object_velocity"]) for row in rows if row["line"] == name]
        size = 12 if name == PAPER else 5
        axes.plot(*zip(*places, strict=True), style, color=colour, label=LABELS.get(name, name), markersize=size)
    axes.set(xlabel="mean approach time (s)", ylabel="mean $V_p$ (m/s)", ylim=(0.0, None))
    axes.legend(fontsize=9)
    return figure


def analyse(options: DesignOptions, frames: Frames, _: bool) -> Findings:
    """Compare the designs and the other couplings with the paper's rule on the test set."""
    frame = frames["designs"]
    rows, paper = summary(frame), frame.filter(line=PAPER)
    lines = {name: played for (name,), played in grid.groups(frame, "line") if name != PAPER}
    gains = {name: reduction(played, paper) for name, played in lines.items()}
    chosen = lines[CHOSEN].filter(allowed=options.typical)
    moved = max(row["deflection"] for row in rows if row["line"] == CHOSEN)
    missed = f" It misses {chosen['missed'].sum()} of {chosen.height} objects." if chosen["missed"].any() else ""
    pad = f" with a pad of {options.pad}" if options.pad else ""
    answer = (
        f"Chosen design: {in_words(chosen['design'][0])}{pad}. At the mean approach time of the paper's rule, mean V_p "
        f"is {percent(gains[CHOSEN])} lower than with the paper's rule and spring. Before the first touch, the tool "
        f"moves at most {1e3 * moved:.1f} mm against the flange. Set-up: {options.file.name}.{missed}"
    )
    gained = [(LABELS.get(name, name), percent(gain)) for name, gain in gains.items()]
    scaled = [{**row, **{name: 1e3 * row[name] for name in ("deflection", "stroke")}} for row in rows]
    caption = (
        "No search used these test scenarios. Points below and to the left are better. A line is one coupling, with a "
        "controller for each approach time."
    )
    alt = "Mean approach time against mean V_p: designs, the chosen design, others and the paper's rule."
    read = "V_p is interpolated on the line; outside the line, the nearest end counts. Intervals: resampled scenarios."
    return Findings(answer, [
        Section("Approach time against V_p", [
            Picture("front", chart(rows), alt, caption),
            Table(read, ("coupling", "V_p lower at the paper's approach time, 95 % interval"), gained),
        ]),
        Section("All designs and couplings", [Table.of("", scaled, {
            "coupling": "{line}", "time allowed (paper's = 1)": "{allowed:.2f}", "approach (s)": "{approach_time:.4f}",
            "V_p (m/s)": "{object_velocity:.4f}", "lower": "{lower:.1%}", "deflection (mm)": "{deflection:.1f}",
            "stroke (mm)": "{stroke:.1f}", "peak force, 95 % (N)": "{peak_force:.0f}",
            "second blow": "{second_blow:.1%}", "missed": "{missed}", "beyond its limits": "{excess:.2g}",
            "design": "{design}",
        })]),
    ], {"summary": pl.DataFrame(rows, infer_schema_length=None)})  # fmt: skip
