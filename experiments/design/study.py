"""The study behind `impact-gym design`: searches, choice by validation, play on the test set, and what that says.

For each approach time the design is the best of its seeds on the validation set. The one at the paper's own time is
chosen, and its controller searched for the other times. Nothing is chosen by the test set.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from agents.baselines.tuned import read_tuned
from agents.evaluate import TUNING_SEED, ScenarioBatch
from experiments.design.options import CHOSEN, FRONT, PAPER, DesignOptions, with_papers_spring
from experiments.design.search import PENALTY, Candidate, play, search
from experiments.lab import grid
from experiments.lab.charts import OBJECT, SERIES, TOOL
from experiments.lab.comparison import Comparison, Front
from experiments.lab.parts import Picture, Section, Table, percent
from experiments.lab.statistics import Estimate, Resamples, quantile_groups
from experiments.lab.study import Cell, Findings, Frames, Measurement, Study
from impact_gym.quantities import QUANTITIES
from impact_gym.scene import Bistable
from impact_gym.task import Task

DEPENDS = (
    "impact_gym", "agents.baselines", "agents.evaluate", "agents.setups",
    *(f"experiments.design.{name}" for name in ("variables", "limits", "pads")),
)  # fmt: skip
PAPERS_RULE = "ConstantSpeed", [1.0, 8.0, 8.0]  # paper, section 3.2
STARTS = {("BlindProfile", False): "blind-profile", ("BlindProfile", True): "bistable-blind-profile"}
"""Tuned baseline whose parameters begin a search, by its rule and whether there is a mechanism; otherwise "ranged"."""
LABELS = {FRONT: "best design for each approach time", CHOSEN: "chosen design"}
BINS = 5  # of distances
ENTRY = ("line", "allowed", "seed", "loss", "rule", "design", "parameters")
"""Columns that tell entries apart: design and parameters are JSON."""


@dataclass(frozen=True)
class Entry:
    """A candidate on a line of the trade-off."""

    line: str  # PAPER, FRONT, CHOSEN, or a name of `DesignOptions.others`
    allowed: float  # approach time, over that of the paper's rule
    candidate: Candidate
    seed: int = 1
    loss: float = np.nan  # m/s, V_p on the scenarios of the search, with the penalty for exceeded limits

    @property
    def labels(self) -> dict[str, Any]:
        """Columns of its rows."""
        candidate = self.candidate
        written = {"design": json.dumps(dict(candidate.design)), "parameters": json.dumps(list(candidate.parameters))}
        values = (self.line, self.allowed, self.seed, self.loss, candidate.rule)
        return dict(zip(ENTRY, values, strict=False)) | written


@dataclass(frozen=True)
class Search:
    """The cells of each table, from the options and the tables before."""

    options: DesignOptions

    @property
    def paper(self) -> Entry:
        """The paper's rule with the paper's spring."""
        return Entry(PAPER, 1.0, Candidate(with_papers_spring(self.options.arm.environment), *PAPERS_RULE))

    def searches(self, _: bool, __: Frames) -> Iterator[Cell]:
        """Yield the searches of designs, and of controllers for the couplings to compare with."""
        options = self.options
        designs = Candidate(options.searched, options.rule, pad=options.pad)
        entries = [
            Entry(FRONT, allowed, designs, seed) for allowed in options.times for seed in range(1, options.seeds + 1)
        ]
        entries += [
            Entry(name, allowed, Candidate(environment, options.rule))
            for name, environment in options.others.items()
            for allowed in options.times
        ]
        yield from self._searched(entries)

    def validation(self, _: bool, frames: Frames) -> Iterator[Cell]:
        """Yield plays of all designs, and of the paper's rule, on the validation set."""
        yield from self._played([self.paper, *self._front_of(frames)], "validation")

    def controllers(self, _: bool, frames: Frames) -> Iterator[Cell]:
        """Yield the searches of the chosen design's controller for the other approach times."""
        chosen = self.chosen(frames)
        built = replace(chosen.candidate, design={})
        others = [time for time in self.options.times if time != self.options.typical]
        yield from self._searched([Entry(CHOSEN, time, built) for time in others], chosen.candidate.parameters)

    def designs(self, _: bool, frames: Frames) -> Iterator[Cell]:
        """Yield plays on the test set: the paper's rule, the front, the chosen design and what is compared."""
        options, chosen = self.options, self.chosen(frames)
        curve = [chosen]
        for row in frames["controllers"].to_dicts() if "controllers" in frames else ():
            candidate = replace(chosen.candidate, parameters=json.loads(row["parameters"]))
            curve.append(Entry(CHOSEN, row["allowed"], candidate, row["seed"], row["loss"]))
        compared = [
            Entry(name, row["allowed"], Candidate(environment, options.rule, json.loads(row["parameters"])),
                  row["seed"], row["loss"])
            for name, environment in options.others.items()
            for row in frames["searches"].filter(line=name).to_dicts()
        ]  # fmt: skip
        yield from self._played([self.paper, *self.front(frames), *curve, *compared], "test")

    def chosen(self, frames: Frames) -> Entry:
        """Return the design of the approach time that is nearest to that of the paper's rule, as it is built."""
        entry = next(entry for entry in self.front(frames) if entry.allowed == self.options.typical)
        environment = self.options.built(entry.candidate.design)
        return replace(entry, line=CHOSEN, candidate=replace(entry.candidate, environment=environment))

    def front(self, frames: Frames) -> list[Entry]:
        """Return for each approach time the design that leaves the object slowest on the validation set.

        Exceeded limits and a later approach count as in a search.
        """
        played = dict(grid.groups(frames["validation"], "line", "allowed", "seed"))
        paper = _mean(played[PAPER, 1.0, 1], "approach_time")

        def cost(entry: Entry) -> float:
            rows = played[entry.line, entry.allowed, entry.seed]
            late = _mean(rows, "approach_time") / (entry.allowed * paper) - 1.0
            return _mean(rows, "object_velocity") + PENALTY * (max(late, 0.0) + _mean(rows, "excess"))

        entries = self._front_of(frames)
        return [min((e for e in entries if e.allowed == allowed), key=cost) for allowed in self.options.times]

    def _front_of(self, frames: Frames) -> list[Entry]:
        """Return the designs of all seeds."""
        designs = Candidate(self.options.searched, self.options.rule, pad=self.options.pad)
        return [
            Entry(FRONT, row["allowed"],
                  replace(designs, design=json.loads(row["design"]), parameters=json.loads(row["parameters"])),
                  row["seed"], row["loss"])
            for row in frames["searches"].filter(line=FRONT).to_dicts()
        ]  # fmt: skip

    def _searched(self, entries: Sequence[Entry], start: Sequence[float] = ()) -> Iterator[Cell]:
        """Yield searches; controllers begin with `start`, or else with a shipped one.

        On the line FRONT the design is searched, elsewhere the controller alone.
        """
        options = self.options
        paper = mean_time(self.paper.candidate, options.search.scenarios)
        for entry in entries:
            time = entry.allowed * paper
            begin = replace(entry.candidate, parameters=list(start or start_of(entry.candidate, time)))
            variables = options.variables if entry.line == FRONT else []
            yield Cell({name: getattr(entry, name) for name in ("line", "allowed", "seed")}, {
                "candidate": asdict(begin), "variables": list(map(list, variables)), "approach_time": time,
                "limits": asdict(options.limits_of(entry.line)), "budget": asdict(options.search), "seed": entry.seed,
            })  # fmt: skip

    def _played(self, entries: Sequence[Entry], name: str) -> Iterator[Cell]:
        """Yield plays of entries on the frozen set of this name."""
        for entry in entries:
            limits = asdict(self.options.limits_of(entry.line))
            arguments = {"candidate": asdict(entry.candidate), "limits": limits, "name": name}
            yield Cell(entry.labels, arguments | {"tolerance": self.options.search.tolerance})


