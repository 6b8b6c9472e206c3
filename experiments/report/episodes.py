"""The episodes of a report: each cell plays one controller of a `Matchup`; `Played` holds the results of a matchup."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import polars as pl
from numpy.typing import NDArray

from agents.baselines import PaperTrapezoid
from agents.evaluate.play import controller_of, pairs, scenario_batch_of
from agents.evaluate.scenario_batch import MEASURED, Episodes
from agents.policies import Controller
from experiments.lab import grid
from experiments.lab.statistics import Floats, Resamples
from experiments.lab.study import Cell, Measurement
from experiments.report.changes import changes
from experiments.report.matchups import PAPER, Contestant, Matchup
from impact_gym.task import Task
from impact_gym.task.scenario import FIELDS
from impact_gym.task.task import MISSED_COST

JSON = Mapping[str, Any]
FEWER = 500  # largest number of scenarios of a cell that changes the environment
HALVINGS = 9  # number of bisections of the logarithmic range of weights; enough for an error of 1 % in the weight
CALIBRATION_SCENARIOS = 500  # number of scenarios on which `weight_as_late` finds a weight
CHOOSING_SEED = 60_000_000  # first seed (a seed of ranges is added); tuning and evaluation use other seeds
CHOOSING_SCENARIOS = 2000
MISSED_TOO_OFTEN = 0.01  # share of missed objects above which the report claims no gain


def measurement(matchups: Sequence[Matchup], own: Iterable[str]) -> Measurement:
    """Return the measurement of all episodes; rows also depend on the user's modules `own`."""
    # the last default set-up has the longest cells, so its cells start first
    cells = [cell for matchup in reversed(matchups) for cell in cells_of(matchup)]
    depends = (*grid.PLAYED, grid.__name__, *own)
    return Measurement("episodes", lambda *_: cells, measured, depends)


def cells_of(matchup: Matchup) -> Iterator[Cell]:
    """Yield the cells of a matchup; the label `part` is the field of `Played` that gets the rows."""
    scenarios, environment, typical = matchup.scenarios, matchup.environment, matchup.typical
    some = {**scenarios, "count": min(FEWER, scenarios["count"])}

    def cell(
        part: str, who: Contestant, where: JSON, weights: Sequence[float], environment: JSON = environment
    ) -> Cell:
        labels = {"matchup": matchup.name, "part": part, "contestant": who.name}
        return Cell(labels, {"part": part, "controller": who.controller, "environment": environment,
                             "scenarios": where, "weights": list(weights)})  # fmt: skip

    for seed in matchup.seeds:
        yield cell("seeds", seed, scenarios, seed.weights)
    yield cell("as_late", matchup.policy, scenarios, matchup.policy.weights)
    for baseline in matchup.baselines:
        tuned = len(baseline.weights) > 1  # a tuned baseline can play at any weight
        weights = sorted({*baseline.weights, *matchup.weights, typical}) if tuned else baseline.weights
        yield cell("baselines", baseline, scenarios, weights)
    for contestant in (*matchup.baselines, matchup.policy):
        yield cell("choosing", contestant, choosing_scenarios(scenarios), [typical])
    if (bound := matchup.bound) is not None:
        searched = min(scenarios["count"], len(bound.controller["clairvoyant"][f"{bound.weights[0]:g}"]))
        first = {**scenarios, "count": searched}
        yield cell("bound", bound, first, bound.weights, {**environment, "privileged": True})
    for labels, changed, where in changes(matchup, some):
        for rival in matchup.rivals:
            labelled, arguments = cell("varied", rival, where, [typical], changed)
            yield Cell({**labelled, **labels}, arguments)


def measured(part: str, **arguments: Any) -> pl.DataFrame:
    """Return the rows of a cell."""
    if part == "as_late":
        arguments["weights"] = [weight_as_late(**arguments)]
    return grid.play(**arguments)


def weight_as_late(controller: JSON, environment: JSON, scenarios: JSON, weights: Sequence[float]) -> float:
    """Return the weight (m/s per s) within `weights` that gives at most the rule's mean approach time, found elsewhere.

    See `choosing_scenarios` for the scenarios.
    """
    choosing, task = choosing_scenarios(scenarios, CALIBRATION_SCENARIOS), Task(**environment)

    def mean_time(weight: float, player: Controller) -> float:
        return float(scenario_batch_of(choosing, weight, task).play(player).approach_time.mean())

    low, high = weights[0], weights[-1]
    target = mean_time(low, PaperTrapezoid().for_task(task))
    for _ in range(HALVINGS if high > low else 0):
        middle = math.sqrt(low * high)
        if mean_time(middle, controller_of(controller, middle, task)) > target:
            low = middle
        else:
            high = middle
    return high


