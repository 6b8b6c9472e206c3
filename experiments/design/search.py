"""One search over design and controller together, for the least V_p with a limited mean approach time.

A design must be judged with its own best controller. Finding that takes a few hundred generations. One search over both
takes about twice as many; a search of designs would need a search of the controller for each design.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from agents.baselines.cmaes import Losses, minimise
from agents.baselines.rule import Floats, Rule
from agents.baselines.tuned import RULES
from agents.evaluate import RESULTS, TUNING_SEED, ScenarioBatch, Travel
from experiments.design.limits import Limits, kinetic
from experiments.design.pads import Pad, on_pad, pad_of
from experiments.design.variables import SearchVariable, as_built
from impact_gym.scene import Bistable
from impact_gym.task import Task
from impact_gym.validation import number, whole

RTOL = 1e-5  # of the simulation while searching: V_p is within 1e-6 m/s
PENALTY = 2.0
"""m/s for each share by which a limit or the approach time is exceeded. V_p gains less by it, so that the optimum is
within the limits."""
MARGIN = 1.2
"""Factor on the tolerance in a search. A search uses few scenarios: a mechanism that barely holds its tool in all of
them lets go in others."""
CONTACT = ("contact_stiffness", "restitution")


@dataclass(frozen=True)
class Candidate:
    """One coupling with one controller, as plain data."""

    environment: Mapping[str, Any]  # arguments of the environment
    rule: str  # name of the controller
    parameters: Sequence[float] = ()  # of the controller
    design: Mapping[str, float] = field(default_factory=dict)  # numbers that differ from the environment
    pad: str = ""  # material of the pad on the tool; empty: no pad

    @cached_property
    def task(self) -> Task:
        """The environment's task."""
        return Task(**self.environment)

    @cached_property
    def soft(self) -> Pad | None:
        """The pad on the tool."""
        return pad_of(self.pad) if self.pad else None

    def controller(self, parameters: ArrayLike | None = None) -> Rule:
        """Return the controller, with its own or with other parameters, (k,) or (rows, k)."""
        return RULES[self.rule].of(self.parameters if parameters is None else parameters).for_task(self.task)

    def contact(self, stage: ScenarioBatch) -> dict[str, Floats]:
        """Return stiffness and restitution of each scenario's contact through the pad; nothing without a pad."""
        if not self.pad:
            return {}
        scenario = stage.play(self.controller()).scenario  # a play draws the scenarios
        return dict(zip(CONTACT, on_pad(self.pad, *(scenario[name] for name in CONTACT)), strict=True))

    def released(self, design: Mapping[str, Floats], count: int) -> Floats:
        """Return the energy (J) that each of `count` designs releases from its front stop to its rear stop (count,)."""
        coupling = self.task.coupling
        if not isinstance(coupling, Bistable):
            return np.zeros(count)
        numbers = {name.rpartition(".")[2]: values for name, values in design.items() if name.startswith("coupling.")}
        each = ({name: float(values[k]) for name, values in numbers.items()} for k in range(count))
        built = [replace(coupling, **changes) for changes in each]
        return np.array([one.energy(one.rest) - one.energy(one.rear_stop) for one in built])


@dataclass(frozen=True)
class SearchBudget:
    """Size of a search."""

    tolerance: float = 0.05
    """Share by which each number of a design may differ when it is built. In search and test it differs in each
    scenario; without a tolerance the search finds mechanisms that barely hold their tool."""
    scenarios: int = 500
    """Training scenarios for each candidate."""
    budget: int = 7200
    """Candidates of each search."""
    population: int = 18
    """Candidates of a generation, which are played together."""

    def __post_init__(self) -> None:
        number("tolerance", self.tolerance, "-", at_least=0.0, at_most=0.5)
        for name, least in (("scenarios", 1), ("budget", 1), ("population", 4)):
            whole(name, getattr(self, name), at_least=least)


