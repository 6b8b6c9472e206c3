"""One search over design and controller together, for the lowest V_p with a limited mean approach time."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from agents.baselines import RULES
from agents.baselines.cmaes import Losses, minimise
from agents.baselines.rule import Floats, Rule, ranges_for
from agents.evaluate.scenario_batch import RESULTS, TUNING_SEED, Episodes, ScenarioBatch, Travel
from experiments.design.pads import Pad
from experiments.design.variables import SearchVariable, as_built
from impact_gym.parameters import SI, Options
from impact_gym.task import Task

RTOL = 1e-5  # relative tolerance of the simulation in a search
PENALTY = 2.0  # m/s, cost of exceeding a limit or the allowed mean approach time by 100 %
MARGIN = 1.2  # a search draws design errors up to MARGIN * tolerance, because few scenarios contain no rare extremes
CONTACT = ("contact_stiffness", "restitution")
WITHIN = 0.95  # fraction of the episodes in which the peak force must be at most the limit


@dataclass(frozen=True)
class Limits(Options):
    """Limits that a design must keep; None: no limit."""

    deflection: Annotated[float | None, SI("m", above=0)] = 0.05
    """Largest deflection before the first touch, m: motion of the tool relative to the flange since the start."""
    stroke: Annotated[float | None, SI("m", above=0)] = None
    """Largest deflection in the whole episode, m."""
    peak_force: Annotated[float | None, SI("N", above=0)] = None
    """Largest contact force, N. At most 5 % of the scenarios may exceed this limit."""
    touched_once: Annotated[float | None, SI("-", above=0, at_most=1)] = None
    """Smallest fraction of scenarios in which the tool touches the object at most once, such as 0.95."""

    def excess(self, played: Episodes, travel: Travel, count: int = 1, pad: Pad | None = None) -> Floats:
        """Return for each candidate (count,) the sum of (value / limit - 1) over all exceeded limits.

        `played` and `travel` hold the same number of episodes for each candidate, one candidate after another.
        `touched_once` limits the fraction of scenarios with several contacts. In 95 % of the scenarios, the penetration
        of a `pad` must be at most half the pad's radius (validity of Hertz's law).
        """
        force, deflection, stroke, contacts = (
            values.reshape(count, -1)
            for values in (played.peak_force, travel.deflection, travel.stroke, played.contact_count)
        )
        peak = np.quantile(force, WITHIN, axis=1)
        limited = [
            (self.deflection, deflection.max(axis=1)),
            (self.stroke, stroke.max(axis=1)),
            (self.peak_force, peak),
            (0.5 * pad.radius, (peak / pad.stiffness) ** (2.0 / 3.0)) if pad else (None, peak),
            (self.touched_once and max(1.0 - self.touched_once, 1e-3), (contacts > 1).mean(axis=1)),
        ]
        return sum((np.maximum(value / limit - 1.0, 0.0) for limit, value in limited if limit), np.zeros(count))


@dataclass(frozen=True)
class Candidate:
    """A design (coupling, tool mass, pad) with a controller; the fields can be written as JSON."""

    environment: Mapping[str, Any]  # arguments of the environment
    rule: str  # name of the controller's rule
    parameters: Sequence[float] = ()  # parameters of the rule
    design: Mapping[str, float] = field(default_factory=dict)  # numbers of the design, by name
    material: str = ""  # material of the pad on the tool; empty: no pad

    @cached_property
    def task(self) -> Task:
        """The environment's task."""
        return Task(**self.environment)

    @cached_property
    def pad(self) -> Pad | None:
        """The pad on the tool; None: no pad."""
        return Pad.of(self.material) if self.material else None

    def controller(self, parameters: ArrayLike | None = None) -> Rule:
        """Return the controller with `parameters`, (k,) or (rows, k); None: the candidate's own parameters."""
        given = self.parameters if parameters is None else parameters
        return RULES[self.rule].of(given, ranges_for(self.task)).for_task(self.task)

    def contact(self, stage: ScenarioBatch) -> dict[str, Floats]:
        """Return contact stiffness (N/m^1.5) and restitution of each scenario with the pad; empty without a pad."""
        if not self.pad:
            return {}
        scenario = stage.play(self.controller()).scenario  # `play` draws the scenarios
        return dict(zip(CONTACT, self.pad.contact(*(scenario[name] for name in CONTACT)), strict=True))