def choosing_scenarios(scenarios: JSON, count: int = CHOOSING_SCENARIOS) -> dict[str, Any]:
    """Return other scenarios, to choose a controller or a weight: draws from the same ranges; a table is kept."""
    if "table" in scenarios:
        return dict(scenarios)
    ranges = scenarios.get("ranges") or pairs({"validation": "test"}.get(scenarios["set"], scenarios["set"]))
    return {"ranges": ranges, "seed": CHOOSING_SEED + scenarios.get("seed", 0), "count": count}


@dataclass
class Results:
    """Results of one contestant in one matchup."""

    weights: tuple[float, ...]  # time weights, m/s per s
    arrays: Mapping[str, NDArray[Any]]  # results (weights, scenarios) and fields of the scenarios (scenarios,), by name
    missed_cost: float = MISSED_COST  # m/s, charge for a missed object

    @classmethod
    def of_rows(cls, rows: pl.DataFrame, missed_cost: float) -> "Results":
        """Return the results in rows of `grid.play`, which are sorted by weight and episode."""
        weights = tuple(rows["weight"].unique(maintain_order=True).to_list())
        names = [name for name in (*MEASURED, *FIELDS) if name in rows.columns]
        shaped = {name: rows[name].to_numpy().reshape(len(weights), -1) for name in names if not rows[name].has_nulls()}
        return cls(weights, {name: each[0] if name in FIELDS else each for name, each in shaped.items()}, missed_cost)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.arrays[name]

    def at(self, weight: float) -> Episodes:
        """Return the results at a weight (m/s per s), or at the only weight of these results."""
        if len(self.weights) > 1 and weight not in self.weights:
            raise ValueError(f"there are no results at a time weight of {weight:g} m/s per s, only at {self.weights}")
        place = self.weights.index(weight) if weight in self.weights else 0
        results = {name: self[name][place] for name in MEASURED if name in self.arrays}
        return Episodes(**results, scenario={name: self[name] for name in FIELDS}, missed_cost=self.missed_cost)

    def loss(self, weight: float) -> Floats:
        """Costs (scenarios,) in m/s: V_p + weight * approach time + cost of a miss."""
        return self.at(weight).loss(weight)

    def means(self, weight: float) -> dict[str, Any]:
        """Mean approach time T (s), mean V_p of the touched objects (m/s), and number of missed objects at a weight."""
        episodes = self.at(weight)
        velocity = episodes.object_velocity[~episodes.missed]
        time, missed = float(episodes.approach_time.mean()), int(episodes.missed.sum())
        return {"T": time, "V": float(velocity.mean()) if velocity.size else math.nan, "missed": missed}

    @property
    def front(self) -> list[tuple[float, float]]:
        """Mean approach time (s) and V_p (m/s) at each weight, the shortest time first."""
        return sorted((mean["T"], mean["V"]) for mean in map(self.means, self.weights))


@dataclass
class Played:
    """All results of one matchup; the keys of the dicts are names of contestants."""

    matchup: Matchup
    seeds: dict[str, Results] = field(default_factory=dict)
    as_late: dict[str, Results] = field(default_factory=dict)  # policy, at about the rule's mean time
    baselines: dict[str, Results] = field(default_factory=dict)
    choosing: dict[str, Results] = field(default_factory=dict)  # in `choosing_scenarios`
    bound: dict[str, Results] = field(default_factory=dict)  # of the clairvoyant search; empty: there was none
    varied: pl.DataFrame = field(default_factory=pl.DataFrame)  # rows in changed environments, with labels of `changes`

    @classmethod
    def of_rows(cls, matchup: Matchup, rows: pl.DataFrame) -> "Played":
        """Return the results of a matchup in the rows of `measurement`."""
        rows, charge = rows.filter(matchup=matchup.name), grid.missed_cost(matchup.environment)
        played = cls(matchup, varied=rows.filter(part="varied"))
        for (part, name), each in rows.filter(pl.col("part") != "varied").group_by(
            "part", "contestant", maintain_order=True
        ):
            getattr(played, str(part))[name] = Results.of_rows(each, charge)
        return played

    @property
    def paper(self) -> Results:
        """The paper's rule."""
        return self.baselines[PAPER]

    @property
    def rival(self) -> Results:
        """The baseline `Matchup.rival`."""
        return self.baselines[self.matchup.rival.name]

    @property
    def policy(self) -> Results:
        """The median seed."""
        return self.seeds[self.matchup.chosen]

    @property
    def runs(self) -> dict[str, Results]:
        """The baselines and the median seed."""
        return {**self.baselines, self.matchup.chosen: self.policy}

    @property
    def searched(self) -> Results | None:
        """The clairvoyant search."""
        return next(iter(self.bound.values()), None)

    @property
    def count(self) -> int:
        """Number of scenarios."""
        return self.paper["missed"].shape[1]

    @property
    def resamples(self) -> Resamples:
        """Resamples of the scenarios; they are the same for all contestants."""
        return Resamples(self.count)
