"""The episodes of a report: each cell plays one controller of a `Comparison`; their results: `ComparisonResults`."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from agents.baselines import PaperTrapezoid
from agents.evaluate.scenario_batch import MEASURED, TEST_SEED, Episodes
from agents.evaluate.specs import controller_of, pairs, scenario_batch_of
from agents.policies import Controller
from agents.setups.evaluation import Change, variants
from experiments.lab import grid
from experiments.lab.statistics import Front, Resamples
from experiments.lab.study import Cell
from experiments.report.comparisons import PAPER, Comparison, Contestant
from impact_gym.quantities import QUANTITIES
from impact_gym.task import Task, evaluation_sets
from impact_gym.task.scenario import FIELDS

DEPENDS = (*grid.PLAYED, grid.__name__)  # modules on which the results of `measured` depend
JSON = Mapping[str, Any]
FEWER = 500  # largest number of scenarios of a cell that changes the environment
HALVINGS = 9  # number of bisections of the logarithmic range of weights; enough for an error of 1 % in the weight
CALIBRATION_SCENARIOS = 500  # number of scenarios on which `weight_at_rule_time` finds a weight
SELECTION_SEED = 60_000_000  # first seed (a seed of ranges is added); tuning and evaluation use other seeds
SELECTION_SCENARIOS = 2000
MISSED_TOO_OFTEN = 0.01  # share of missed objects above which the report claims no gain
WORDS = {  # plain names of some arguments; `factor` names all arguments
    "force_noise": "noise of the force sensor",
    "range_noise": "error of the distance estimate",
    "robot": "compliant robot",
    "scenario": "objects outside the training ranges",
}
SIDES = {  # what objects below and beyond the set-up's range are called
    "distance": ("nearer", "farther"), "object_mass": ("lighter", "heavier"),
    "contact_stiffness": ("softer", "stiffer"), "restitution": ("less elastic", "more elastic"),
}  # fmt: skip
SHOWN = {"s": ("ms", 1e3), "m": ("mm", 1e3), "%": ("%", 100.0)}  # for some units: the printed unit, and the factor


def cells_of(comparison: Comparison) -> Iterator[Cell]:
    """Yield the cells of a comparison; the label `part` is the field of `ComparisonResults` that gets the rows."""
    scenarios, environment, typical = comparison.scenarios, comparison.environment, comparison.typical

    def cell(
        part: str, who: Contestant, where: JSON, weights: Sequence[float], arguments: JSON = environment, **more: Any
    ) -> Cell:
        labels = {"comparison": comparison.name, "part": part, "contestant": who.name, **more}
        return grid.cell(labels, who.controller, arguments, where, weights, part=part)

    for seed in comparison.seeds:
        yield cell("seeds", seed, scenarios, seed.weights)
    of_policy = comparison.policy.weights
    yield cell("at_rule_time", comparison.policy, scenarios, of_policy)
    compared = {*comparison.evaluation.weights} & {*of_policy} or of_policy
    for baseline in comparison.baselines:
        tuned = len(baseline.weights) > 1  # a tuned baseline can play at any weight
        weights = sorted({*baseline.weights, *compared, typical}) if tuned else baseline.weights
        yield cell("baselines", baseline, scenarios, weights)
    for contestant in (*comparison.baselines, comparison.policy):
        yield cell("selection", contestant, selection_scenarios(scenarios), [typical])
    if (bound := comparison.bound) is not None:
        first = {**scenarios, "count": len(next(iter(bound.controller["clairvoyant"].values())))}
        yield cell("bound", bound, first, bound.weights, {**environment, "privileged": True})
    for change in variants(comparison.evaluation, environment):  # one argument of the environment
        where = {**scenarios, "count": min(FEWER, scenarios["count"])}
        if change.scenarios:
            where = {"set": change.scenarios,
                     "count": min(where["count"], evaluation_sets.load(change.scenarios).count)}  # fmt: skip
        changed = {**environment, **comparison.evaluation.nominal} if change.same else change.environment
        named, value = factor(change.argument, changed.get("alarm") == "reading"), setting(change)
        for name, (low, high) in change.ranges.items():
            ranges, seed = ranges_of(scenarios), scenarios.get("seed", TEST_SEED)
            where = {"ranges": {**ranges, name: (low, high)}, "seed": seed, "count": where["count"]}
            if high <= ranges[name][0] or low >= ranges[name][1]:
                named = f"objects {SIDES[name][low >= ranges[name][1]]} than in the set-up"
        labels = {"change": f"{named}: {value}", "factor": named, "setting": value,
                  "same": change.same, "value": change.value}  # fmt: skip
        for rival in comparison.rivals:
            yield cell("varied", rival, where, [typical], changed, **labels)


def factor(argument: str, by_reading: bool = False) -> str:
    """Return the plain name of an argument; `by_reading`: whether readings of the force sensor raise the alarm."""
    argument = argument.removeprefix("scenario.")
    words = WORDS.get(argument) or (QUANTITIES[argument].words if argument in QUANTITIES else argument)
    alarm = "which raises the alarm" if by_reading else "the alarm is a switch without noise"
    return f"{words} ({alarm})" if argument == "force_noise" else words


def setting(change: Change) -> str:
    """Return the changed value with its unit; if the value is a range or not a number, the change's label."""
    if change.ranges or not np.isfinite(change.value):
        return change.label
    unit = "%" if change.multiple else QUANTITIES[change.argument].unit
    name, scale = SHOWN.get(unit, (unit, 1.0))
    return f"{scale * change.value:g} {name}"