def objective(
    candidate: Candidate,
    variables: Sequence[SearchVariable],
    approach_time: float,
    limits: Limits,
    budget: SearchBudget,
) -> Losses:
    """Return a function from candidates (population, 1, k), designs and controllers, to losses (population, 1), m/s.

    All are played in the same training scenarios. Arguments as in `search`.
    """
    population, scenarios = budget.population, budget.scenarios
    task = candidate.task.changed({"rtol": RTOL})
    stage = ScenarioBatch(TUNING_SEED, scenarios, task, copies=population, lenient=True, threads=1)
    contact = candidate.contact(ScenarioBatch(TUNING_SEED, scenarios, task, threads=1))
    off, rng = MARGIN * budget.tolerance, np.random.default_rng((TUNING_SEED, 1))
    errors = rng.uniform(1.0 - off, 1.0 + off, (len(variables), scenarios))  # factors, as built

    def losses(candidates: Floats) -> Floats:
        searched, of_rule = np.split(candidates[:, 0], [len(variables)], axis=1)
        design = {each.name: each.value(searched[:, k]) for k, each in enumerate(variables)}
        built = zip(design.items(), errors, strict=True)
        record = {name: np.outer(values, factors).ravel() for (name, values), factors in built}
        record |= {name: np.tile(values, population) for name, values in contact.items()}
        travel = Travel(population * scenarios)
        played = stage.play(candidate.controller(np.repeat(of_rule, scenarios, axis=0)), record, travel)
        velocity = np.where(played.missed, played.missed_cost, np.nan_to_num(played.object_velocity))
        velocity, time = (values.reshape(population, -1).mean(axis=1) for values in (velocity, played.approach_time))
        late = np.maximum(time / approach_time - 1.0, 0.0)
        excess = limits.excess(played, travel, candidate.released(design, population), candidate.soft)
        return (velocity + PENALTY * (late + excess))[:, None]

    return losses


def search(
    candidate: Mapping[str, Any], variables: Sequence[Sequence[Any]], approach_time: float,
    limits: Mapping[str, float | None], budget: Mapping[str, Any], seed: int,
) -> list[dict[str, Any]]:  # fmt: skip
    """Return one row: the best `design` and the `parameters` of its rule as JSON, and their `loss` (m/s).

    Args:
        candidate: fields of a `Candidate`. Its environment has a range for each variable, the search starts at its
            parameters.
        variables: fields of each `SearchVariable`; if empty, only the controller is searched.
        approach_time: largest mean over the scenarios, s.
        limits: fields of `Limits`.
        budget: fields of `SearchBudget`.
        seed: of the search.
    """
    begin, free, much = Candidate(**candidate), [SearchVariable(*each) for each in variables], SearchBudget(**budget)
    of_rule = zip(RULES[begin.rule].PARAMETERS, begin.parameters, strict=True)
    parameters = [variable.parameter() for variable in free]
    parameters += [parameter._replace(start=start) for parameter, start in of_rule]
    losses = objective(begin, free, approach_time, Limits(**limits), much)
    best = minimise(losses, tuple(parameters), 1, much.population, -(-much.budget // much.population), seed)
    searched, controller = np.split(best.parameters[0], [len(free)])
    design = {each.name: float(each.value(value)) for each, value in zip(free, searched, strict=True)}
    found = {"design": json.dumps(design), "parameters": json.dumps(controller.tolist())}
    return [{**found, "loss": float(best.loss[0])}]


def play(candidate: Mapping[str, Any], tolerance: float, name: str, limits: Mapping[str, Any]) -> pl.DataFrame:
    """Return a row for each scenario of a frozen set: scenario, results, deflection and stroke of the tool (m).

    The `excess` over the limits concerns all scenarios together and is the same in each row.

    Args:
        candidate: fields of a `Candidate`.
        tolerance: largest share by which each number of the design differs, drawn anew in each scenario.
        name: of the set.
        limits: fields of `Limits`.
    """
    player = Candidate(**candidate)
    task = player.task.changed(as_built(player.design, tolerance))
    stage = ScenarioBatch.of(name, None, task, threads=1)
    travel = Travel(stage.count)
    played = stage.play(player.controller(), player.contact(stage), travel)
    released = player.released({name: np.array([value]) for name, value in player.design.items()}, 1)
    excess = Limits(**limits).excess(played, travel, released, player.soft)
    columns = {name: getattr(played, name) for name in RESULTS} | played.scenario
    columns |= {"deflection": travel.deflection, "stroke": travel.stroke, "energy": kinetic(played)}
    return pl.DataFrame(columns | {"excess": np.repeat(excess, stage.count)})