def objective(
    candidate: Candidate, variables: Sequence[SearchVariable], approach_time: float, limits: Limits, tolerance: float,
    scenarios: int, population: int,
) -> Losses:  # fmt: skip
    """Return a function from candidates (population, 1, k) to losses (population, 1), m/s; see `search`."""
    task = candidate.task.changed({"rtol": RTOL})
    stage = ScenarioBatch(TUNING_SEED, scenarios, task, copies=population, lenient=True, threads=1)
    contact = candidate.contact(ScenarioBatch(TUNING_SEED, scenarios, task, threads=1))
    off, rng = MARGIN * tolerance, np.random.default_rng((TUNING_SEED, 1))
    errors = rng.uniform(1.0 - off, 1.0 + off, (len(variables), scenarios))  # factors for the design's numbers

    def losses(candidates: Floats) -> Floats:
        searched, of_rule = np.split(candidates[:, 0], [len(variables)], axis=1)
        drawn = zip(variables, searched.T, errors, strict=True)
        record = {each.name: np.outer(each.value(values), factors).ravel() for each, values, factors in drawn}
        record |= {name: np.tile(values, population) for name, values in contact.items()}
        travel = Travel(population * scenarios)
        played = stage.play(candidate.controller(np.repeat(of_rule, scenarios, axis=0)), record, travel)
        velocity = np.where(played.missed, played.missed_cost, np.nan_to_num(played.object_velocity))
        velocity, time = (values.reshape(population, -1).mean(axis=1) for values in (velocity, played.approach_time))
        late = np.maximum(time / approach_time - 1.0, 0.0)
        excess = limits.excess(played, travel, population, candidate.pad)
        return (velocity + PENALTY * (late + excess))[:, None]

    return losses


def search(
    candidate: Mapping[str, Any], variables: Sequence[Sequence[Any]], approach_time: float,
    limits: Mapping[str, float | None], tolerance: float, scenarios: int, budget: int, population: int, seed: int,
) -> list[dict[str, Any]]:  # fmt: skip
    """Search, and return one row: the best `design` and the rule's `parameters` as JSON, and the `loss` (m/s).

    `candidate`, `limits` and each of `variables` have the fields of `Candidate`, `Limits` and `SearchVariable`. The
    candidate's environment has a range for each variable. The search starts at the candidate's `parameters` and the
    start of each `SearchVariable.parameter`. `approach_time` (s) limits the mean approach time. For `tolerance` to
    `population` see `DesignOptions`.
    """
    begin, free = Candidate(**candidate), [SearchVariable(*each) for each in variables]
    of_rule = zip(RULES[begin.rule].limited(ranges_for(begin.task)), begin.parameters, strict=True)
    parameters = [variable.parameter() for variable in free]
    parameters += [parameter._replace(start=start) for parameter, start in of_rule]
    losses = objective(begin, free, approach_time, Limits(**limits), tolerance, scenarios, population)
    best = minimise(losses, tuple(parameters), 1, population, -(-budget // population), seed)
    searched, controller = np.split(best.parameters[0], [len(free)])
    design = {each.name: float(each.value(value)) for each, value in zip(free, searched, strict=True)}
    found = {"design": json.dumps(design), "parameters": json.dumps(controller.tolist())}
    return [{**found, "loss": float(best.loss[0])}]


def play(candidate: Mapping[str, Any], tolerance: float, limits: Mapping[str, Any]) -> pl.DataFrame:
    """Play a candidate on the test set; return a row for each scenario.

    `candidate` and `limits` have the fields of `Candidate` and `Limits`. In each scenario, each number of the design
    has a relative error of at most `tolerance`. All rows have the same `excess`: `Limits.excess` of all scenarios.
    """
    player = Candidate(**candidate)
    stage = ScenarioBatch.of("test", None, player.task.changed(as_built(player.design, tolerance)), threads=1)
    travel = Travel(stage.count)
    played = stage.play(player.controller(), player.contact(stage), travel)
    columns = {name: getattr(played, name) for name in RESULTS} | played.scenario
    columns |= {"deflection": travel.deflection, "stroke": travel.stroke}
    excess = float(Limits(**limits).excess(played, travel, pad=player.pad)[0])
    return pl.DataFrame(columns).with_columns(excess=excess)
