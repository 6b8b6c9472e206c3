"""One search: design and controller together, for the least V_p at an approach no later than a given time.

A design has to be judged by its own best controller, which takes a few hundred generations to find. One search over
both takes about twice as many; a search of designs, each with a search of its controller, takes that many for each.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from agents.baselines.cmaes import minimise
from agents.baselines.rule import Floats, Parameter
from agents.baselines.tuned import RULES
from agents.design.free import Free, as_built, designed
from agents.design.journal import journaled
from agents.design.limits import Limits, Travel
from agents.design.pads import on_pad, pad_of
from agents.evaluate import RESULTS, TUNING_SEED, Episodes, Stage
from agents.jobs import Result
from impact_gym.envs.task import MISSED_COST, Task
from impact_gym.scene import Bistable, Coupling

RTOL = 1e-5  # of the simulation while searching: V_p is within 1e-6 m/s
PENALTY = 2.0
"""m/s for each share by which a limit, or the approach time, is exceeded: more than V_p can gain by it, so that the
optimum lies within the limits."""
CONTACT = ("contact_stiffness", "restitution")


def search_one(
    environment: Mapping[str, Any],
    free: Sequence[Sequence[Any]],
    start: Sequence[float],
    rule: str,
    rule_start: Sequence[float],
    approach_time: float,
    limits: Sequence[float | None],
    pad: str,
    tolerance: float,
    scenarios: int,
    budget: int,
    population: int,
    seed: int,
    journal: str,
) -> Result:
    """Return the best `design` (d,) and `parameters` (k,) of its rule, the `loss` (1,), m/s, and `generations` (1,).

    Args:
        environment: arguments of the environment, with a range for each free number.
        free: name, low and high of each; none: only the controller is searched.
        start: what the design begins with.
        rule: name of the controller.
        rule_start: its first parameters.
        approach_time: s, that the mean over the scenarios may take.
        limits: see `Limits`.
        pad: on the tool, from the table; empty: none.
        tolerance: share by which each number of the design is off at the most, in each scenario by another.
        scenarios: training scenarios that each candidate is played through, the same for all.
        budget: candidates.
        population: of these in a generation: they are played together.
        seed: of the search.
        journal: file of what has been measured; empty: none.
    """
    coupling = Task(**environment).coupling
    numbers, kind, within = [Free(*one) for one in free], RULES[rule], Limits(*limits)
    options = {"scenario": "train", **environment, "rtol": RTOL}
    stage = Stage(TUNING_SEED, scenarios, population, threads=1, lenient=True, **options)
    contact = _contact(Stage(TUNING_SEED, scenarios, threads=1, **options), kind.of(rule_start), environment, pad)
    parameters: tuple[Parameter, ...] = (
        *(number.parameter(begin) for number, begin in zip(numbers, start, strict=True)),
        *(one._replace(start=begin) for one, begin in zip(kind.PARAMETERS, rule_start, strict=True)),
    )

    off = np.random.default_rng((TUNING_SEED, 1)).uniform(1.0 - tolerance, 1.0 + tolerance, (len(numbers), scenarios))

    def losses(candidates: Floats) -> Floats:
        designs, of_rule = np.split(candidates[:, 0], [len(numbers)], axis=1)
        controller = kind.of(np.repeat(of_rule, scenarios, axis=0)).for_environment(environment)
        design = {one.name: one.value(designs[:, k]) for k, one in enumerate(numbers)}
        record = {
            name: np.outer(values, each).ravel() for (name, values), each in zip(design.items(), off, strict=True)
        }
        record |= {name: np.tile(values, population) for name, values in contact.items()}
        travel = Travel(population * scenarios)
        played = stage.play(controller, record, travel)
        velocity, time = (each.reshape(population, scenarios).mean(axis=1) for each in _cost(played))
        release = released(coupling, design, population)
        late = np.maximum(time / approach_time - 1.0, 0.0)
        over = late + within.excess(played, travel, release, pad_of(pad) if pad else None)
        return (velocity + PENALTY * over)[:, None]

    kept = journaled(losses, Path(journal)) if journal else losses
    found = minimise(kept, parameters, 1, population, -(-budget // population), seed)
    designs, of_rule = np.split(found.parameters[0], [len(numbers)])
    design = [one.value(value) for one, value in zip(numbers, designs, strict=True)]
    return {
        "design": np.array(design, np.float64),
        "parameters": of_rule,
        "loss": found.loss,
        "generations": np.array([found.generations]),
    }


def released(coupling: Coupling, design: Mapping[str, Floats], count: int) -> Floats:
    """Return the energy (J) that each of `count` designs sets free from its front stop to its rear one (count,)."""
    if not isinstance(coupling, Bistable):
        return np.zeros(count)
    inner = {name.removeprefix("coupling."): values for name, values in design.items() if name.startswith("coupling.")}
    built = [replace(coupling, **{name: float(values[k]) for name, values in inner.items()}) for k in range(count)]
    return np.array([one.energy(one.rest) - one.energy(one.rear_stop) for one in built])


def _cost(played: Episodes) -> tuple[Floats, Floats]:
    """Return V_p with what the environment charges for a miss (m/s), and the approach time (s), of each row."""
    return np.where(played.missed, MISSED_COST, np.nan_to_num(played.object_velocity)), played.approach_time


def _contact(stage: Stage, controller: Any, environment: Mapping[str, Any], pad: str) -> dict[str, Floats]:
    """Return the contact of each scenario with the pad between tool and object; nothing without one."""
    if not pad:
        return {}
    scenario = stage.play(controller.for_environment(environment)).scenario
    return dict(zip(CONTACT, on_pad(pad, *(scenario[name] for name in CONTACT)), strict=True))


def play_one(
    environment: Mapping[str, Any],
    design: Mapping[str, float],
    rule: str,
    parameters: Sequence[float],
    pad: str,
    tolerance: float,
    scenarios: Sequence[Any],
    limits: Sequence[float | None] = Limits(),
) -> Result:
    """Return what a controller and a design do on a frozen set, an entry per scenario, deflection and stroke with it.

    The `excess` (1,) is how far all of it together is beyond the limits.

    Args:
        environment: arguments of the environment.
        design: numbers that differ from it.
        rule: name of the controller.
        parameters: its own.
        pad: on the tool, from the table; empty: none.
        tolerance: share by which each number of the design is off at the most, in each scenario by another.
        scenarios: the set and how many of it.
        limits: see `Limits`.
    """
    name, count = scenarios
    options = {"threads": 1, **designed(environment, as_built(design, tolerance))}
    controller = RULES[rule].of(parameters).for_environment(environment)
    stage = Stage.of(name, count, **options)
    travel = Travel(stage.count)
    played = stage.play(controller, _contact(stage, controller, environment, pad), travel)
    results = {name: getattr(played, name) for name in RESULTS}
    energy = 0.5 * played.scenario["object_mass"] * played.object_velocity**2
    moved = {"deflection": travel.deflection, "stroke": travel.stroke}
    moved["pressed_in"] = pad_of(pad).pressed(played.peak_force) if pad else np.zeros(stage.count)
    release = released(Task(**environment).coupling, {name: np.array([value]) for name, value in design.items()}, 1)
    excess = Limits(*limits).excess(played, travel, release, pad_of(pad) if pad else None)
    return results | moved | {"energy": energy, "distance": played.scenario["distance"], "excess": excess}
