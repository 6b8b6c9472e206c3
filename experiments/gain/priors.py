"""How much of the gain is knowing where objects can stand: rule, steady speed, profile and policy, place by place.

All have the same arm, and the last two the same choice of reactions. A profile differs from a steady speed in one
thing: it may be faster where no object stands yet, and slower where most have been met. What it gains is what the place
tells. In theory V_p grows as the speed v, and the best v as the root of the share of objects that are still ahead; a
place without memory says nothing of what is left, and nothing is gained. A policy is trained for each place, too.
"""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.baselines import BlindProfile, PaperTrapezoid
from agents.baselines.cmaes import minimise
from agents.baselines.profile import ACCELERATION, REACTION, ReactingRule
from agents.baselines.rule import Floats, Parameter
from agents.evaluate import TEST_SEED, TUNING_SEED, ScenarioBatch
from agents.jobs import Result, digest_of
from agents.policies import load_policy
from agents.setups import load_setup
from agents.train.ppo import Run, train
from experiments.lab.comparison import Comparison
from experiments.lab.statistics import Resamples, estimate
from experiments.lab.tables import Gather, Row, result_of, solver_and
from impact_gym.task.task import VELOCITY_RANGE


class Steady(ReactingRule):
    """One speed wherever the flange is, until the alarm; then a reaction as good as that of a profile."""

    PARAMETERS = (Parameter("speed", "m/s", 0.01, VELOCITY_RANGE[1], 0.6), ACCELERATION, *REACTION)

    def speed(self, position: Floats) -> Floats:
        """Return the speed (m/s)."""
        return np.broadcast_to(self["speed"], np.shape(position))


class Prior(NamedTuple):
    """Where objects can stand."""

    near: float  # m, from the tool
    far: float  # m; of a place without memory where 95 % have been met
    memoryless: bool = False

    @property
    def words(self) -> str:
        """What it is called."""
        if self.memoryless:
            return f"without memory, {100 * self.mean:.0f} cm on average"
        return f"{100 * self.near:.3g} to {100 * self.far:.3g} cm"

    @property
    def mean(self) -> float:
        """Of the distance, m."""
        return (self.far - self.near) / np.log(20.0) if self.memoryless else 0.5 * (self.near + self.far)

    def environment(self) -> dict[str, Any]:
        """Arguments of the environment; there is time for all of them."""
        return {"scenario": {"distance": (self.near, self.far)}, "horizon": 1.2 if self.far < 0.5 else 6.0}

    def distances(self, seed: int, count: int) -> Floats:
        """Return where the objects of so many scenarios stand, m."""
        share = (np.random.default_rng(seed).permutation(count) + 0.5) / count  # one of each count-th
        away = -np.log1p(-share) / np.log(20.0) if self.memoryless else share
        return self.near + (self.far - self.near) * away


WEIGHTS = (0.5, 1.0, 1.4, 2.0, 2.8, 4.0)  # m/s per s, at which policies are played, too
FREE, RANGE = (0.001, 0.05, 0.10, 0.15, 0.20), (0.1, 0.4, 1.0)  # m, the ways before a range of 0.2 m, and other ranges
PRIORS = (
    *(Prior(near, near + 0.2) for near in FREE),
    *(Prior(0.15, 0.15 + width) for width in RANGE),
    Prior(0.001, 0.6, memoryless=True),
)
RULES: Mapping[str, Any] = {"rule": PaperTrapezoid, "steady": Steady, "profile": BlindProfile}


class Effort(NamedTuple):
    """Of the searches."""

    weights: tuple[float, ...] = (0.7, 1.2, 1.7, 2.4, 3.4, 5.0)  # m/s per s, between which fronts are straight
    scenarios: int = 200
    generations: int = 90
    tested: int = 1000
    seeds: int = 3  # of policies, for each place
    steps: int = 6_000_000  # of each of their trainings


def searched(
    prior: Sequence[Any], rule: str, weight: float, scenarios: int, generations: int, tested: int, population: int = 16
) -> Result:
    """Return what the best of a rule comes to in each of the test scenarios; it was searched on others."""
    place, kind = Prior(*prior), RULES[rule]

    def controller(numbers: Any, count: int) -> Any:
        made = kind() if rule == "rule" else kind.of(np.repeat(numbers, count, axis=0))
        return made.for_environment(place.environment())

    def losses(candidates: Floats) -> Floats:
        tried = controller(candidates[:, 0], scenarios)
        played = _played(place, tried, TUNING_SEED, scenarios, [weight] * population, 1e-5)
        return played.loss(weight).reshape(population, scenarios).mean(axis=1)[:, None]

    found = None if rule == "rule" else minimise(losses, kind.PARAMETERS, 1, population, generations, 1).parameters
    return _tested(place, controller(found, tested), tested, (weight,), rule)