def measured(part: str, **arguments: Any) -> pl.DataFrame:
    """Return the rows of a cell."""
    if part == "at_rule_time":
        arguments["weights"] = [weight_at_rule_time(**arguments)]
    return grid.play(**arguments)


def weight_at_rule_time(controller: JSON, environment: JSON, scenarios: JSON, weights: Sequence[float]) -> float:
    """Return the weight (m/s per s) within `weights` that gives at most the rule's mean approach time, found elsewhere.

    See `selection_scenarios` for the scenarios.
    """
    elsewhere, task = selection_scenarios(scenarios, CALIBRATION_SCENARIOS), Task(**environment)

    def mean_time(weight: float, player: Controller) -> float:
        return float(scenario_batch_of(elsewhere, weight, task).play(player).approach_time.mean())

    low, high = weights[0], weights[-1]
    target = mean_time(low, PaperTrapezoid().for_task(task))
    for _ in range(HALVINGS if high > low else 0):
        middle = math.sqrt(low * high)
        late = mean_time(middle, controller_of(controller, middle, task)) > target
        low, high = (middle, high) if late else (low, middle)
    return high


def ranges_of(scenarios: JSON) -> Mapping[str, Sequence[float]]:
    """Return the ranges from which scenarios are drawn, by field; of a table, the ranges of its columns."""
    if "table" in scenarios:
        return {name: (min(column), max(column)) for name, column in scenarios["table"].items()}
    return pairs(scenarios.get("ranges") or {"validation": "test"}.get(scenarios["set"], scenarios["set"]))


def selection_scenarios(scenarios: JSON, count: int = SELECTION_SCENARIOS) -> dict[str, Any]:
    """Return other scenarios, to choose a controller or a weight: draws from the same ranges; a table is kept."""
    if "table" in scenarios:
        return dict(scenarios)
    return {"ranges": ranges_of(scenarios), "seed": SELECTION_SEED + scenarios.get("seed", 0), "count": count}


class Results(dict[float, Episodes]):
    """The episodes of one contestant at each time weight, m/s per s; those at its only weight serve for any weight."""

    def __missing__(self, weight: float) -> Episodes:
        if len(self) != 1:
            raise KeyError(f"there are no results at a time weight of {weight:g} m/s per s, only at {[*self]}")
        return next(iter(self.values()))

    def stacked(self, name: str) -> NDArray[Any]:
        """Return a field of `Episodes` as an array (weights, scenarios)."""
        return np.array([getattr(episodes, name) for episodes in self.values()])

    def means(self, weight: float) -> dict[str, Any]:
        """Mean approach time T (s), mean V_p of the touched objects (m/s), and number of missed objects at a weight."""
        episodes = self[weight]
        velocity = episodes.object_velocity[~episodes.missed]
        time, missed = float(episodes.approach_time.mean()), int(episodes.missed.sum())
        return {"T": time, "V": float(velocity.mean()) if velocity.size else math.nan, "missed": missed}

    @property
    def front(self) -> list[tuple[float, float]]:
        """Mean approach time (s) and V_p (m/s) at each weight, the shortest time first."""
        return sorted((mean["T"], mean["V"]) for mean in map(self.means, self))


def front_of(runs: Sequence[Results], resamples: Resamples) -> Front:
    """Return the front of the seeds in the first `resamples.scenarios` scenarios; V_p: mean of the touched objects."""
    names = ("approach_time", "object_velocity", "missed")
    stacked = ([run.stacked(name)[:, : resamples.scenarios] for run in runs] for name in names)
    times, velocities, missed = map(np.array, stacked)
    return resamples.means(times), resamples.means_where(velocities, ~missed)


@dataclass
class ComparisonResults:
    """All results of one comparison; the keys of the dicts are names of contestants."""

    comparison: Comparison
    seeds: dict[str, Results] = field(default_factory=dict)
    at_rule_time: dict[str, Results] = field(default_factory=dict)  # policy, at about the rule's mean time
    baselines: dict[str, Results] = field(default_factory=dict)
    selection: dict[str, Results] = field(default_factory=dict)  # in `selection_scenarios`
    bound: dict[str, Results] = field(default_factory=dict)  # of the clairvoyant search; empty: there was none
    varied: pl.DataFrame = field(default_factory=pl.DataFrame)  # rows in changed environments, see `cells_of`

    @classmethod
    def of_rows(cls, comparison: Comparison, rows: pl.DataFrame) -> "ComparisonResults":
        """Return the results of a comparison in the rows of `measured`."""
        rows, varied = rows.filter(comparison=comparison.name), pl.col("part") == "varied"
        results, charge = cls(comparison, varied=rows.filter(varied)), Task(**comparison.environment).missed_cost
        for (part, name, weight), each in grid.groups(rows.filter(~varied), "part", "contestant", "weight"):
            measured = (column for column in MEASURED if column in rows.columns and not each[column].has_nulls())
            arrays = {column: each[column].to_numpy() for column in measured}
            scenario = {field: each[field].to_numpy() for field in FIELDS}
            of_contestant = getattr(results, part).setdefault(name, Results())
            of_contestant[weight] = Episodes(**arrays, scenario=scenario, missed_cost=charge)
        return results

    @property
    def paper(self) -> Results:
        """The paper's rule."""
        return self.baselines[PAPER]

    @property
    def policy(self) -> Results:
        """The median seed."""
        return self.seeds[self.comparison.chosen]

    @property
    def runs(self) -> dict[str, Results]:
        """The baselines and the median seed."""
        return {**self.baselines, self.comparison.chosen: self.policy}

    @property
    def resamples(self) -> Resamples:
        """Resamples of the scenarios; they are the same for all contestants."""
        return Resamples(self.policy.stacked("missed").shape[1])
