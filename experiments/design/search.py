"""One search: design and controller together, for the least V_p at an approach no later than a given time.

A design has to be judged by its own best controller, which takes a few hundred generations to find. One search over
both takes about twice as many; a search of designs, each with a search of its controller, takes that many for each.
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
"""m/s for each share by which a limit, or the approach time, is exceeded: more than V_p can gain by it, so that the
optimum lies within the limits."""
MARGIN = 1.2
"""In a search a design is off by so many times the tolerance. A search looks at few scenarios: what barely holds its
tool in all of them lets it go in others."""
CONTACT = ("contact_stiffness", "restitution")


@dataclass(frozen=True)
class Candidate:
    """One coupling with one controller, as plain data."""

    environment: Mapping[str, Any]  # arguments of the environment
    rule: str  # name of the controller
    parameters: Sequence[float] = ()  # of the controller
    design: Mapping[str, float] = field(default_factory=dict)  # numbers that differ from the environment
    pad: str = ""  # on the tool, from the table; empty: none

    @cached_property
    def task(self) -> Task:
        """The environment's task."""
        return Task(**self.environment)

    @property
    def controller(self) -> Rule:
        """The controller, made for the environment."""
        return self.controller_of(self.parameters)

    def controller_of(self, parameters: ArrayLike) -> Rule:
        """Return the controller with other parameters, (k,) or (rows, k)."""
        return RULES[self.rule].of(parameters).for_task(self.task)

    @property
    def soft(self) -> Pad | None:
        """The pad on the tool."""
        return pad_of(self.pad) if self.pad else None

    def built(self, tolerance: float) -> Task:
        """Return the task with the design, each number of it off by a share in each episode."""
        return self.task.changed(as_built(self.design, tolerance))

    def contact(self, stage: ScenarioBatch) -> dict[str, Floats]:
        """Return the contact of each scenario with the pad between tool and object; nothing without one.

        The controller is played to learn the scenarios.
        """
        if not self.pad:
            return {}
        scenario = stage.play(self.controller).scenario
        return dict(zip(CONTACT, on_pad(self.pad, *(scenario[name] for name in CONTACT)), strict=True))

    def released(self, design: Mapping[str, Floats], count: int) -> Floats:
        """Return the energy (J) that each of `count` designs sets free from its front stop to its rear one (count,)."""
        coupling = self.task.coupling
        if not isinstance(coupling, Bistable):
            return np.zeros(count)
        numbers = {name.rpartition(".")[2]: values for name, values in design.items() if name.startswith("coupling.")}
        each = ({name: float(values[k]) for name, values in numbers.items()} for k in range(count))
        built = [replace(coupling, **changes) for changes in each]
        return np.array([one.energy(one.rest) - one.energy(one.rear_stop) for one in built])


@dataclass(frozen=True)
class SearchBudget:
    """How much a search does."""

    tolerance: float = 0.05
    """Share by which each number of a design may be off as it is built: in search and test each scenario meets another.
    Without it a mechanism is found that barely holds its tool."""
    scenarios: int = 500
    """Training scenarios that each candidate is played through."""
    budget: int = 7200
    """Candidates of each search."""
    population: int = 18
    """Candidates per generation: they are played together."""

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
    """Return the losses (population, 1), m/s, of candidates (population, 1, k): designs, then controllers.

    All are played through the same training scenarios; arguments as in `search`.
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
        played = stage.play(candidate.controller_of(np.repeat(of_rule, scenarios, axis=0)), record, travel)
        # what the environment charges for a miss instead of V_p
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
    """Return one row: the best `design` and the `parameters` of its rule, as JSON, and their `loss`, m/s.

    Args:
        candidate: fields of a `Candidate`: its environment has a range for each variable; its parameters are the first.
        variables: fields of each `SearchVariable`; none: only the controller is searched.
        approach_time: s, that the mean over the scenarios may take.
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


def play(
    candidate: Mapping[str, Any], tolerance: float, name: str, limits: Mapping[str, Any], count: int | None = None
) -> pl.DataFrame:
    """Return a row for each scenario of a frozen set: its fields, results, deflection and stroke of the tool (m).

    The `excess`, how far all scenarios together are beyond the limits, is the same in each row.

    Args:
        candidate: fields of a `Candidate`.
        tolerance: largest share by which each number of the design is off, another in each scenario.
        name: of the set.
        limits: fields of `Limits`.
        count: how many scenarios of the set; all unless given.
    """
    player = Candidate(**candidate)
    stage = ScenarioBatch.of(name, count, player.built(tolerance), threads=1)
    travel = Travel(stage.count)
    played = stage.play(player.controller, player.contact(stage), travel)
    released = player.released({name: np.array([value]) for name, value in player.design.items()}, 1)
    excess = Limits(**limits).excess(played, travel, released, player.soft)
    columns = {name: getattr(played, name) for name in RESULTS} | played.scenario
    columns |= {"deflection": travel.deflection, "stroke": travel.stroke, "energy": kinetic(played)}
    return pl.DataFrame(columns | {"excess": np.repeat(excess, stage.count)})