def mean_time(candidate: Candidate, scenarios: int) -> float:
    """Return the mean approach time (s) on the scenarios of a search."""
    batch = ScenarioBatch(TUNING_SEED, scenarios, **{"scenario": "train", "threads": 1, **candidate.environment})
    return float(batch.play(candidate.controller).approach_time.mean())


def start_of(candidate: Candidate, approach_time: float) -> list[float]:
    """Return the parameters of the shipped controller of the same rule whose approach time (s) is nearest."""
    bistable = isinstance(Task(**candidate.environment).coupling, Bistable)
    weights = read_tuned(STARTS.get((candidate.rule, bistable), "ranged"))["weights"].values()
    nearest = min(weights, key=lambda tuned: abs(tuned["validation"]["approach_time"] - approach_time))
    return list(nearest["parameters"].values())


def _mean(rows: pl.DataFrame, name: str) -> float:
    return float(rows[name].to_numpy().mean())


def summary(frame: pl.DataFrame) -> list[dict[str, Any]]:
    """Return a row for each entry of the test set, in the order of the lines and their approach times."""
    paper = _mean(frame.filter(line=PAPER), "object_velocity")
    rows = []
    for labels, played in grid.groups(frame, *ENTRY):
        entry, velocity = dict(zip(ENTRY, labels, strict=True)), _mean(played, "object_velocity")
        numbers = ", ".join(f"{name} {with_unit(name, value)}" for name, value in json.loads(entry["design"]).items())
        rows.append({
            **{name: entry[name] for name in ("line", "seed", "allowed", "loss")},
            "approach_time": _mean(played, "approach_time"), "object_velocity": velocity,
            "lower": 1.0 - velocity / paper, "deflection": np.max(played["deflection"].to_numpy()),
            "stroke": np.max(played["stroke"].to_numpy()), "peak_force": float(np.quantile(played["peak_force"], 0.95)),
            "second_blow": np.mean(played["contact_count"].to_numpy() > 1),
            "missed": int(played["missed"].sum()), "excess": float(played["excess"][0]), "design": numbers,
            "controller": f"{entry['rule']}: {', '.join(f'{value:.6g}' for value in json.loads(entry['parameters']))}",
        })  # fmt: skip
    lines = list(dict.fromkeys(row["line"] for row in rows))
    return sorted(rows, key=lambda row: (lines.index(row["line"]), row["approach_time"]))


