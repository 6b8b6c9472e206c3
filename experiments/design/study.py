"""The study of `impact-gym design`: searches, choice, results on the test set.

For each approach time, `front` takes the design (of any seed) with the lowest loss in its search. The chosen design is
the front's design at the approach time nearest to that of the paper's rule. For each other approach time, the study
searches for a new controller for the chosen design. No choice uses the test set.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from agents.evaluate.scenario_batch import TUNING_SEED, ScenarioBatch
from agents.setups.tuned import read_tuned
from experiments.design.options import CHOSEN, FRONT, PAPER, SPRING, DesignOptions
from experiments.design.search import MARGIN, Candidate, Limits, play, search
from experiments.design.variables import as_built
from experiments.lab import grid
from experiments.lab.charts import OTHERS, SERIES
from experiments.lab.parts import Picture, Section, Table, percent
from experiments.lab.statistics import Resamples, reduction, velocity_at_time_of
from experiments.lab.study import Cell, Findings, Frames, Measurement, Study
from impact_gym.couplings import Bistable
from impact_gym.quantities import QUANTITIES

LABELS = {FRONT: "best design for each approach time", CHOSEN: "chosen design"}
ENTRY = ("line", "allowed", "seed", "loss", "rule", "design", "parameters")
DEPENDS = (
    "impact_gym", "agents.baselines", "agents.evaluate", "agents.setups",
    *(f"experiments.design.{name}" for name in ("variables", "pads")),
)  # fmt: skip
Row = Mapping[str, Any]
"""A candidate as a row, with the columns ENTRY. `line`: line of the chart. `allowed`: largest mean approach time,
divided by that of the paper's rule. `seed`, `loss` (m/s): of the search. `rule` to `parameters`: of the candidate."""
PAPERS_RULE: Row = {
    "line": PAPER, "allowed": 1.0, "seed": 1, "loss": np.nan, "rule": "ConstantSpeed", "design": "{}",
    "parameters": "[1.0, 8.0, 8.0]",
}  # fmt: skip


