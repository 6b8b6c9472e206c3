"""The study of `impact-gym design`: searches, choice on the validation set, results on the test set.

For each approach time, the front has the best design of all seeds, as judged on the validation set. The chosen design
is the front's design at the approach time nearest to that of the paper's rule. For the other approach times only the
controller of the chosen design is searched again. Nothing is chosen on the test set.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np
import polars as pl

from agents.baselines.tuned import read_tuned
from agents.evaluate.scenario_batch import TUNING_SEED, ScenarioBatch
from experiments.design.findings import ENTRY, analyse, mean
from experiments.design.options import CHOSEN, FRONT, PAPER, DesignOptions, with_papers_spring
from experiments.design.search import MARGIN, PENALTY, Candidate, play, search
from experiments.design.variables import as_built
from experiments.lab import grid
from experiments.lab.study import Cell, Frames, Measurement, Study
from impact_gym.scene import Bistable
from impact_gym.task import Task

DEPENDS = (
    "impact_gym", "agents.baselines", "agents.evaluate", "agents.setups",
    *(f"experiments.design.{name}" for name in ("variables", "limits", "pads")),
)  # fmt: skip
PAPERS_RULE = "ConstantSpeed", [1.0, 8.0, 8.0]  # paper, section 3.2
STARTS = {("BlindProfile", False): "blind-profile", ("BlindProfile", True): "bistable-blind-profile"}
"""Tuned baseline at which a search starts, by rule and by whether the coupling is bistable; by default "ranged"."""


@dataclass(frozen=True)
class Entry:
    """A candidate on a line of the chart of V_p against approach time."""

    line: str  # PAPER, FRONT, CHOSEN, or a name of `DesignOptions.others`
    allowed: float  # largest mean approach time, as a multiple of that of the paper's rule
    candidate: Candidate
    seed: int = 1
    loss: float = np.nan  # m/s, mean V_p in the search, plus penalties for exceeded limits and time


@dataclass(frozen=True)
class Search:
    """The cells of each table of the study; they depend on the options and on earlier tables."""

    options: DesignOptions

    @property
    def paper(self) -> Entry:
        """The paper's rule with the paper's spring."""
        return Entry(PAPER, 1.0, Candidate(with_papers_spring(self.options.arm.environment), *PAPERS_RULE))

    def searches(self, _: bool, __: Frames) -> Iterator[Cell]:
        """Yield cells that search designs, and controllers of the compared couplings."""
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
        """Yield cells that play the paper's rule and the designs of all seeds on the validation set."""
        yield from self._played([self.paper, *self._front_of(frames)], "validation")

    def controllers(self, _: bool, frames: Frames) -> Iterator[Cell]:
        """Yield cells that search the chosen design's controller for each approach time but `typical`."""
        chosen = self.chosen(frames)
        built = replace(chosen.candidate, design={})  # its environment already has the design's numbers
        others = [time for time in self.options.times if time != self.options.typical]
        yield from self._searched([Entry(CHOSEN, time, built) for time in others], chosen.candidate.parameters)

    def designs(self, _: bool, frames: Frames) -> Iterator[Cell]:
        """Yield cells that play paper's rule, front, chosen design and compared couplings on the test set."""
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
        """Return the front's design at the approach time `typical`; its environment draws the numbers as built."""
        options = self.options
        entry = next(entry for entry in self.front(frames) if entry.allowed == options.typical)
        built = as_built(entry.candidate.design, MARGIN * options.search.tolerance)
        environment = Task(**options.arm.environment).changed(built).arguments()
        return replace(entry, line=CHOSEN, candidate=replace(entry.candidate, environment=environment))

    def front(self, frames: Frames) -> list[Entry]:
        """Return for each approach time the design with the lowest V_p on the validation set.

        Missed objects, exceeded limits and a too long approach time are penalised as in a search.
        """
        played = dict(grid.groups(frames["validation"], "line", "allowed", "seed"))
        paper = mean(played[PAPER, 1.0, 1], "approach_time")

        def cost(entry: Entry) -> float:
            rows = played[entry.line, entry.allowed, entry.seed]
            late = mean(rows, "approach_time") / (entry.allowed * paper) - 1.0
            charged = grid.missed_cost(entry.candidate.environment)
            velocity = rows.select(pl.when("missed").then(charged).otherwise("object_velocity").alias("charged"))
            return mean(velocity, "charged") + PENALTY * (max(late, 0.0) + mean(rows, "excess"))

        entries = self._front_of(frames)
        return [min((e for e in entries if e.allowed == allowed), key=cost) for allowed in self.options.times]

    def _front_of(self, frames: Frames) -> list[Entry]:
        """Return an entry for each searched design: every approach time and every seed."""
        designs = Candidate(self.options.searched, self.options.rule, pad=self.options.pad)
        return [
            Entry(FRONT, row["allowed"],
                  replace(designs, design=json.loads(row["design"]), parameters=json.loads(row["parameters"])),
                  row["seed"], row["loss"])
            for row in frames["searches"].filter(line=FRONT).to_dicts()
        ]  # fmt: skip

    def _searched(self, entries: Sequence[Entry], start: Sequence[float] = ()) -> Iterator[Cell]:
        """Yield a cell that searches each entry; controllers start at the parameters `start`, or else at shipped ones.

        For entries of FRONT, design and controller are searched; for all others only the controller.
        """
        options, papers_rule = self.options, self.paper.candidate
        batch = ScenarioBatch(TUNING_SEED, options.search.scenarios, papers_rule.task, threads=1)
        paper = float(batch.play(papers_rule.controller()).approach_time.mean())
        for entry in entries:
            time = entry.allowed * paper
            begin = replace(entry.candidate, parameters=list(start or start_of(entry.candidate, time)))
            variables = options.variables if entry.line == FRONT else []
            yield Cell({name: getattr(entry, name) for name in ("line", "allowed", "seed")}, {
                "candidate": asdict(begin), "variables": list(map(list, variables)), "approach_time": time,
                "limits": asdict(options.limits_of(entry.line)), "budget": asdict(options.search), "seed": entry.seed,
            })  # fmt: skip

    def _played(self, entries: Sequence[Entry], name: str) -> Iterator[Cell]:
        """Yield a cell that plays each entry on the frozen set `name`."""
        for entry in entries:
            candidate, limits = entry.candidate, asdict(self.options.limits_of(entry.line))
            written = json.dumps(dict(candidate.design)), json.dumps(list(candidate.parameters))
            values = (entry.line, entry.allowed, entry.seed, entry.loss, candidate.rule, *written)
            yield Cell(dict(zip(ENTRY, values, strict=True)), {
                "candidate": asdict(candidate), "limits": limits, "name": name,
                "tolerance": self.options.search.tolerance,
            })  # fmt: skip


def start_of(candidate: Candidate, approach_time: float) -> list[float]:
    """Return the parameters of the shipped tuning whose approach time on the validation set is nearest (s)."""
    bistable = isinstance(candidate.task.coupling, Bistable)
    weights = read_tuned(STARTS.get((candidate.rule, bistable), "ranged"))["weights"].values()
    nearest = min(weights, key=lambda tuned: abs(tuned["validation"]["approach_time"] - approach_time))
    return list(nearest["parameters"].values())


def study_of(options: DesignOptions) -> Study:
    """Return the study for options that `DesignOptions.checked` returned."""
    search_for = Search(options)
    return Study("design", f"Which coupling, with its best controller, for {options.arm.name}?", (
        Measurement("searches", search_for.searches, search, DEPENDS),
        Measurement("validation", search_for.validation, play, DEPENDS),
        Measurement("controllers", search_for.controllers, search, DEPENDS),
        Measurement("designs", search_for.designs, play, DEPENDS),
    ), partial(analyse, options), ("cma",))  # fmt: skip
