"""Optimise a rule's parameters with CMA-ES (N. Hansen, The CMA Evolution Strategy: A Tutorial, arXiv:1604.00772)."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from agents.baselines.rule import Floats, Parameter
from agents.policies import Controller

SIGMA = 0.2
"""Initial standard deviation of the search, as a fraction of the range of each parameter."""

Losses = Callable[[Floats], Floats]
"""Function from candidates (population, problems, k) to losses (population, problems); k: number of parameters."""


class Minimum(NamedTuple):
    """Result of `minimise`: the best candidate of each problem, and the number of generations."""

    parameters: Floats  # (problems, k), k: number of parameters
    loss: Floats  # (problems,), m/s
    generations: int


def minimise(
    losses: Losses, parameters: tuple[Parameter, ...], problems: int = 1, population: int = 20, generations: int = 150,
    seed: int = 0,
) -> Minimum:  # fmt: skip
    """Minimise the losses of independent problems, such as one for each scenario, within the limits of `parameters`.

    Each generation calls `losses` once, with `population` candidates of each problem. The search ends after
    `generations`, or when CMA-ES stops for all problems. `seed` determines the random numbers.
    """
    import cma  # imported here, so that playing a rule does not need the package

    low, high, start = np.array([(each.low, each.high, each.start) for each in parameters]).T
    width, searches = high - low, list[Any]()
    for problem in range(problems):
        rng = np.random.default_rng((seed, problem))
        options = {
            "bounds": [0.0, 1.0],
            "popsize": population,
            "randn": lambda *shape, rng=rng: rng.standard_normal(shape),
            "seed": np.nan,  # so that the package does not seed NumPy's global generator
            "tolfun": 1e-5,  # m/s; a search stops when the losses of its recent candidates differ by less than this
            "verbose": -9,
        }
        searches.append(cma.CMAEvolutionStrategy((start - low) / width, SIGMA, options))
    generation = 0
    while generation < generations and not all(search.stop() for search in searches):
        generation += 1
        shares = [search.ask() for search in searches]
        values = losses(np.clip(low + width * np.moveaxis(np.array(shares), 0, 1), low, high))
        for search, share, value in zip(searches, shares, values.T, strict=True):
            search.tell(share, value.tolist())
    best = low + width * np.array([search.best.x for search in searches])
    return Minimum(np.clip(best, low, high), np.array([search.best.f for search in searches]), generation)


class Jittery(NamedTuple):
    """A rule with random errors added to its actions. In each scenario, all candidates get the same errors."""

    rule: Controller
    jitter: float  # standard deviation of the errors, as a fraction of 2, the width of an action's range -1 ... 1
    scenarios: int
    rng: np.random.Generator

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return the rule's actions (n, k) plus errors, and the rule's next state."""
        actions, state = self.rule.predict(observation, state, episode_start, deterministic)
        off = self.rng.normal(0.0, 2.0 * self.jitter, (self.scenarios, actions.shape[-1]))
        return actions + np.tile(off, (len(actions) // self.scenarios, 1)), state