def learned(prior: Sequence[Any], seed: int, steps: int, weights: Sequence[float], tested: int) -> Result:
    """Return what a policy comes to in each of the test scenarios; it was trained with objects in this place."""
    place, setup = Prior(*prior), load_setup("linear-blind")
    setup = replace(setup, environment={**setup.environment, **place.environment()})
    training = replace(setup.training, steps=steps, validate_every=max(steps // 6, 1), simulation_threads=1)
    with tempfile.TemporaryDirectory(prefix="impact-gym-gain-") as folder:
        policy = load_policy(train(Run(setup, training, seed), Path(folder) / "run"))
    return _tested(place, policy, tested, weights, "policy")


def _played(place: Prior, controller: Any, seed: int, count: int, weights: Sequence[float], rtol: float) -> Any:
    """Return the episodes of as many scenarios of a place, all of them at each weight."""
    stage = ScenarioBatch(
        seed, count, len(weights), weights, rtol=rtol, threads=1, quiet=True, lenient=True, **place.environment()
    )
    return stage.play(controller, {"distance": np.tile(place.distances(seed, count), len(weights))})


def _tested(place: Prior, controller: Any, count: int, weights: Sequence[float], rule: str) -> Result:
    """Return a row for each test scenario at each weight."""
    episodes, asked = _played(place, controller, TEST_SEED, count, weights, 1e-8), {**place._asdict(), "rule": rule}
    columns = {"weight": np.repeat(weights, count).tolist()}
    columns |= {name: getattr(episodes, name).tolist() for name in ("object_velocity", "approach_time", "missed")}
    return result_of([asked | dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)])


def rows(gather: Gather, effort: Effort, priors: Sequence[Prior] = PRIORS) -> list[Row]:
    """Return a row for each test scenario of each prior, rule and weight, and of each prior's policies.

    A place without memory has none, as an environment draws distances evenly.
    """
    same = {name: getattr(effort, name) for name in ("scenarios", "generations", "tested")}
    jobs = [
        {"prior": list(prior), "rule": rule, "weight": weight, **same}
        for prior in priors for rule in RULES for weight in (effort.weights if rule != "rule" else (1.0,))
    ]  # fmt: skip
    weights = sorted({*WEIGHTS, *effort.weights})  # to play a policy at one more costs nothing
    own = {"steps": effort.steps, "weights": weights, "tested": effort.tested}
    policies = [
        {"prior": list(prior), "seed": seed, **own}
        for prior in priors if not prior.memoryless for seed in range(effort.seeds)
    ]  # fmt: skip
    depends = solver_and("experiments.gain", "agents.baselines", "agents.evaluate")
    return gather("priors", searched, jobs, depends) + gather(
        "policies for priors", learned, policies, depends + digest_of("agents.train", "agents.setups")
    )


def table(found: Sequence[Row]) -> list[dict[str, Any]]:
    """Return for each prior what each leaves the object at, at the mean time of the paper's rule, with intervals."""
    lines = []
    for prior in dict.fromkeys(Prior(row["near"], row["far"], row["memoryless"]) for row in found):
        mine = [row for row in found if (row["near"], row["far"], row["memoryless"]) == tuple(prior)]
        each = {rule: [row for row in mine if row["rule"] == rule] for rule in (*RULES, "policy")}
        fronts = {rule: _front(rows, len(each["rule"])) for rule, rows in each.items() if rows}
        rule, steady, profile, *policy = (Comparison.of_fronts(front, fronts["rule"]).ours for front in fronts.values())
        missed = max(np.mean([row["missed"] for row in mine if row["rule"] == name]) for name in RULES)
        shares = {"limits": (rule - steady) / rule, "place": (steady - profile) / rule, "all": 1.0 - profile / rule}
        line: dict[str, Any] = {"prior": prior, "time": fronts["rule"][0][0, 0], "missed": missed}
        line["velocity"] = list(map(estimate, (rule, steady, profile, *policy)))
        line |= {name: estimate(share) for name, share in shares.items()}
        line["learning"] = Comparison(policy[0], profile).reduction if policy else None
        lines.append(line | {"profile": Comparison(profile, steady).reduction})
    return lines


def _front(found: Sequence[Row], scenarios: int) -> tuple[Floats, Floats]:
    """Return mean times and velocities at each weight, in the sample and in each resample of scenarios and seeds."""
    weights, resamples = sorted({row["weight"] for row in found}), Resamples(scenarios)
    each = [[row for row in found if row["weight"] == weight] for weight in weights]
    time, velocity = (
        np.stack([resamples.means(np.reshape([row[name] for row in rows], (-1, scenarios))) for rows in each], axis=1)
        for name in ("approach_time", "object_velocity")
    )
    return time, velocity
