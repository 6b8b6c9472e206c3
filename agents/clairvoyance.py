"""The bound: for every scenario by itself, the best that a controller does that knows it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from agents.baselines.clairvoyant import Clairvoyant
from agents.baselines.rule import Floats
from agents.baselines.tuned import environment_of
from agents.evaluation import Episodes, Stage
from agents.search_rules import minimise

SCENARIOS = 64
SEARCH_RTOL = (
    1e-5  # of the simulation while searching; V_p is within 1e-6 m/s, and the best is played as all others are
)


def clairvoyant_bound(
    preset: str,
    time_weight: float,
    frozen: str = "validation",
    scenarios: int = SCENARIOS,
    generations: int = 150,
    population: int = 16,
    seed: int = 1,
    threads: int | None = None,
    told: Callable[[float], object] = lambda loss: None,
) -> Episodes:
    """Optimise a `Clairvoyant` for each of the first `scenarios` of a frozen set alone, and play each through its own.

    It is a bound on the rules of its kind, found by search: a controller with other freedoms could still do better.
    """
    options: dict[str, Any] = {**environment_of(preset), "privileged": True, "threads": threads}
    weights = [time_weight] * population
    stage = Stage.of(frozen, scenarios, copies=population, time_weight=weights, **{"rtol": SEARCH_RTOL, **options})

    def losses(candidates: Floats) -> Floats:
        played = stage.play(Clairvoyant(candidates.reshape(population * scenarios, -1)))
        return played.loss(time_weight).reshape(population, scenarios)

    found = minimise(losses, Clairvoyant.PARAMETERS, scenarios, population, generations, seed, told)
    alone = Stage.of(frozen, scenarios, time_weight=[time_weight], **options)
    return alone.play(Clairvoyant(np.ascontiguousarray(found.parameters)))
