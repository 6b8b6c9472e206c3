"""Play episodes, alone, in batches and with an operator."""

from collections import namedtuple

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import impact_gym as ig
from agents.baselines.filtered import FilteredProfile
from agents.baselines.rule import View
from impact_gym.envs.batch import Batch
from impact_gym.kernels import PACKET
from impact_gym.task import QUANTITIES, ObservationSpec, Task

ID, TELEOP = "ImpactApproach-v0", "ImpactTeleop-v0"
IDS = sorted(name for name in gym.registry if name.startswith("ImpactApproach"))
COMMANDED = "command", "command_age", "is_intervention", "teleop_action", "intervene_action"  # in info of each step
ROBOT, PAPERS_SPRING = ig.Robot(5.225, 1.9e5, 50.4), ig.SpringDamper(50.0, 1.0)
encode = Task().action.encode
"""From velocity (m/s) and acceleration (m/s^2) to the action of `ID`."""
ARM, AWAY = {"friction": 0.3, "horizon": 8.0, "velocity_range": (-0.3, 0.5)}, {"distance": 0.79}
SLOW = {"velocity_range": (-0.3, 0.8), "acceleration_range": (0.5, 5.0), "scenario": {"distance": (0.1, 0.6)}}
OWN, STOP, GENTLE = [1.0, 1.0, -1.0], [-1.0, 1.0, -1.0], [1.0, 2.0 * (8.0 - 1.0) / 19.0 - 1.0, -1.0]
"""Of tasks with an operator: arguments, a scenario, and actions."""


def action_table(seed, ticks=160, slots=4, lean=(0.3, 0.3), task=None):
    """Random actions (ticks, slots, n) for a task, each slot with its own mean, so that slots end at other times."""
    rng = np.random.default_rng(seed)
    leans, commands = rng.uniform(*lean, (1, slots, 1)), 3 if (task or {}).get("operator") else 2
    return np.clip(rng.uniform(-1.0, 1.0, (ticks, slots, commands)) + leans, -1.0, 1.0).astype(np.float32)


def assert_identical(first, second):
    assert data_equivalence(first, second, exact=True), "\n".join(f"{each}"[:1000] for each in (first, second))


def all_finite(value):
    """Whether every number in a nested value is finite."""
    if isinstance(value, (dict, list, tuple)):
        return all(map(all_finite, value.values() if isinstance(value, dict) else value))
    return not isinstance(value, (float, np.floating, np.ndarray)) or bool(np.isfinite(value).all())


class Given:
    """Plays given actions, and keeps the observations in `seen`."""

    def __init__(self, actions):
        self.left, self.seen = iter(actions), []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.seen.append(observation)
        return next(self.left), state


Episode = namedtuple("Episode", "observations rewards info")
"""Observations (steps + 1, n_obs), rewards (steps,), and the final info."""


def steps(env, controller, seed=None, **options):
    """Play an episode of a single environment; yield what reset, with these options, and each step returns."""
    returned, state = env.reset(seed=seed, options=options), None
    yield returned
    while len(returned) == 2 or not (returned[2] or returned[3]):
        action, state = controller.predict(returned[0], state=state)
        returned = env.step(action)
        yield returned


def play(env, controller, seed=None, **options):
    """Play an episode as `steps` does; return arrays. Its reward is minus weighted time, V_p or miss, and force."""
    (first, _), *played = steps(env, controller, seed, **options)
    rewards, info, task = np.array([step[1] for step in played]), played[-1][4], env.unwrapped.task
    costs = {"cost"} if task.force_limit or task.velocity_limit else set()
    assert all(step[4].keys() - {*COMMANDED} == costs for step in played[:-1])
    terms, tolerance = info["reward_terms"], 1e-12 * max(1.0, abs(rewards.sum()))
    assert terms.keys() == {"time", "velocity", "force", "missed"}
    assert rewards.sum() == pytest.approx(sum(terms.values()), rel=0, abs=tolerance)
    assert (rewards[:-1] <= 0.0).all()
    if info["status"] == "ok":
        lasted = info.get("done_time", info["approach_time"])
        assert info["missed"] == (info["contact_count"] == 0)
        assert terms["time"] == pytest.approx(-info["time_weight"] * lasted, rel=1e-12)
        expected = (0.0, 0.0, -task.missed_cost)
        if not info["missed"]:
            expected = (-info["object_velocity"], -task.force_weight * info["peak_force"], 0.0)
        assert (terms["velocity"], terms["force"], terms["missed"]) == pytest.approx(expected, rel=1e-12)
    return Episode(np.array([first, *(step[0] for step in played)]), rewards, info)


def begin(env, seed=None, options=None):
    """Reset any front end; return the observations."""
    if not hasattr(env, "set_options"):  # as a batch of stable-baselines3 has
        return env.reset(seed=seed, options=options)[0]
    if options is not None:
        env.set_options(options)
    if seed is not None:
        env.seed(seed)
    return env.reset()


def by_path(scenario):
    """Columns of a scenario as `sweep` takes them."""
    return {QUANTITIES[name].path: column for name, column in scenario.items()}


def steered(operator, rows=1, **options):
    return Batch(rows, Task(**ARM | {"operator": operator} | options), threads=1)


def played(batch, action, steps=10_000):
    """Play every row to its end with one action; yields the batch after each step."""
    batch.begin_seeded(0, {})
    while not batch.ended.all() and steps:
        batch.step(np.broadcast_to(action, (batch.size, len(action))), batch.ended)
        steps -= 1
        yield batch


def sent(batch, action, steps=10_000):
    """Play; return the packets of each row's operator in the order of sending: (rows, n), PACKET."""
    slots, kept = batch.packets.shape[1], []
    for each in played(batch, action, steps=steps):
        last, first = each.links["packets"], len(kept)
        kept += [np.zeros(batch.size, PACKET) for _ in range(first, int(last.max()))]
        for number in range(max(first - 4, 0), len(kept)):  # rows may have sent this one later than others
            rows = (last > number) & (last - number <= slots)
            kept[number][rows] = each.packets[rows, number % slots]
    return np.array(kept[: int(batch.links["packets"].min())]).T


def started(kind, task):
    return kind([parameter.start for parameter in kind.PARAMETERS]).for_task(task)


def estimates(rows, steps, speed=0.3, kind=FilteredProfile, **options):
    """Return arrays (steps, rows): error and spread of the estimate, age of the reading, whether there was a touch."""
    task = Task(**options)
    batch, rule = Batch(rows, task), started(kind, task)
    batch.begin_seeded(0, {})
    spec, state, found = ObservationSpec(task), None, []
    action, none = np.tile([speed, 0.2], (rows, 1)), np.zeros(rows, bool)
    for _ in range(steps):
        view, state = rule.see(View(batch.observations, spec), state, None)
        sensors, distance = batch.sensors(), batch.info()["scenario"]["distance"]
        error = view["distance_estimate"] + sensors["position"] - distance
        found.append((error, view["spread"], sensors["range_age"], batch.bodies().touched))
        batch.step(action, none)
    return (np.array(column) for column in zip(*found, strict=True))
