"""The study of `impact-gym design`: searches, choice, results on the test set.

For each approach time, `front` takes the design (of any seed) with the lowest loss in its search. The chosen design is
the front's design at the approach time nearest to that of the paper's rule. For each other approach time, the study
searches for a new controller for the chosen design. No choice uses the test set.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import polars as pl

from agents.baselines.tuned import read_tuned
from agents.evaluate.scenario_batch import TUNING_SEED, ScenarioBatch
from experiments.design.findings import ENTRY, analyse
from experiments.design.options import CHOSEN, FRONT, PAPER, SPRING, DesignOptions
from experiments.design.search import MARGIN, Candidate, Limits, play, search
from experiments.design.variables import as_built
from experiments.lab.study import Cell, Frames, Measurement, Study
from impact_gym.couplings import Bistable

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

    def front(self, frames: Frames) -> list[Row]:
        """Return for each approach time the design with the lowest loss."""
        best = frames["searches"].filter(line=FRONT).sort("allowed", "loss")
        return best.unique("allowed", keep="first", maintain_order=True).to_dicts()

    def _searched(self, rows: Iterable[Row]) -> Iterator[Cell]:
        options, papers_rule = self.options, self.candidate(PAPERS_RULE)
        batch = ScenarioBatch(TUNING_SEED, options.scenarios, papers_rule.task, threads=1)
        paper = float(batch.play(papers_rule.controller()).approach_time.mean())
        for row in rows:
            candidate, time = self.candidate(row), row["allowed"] * paper
            start = list(candidate.parameters) or start_of(candidate, time)
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


def start_of(candidate: Candidate, approach_time: float) -> list[float]:
    """Return a shipped baseline's parameters at the time weight whose approach time is nearest `approach_time` (s)."""
    blind = "bistable-blind-profile" if isinstance(candidate.task.coupling, Bistable) else "blind-profile"
    weights = read_tuned(blind if candidate.rule == "BlindProfile" else "ranged")["weights"].values()
    nearest = min(weights, key=lambda tuned: abs(tuned["validation"]["approach_time"] - approach_time))
    return list(nearest["parameters"].values())