@dataclass(frozen=True)
class Search:
    """The study; its methods yield the cells (jobs) of each table, from the options and from earlier tables."""

    options: DesignOptions

    def study(self) -> Study:
        """Return the study."""
        return Study("design", f"Which coupling is best for {self.options.arm.name}?", (
            Measurement("searches", self.searches, search, DEPENDS),
            Measurement("controllers", self.controllers, search, DEPENDS),
            Measurement("designs", self.designs, play, DEPENDS),
        ), partial(analyse, self.options), ("cma",))  # fmt: skip

    def candidate(self, row: Row) -> Candidate:
        """Return the candidate of a row. The numbers of the chosen design get random errors in each episode."""
        options, line = self.options, row["line"]
        rule = row.get("rule") or ("BlindProfile" if options.arm.task.range_noise is None else "Ranged")
        parameters, design = json.loads(row.get("parameters", "[]")), json.loads(row.get("design", "{}"))
        others = {PAPER: options.others[SPRING], **options.others}
        if line in others:
            return Candidate(others[line], rule, parameters)
        environment = options.searched
        if line == CHOSEN:
            built = as_built(design, MARGIN * options.tolerance)
            environment = options.arm.task.changed(built).arguments()
        return Candidate(environment, rule, parameters, design, options.pad)

    def searches(self, _: bool, __: Frames) -> Iterator[Cell]:
        """Yield cells that search for designs, and for controllers of the compared couplings."""
        seeds = {FRONT: self.options.seeds} | dict.fromkeys(self.options.others, 1)
        yield from self._searched(
            {"line": line, "allowed": allowed, "seed": 1 + k}
            for line, count in seeds.items()
            for allowed in self.options.times
            for k in range(count)
        )

    def controllers(self, _: bool, frames: Frames) -> Iterator[Cell]:
        """Yield cells that search for the chosen design's controller at each approach time except `typical`."""
        chosen = {**self.chosen(frames), "seed": 1}
        others = [time for time in self.options.times if time != self.options.typical]
        yield from self._searched({**chosen, "allowed": time} for time in others)

    def designs(self, _: bool, frames: Frames) -> Iterator[Cell]:
        """Yield cells that play the paper's rule, the designs and the compared couplings on the test set."""
        chosen = self.chosen(frames)
        again = frames["controllers"].to_dicts() if "controllers" in frames else []
        curve = [chosen, *({**row, "design": chosen["design"]} for row in again)]
        compared = frames["searches"].filter(pl.col("line") != FRONT).to_dicts()
        for row in (PAPERS_RULE, *self.front(frames), *curve, *compared):
            candidate = self.candidate(row)
            labels = {**row, "rule": candidate.rule}
            arguments = {"candidate": asdict(candidate), "tolerance": self.options.tolerance}
            yield Cell({column: labels[column] for column in ENTRY}, {**arguments, "limits": self._limits(row)})

    def chosen(self, frames: Frames) -> Row:
        """Return the front's design at the approach time `typical`."""
        row = next(row for row in self.front(frames) if row["allowed"] == self.options.typical)
        return {**row, "line": CHOSEN}

    def front(self, frames: Frames) -> Sequence[Row]:
        """Return for each approach time the design with the lowest loss."""
        best = frames["searches"].filter(line=FRONT).sort("allowed", "loss")
        return best.unique("allowed", keep="first", maintain_order=True).to_dicts()

    def _searched(self, rows: Iterable[Row]) -> Iterator[Cell]:
        """Yield searches that start at a row's own parameters, or at those of the shipped baseline nearest in time."""
        options, papers_rule = self.options, self.candidate(PAPERS_RULE)
        batch = ScenarioBatch(TUNING_SEED, options.scenarios, papers_rule.task, threads=1)
        paper = float(batch.play(papers_rule.controller()).approach_time.mean())
        for row in rows:
            candidate, time = self.candidate(row), row["allowed"] * paper
            blind = "bistable-blind-profile" if isinstance(candidate.task.coupling, Bistable) else "blind-profile"
            tuned = read_tuned(blind if candidate.rule == "BlindProfile" else "ranged")["weights"].values()
            nearest = np.argmin([abs(each["validation"]["approach_time"] - time) for each in tuned])
            start = list(candidate.parameters) or list([*tuned][nearest]["parameters"].values())
            variables = options.variables if row["line"] == FRONT else []
            yield Cell({name: row[name] for name in ("line", "allowed", "seed")}, {
                "candidate": asdict(replace(candidate, parameters=start, design={})),
                "variables": list(map(list, variables)), "approach_time": time,
                "limits": self._limits(row), "tolerance": options.tolerance, "scenarios": options.scenarios,
                "budget": options.budget, "population": options.population, "seed": row["seed"],
            })  # fmt: skip

    def _limits(self, row: Row) -> dict[str, Any]:
        """Return the limits for a row; only FRONT and CHOSEN have limits."""
        return asdict(self.options.limits if row["line"] in (FRONT, CHOSEN) else Limits(deflection=None))


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
    lines = pl.Enum(each["line"].unique(maintain_order=True))
    rows = each.sort(pl.col("line").cast(lines), "approach_time", maintain_order=True).to_dicts()
    for row in rows:
        row["design"] = in_words(row["design"])
        parameters = ", ".join(f"{value:.6g}" for value in json.loads(row.pop("parameters")))
        row["controller"] = f"{row.pop('rule')}: {parameters}"
    return rows


def in_words(design: str) -> str:
    """Return a design (JSON) as text: names, values and units."""
    units = {name: QUANTITIES[name].unit.removeprefix("-") for name in json.loads(design)}
    return ", ".join(f"{name} {value:.4g} {units[name]}".strip() for name, value in json.loads(design).items())


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
    rows, resamples = summary(frame), Resamples(frame.filter(line=PAPER).height)
    lines = {name: played for (name,), played in grid.groups(frame, "line")}
    weighted = {name: rows.rename({"allowed": "weight"}).with_row_index("episode") for name, rows in lines.items()}
    fronts = {name: grid.front_of(played, resamples) for name, played in weighted.items()}
    paper = fronts.pop(PAPER)
    gains = {name: reduction(velocity_at_time_of(paper, front), paper[1][:, 0]) for name, front in fronts.items()}
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