def sentence(row: dict[str, Any]) -> str:
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


def reduction(line: pl.DataFrame, paper: pl.DataFrame) -> Estimate:
    """Return by which share a line's V_p is below that of the paper's rule, at the mean approach time of that rule."""
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
    """Return approach time against V_p, each design of the front with its largest deflection in free flight."""
    figure = Figure(figsize=(8.4, 4.8))
    axes = figure.subplots()
    lines: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        lines.setdefault(row["line"], []).append(row)
    others = [name for name in lines if name not in (*LABELS, PAPER)]
    for name, colour in {**dict(zip(others, SERIES[2:], strict=False)), CHOSEN: TOOL, FRONT: OBJECT}.items():
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
    """Return what the plays on the test set say."""
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
    pad = f" with a pad of {options.pad}" if options.pad else ""
    answer = (
        f"Chosen: {numbers}{pad}. At the mean approach time of the paper's rule it leaves the object "
        f"{percent(gains[CHOSEN])} slower than the paper's rule with the paper's spring; in no fifth of the distances "
        f"less than {100 * least:.1f} %. Before the first touch its tool moves at most {1e3 * moved:.1f} mm against "
        f"the flange. As a set-up: {options.file.name}."
    )
    gained = [(LABELS.get(name, name), percent(gain)) for name, gain in gains.items()]
    scaled = [{**row, **{name: 1e3 * row[name] for name in ("deflection", "stroke")}} for row in rows]
    caption = ("Down and left is better; test scenarios, which no search has seen. Beside each design of the front: "
               "largest deflection of its coupling before the first touch. A line is one coupling with a controller "
               "searched for each of its approach times.")  # fmt: skip
    alt = "Mean approach time against mean V_p: designs, the chosen design, others and the paper's rule."
    read = "Read between the two approach times beside the paper's, or at the nearest; the scenarios are resampled."
    return Findings(answer, [
        Section("Approach time against V_p", [
            Picture("front", chart(rows), alt, caption),
            Table(read, ("coupling", "V_p lower at the paper's approach time, 95 % interval"), gained),
        ]),
        Section("All of them", [Table.of("", scaled, {
            "coupling": "{line}", "time allowed (paper's = 1)": "{allowed:.2f}", "approach (s)": "{approach_time:.4f}",
            "V_p (m/s)": "{object_velocity:.4f}", "lower": "{lower:.1%}", "deflection (mm)": "{deflection:.1f}",
            "stroke (mm)": "{stroke:.1f}", "peak force, 95 % (N)": "{peak_force:.0f}",
            "second blow": "{second_blow:.1%}", "missed": "{missed}", "design": "{design}",
        })]),
    ], {"summary": pl.DataFrame(rows, infer_schema_length=None)})  # fmt: skip


def study_of(options: DesignOptions) -> Study:
    """Return the study of checked options."""
    search_for = Search(options)
    return Study("design", f"Which coupling, with its best controller, for {options.arm.name}?", (
        Measurement("searches", search_for.searches, search, DEPENDS),
        Measurement("validation", search_for.validation, play, DEPENDS),
        Measurement("controllers", search_for.controllers, search, DEPENDS),
        Measurement("designs", search_for.designs, play, DEPENDS),
    ), partial(analyse, options), ("cma",))  # fmt: skip
