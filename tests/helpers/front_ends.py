"""Every front end beside a loop over single environments, of Gymnasium or stable-baselines3, that must return the same.

What a loop would not tell of an episode that `TimeLimit` cuts, its single environments are made to tell.
"""

import copy
import pickle
from functools import partial

import gymnasium as gym
from episodes import COMMANDED, ID, assert_identical
from gymnasium.vector import SyncVectorEnv
from stable_baselines3.common.vec_env import DummyVecEnv

from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.sb3 import ImpactVecEnv

MODES = ["NextStep", "SameStep", "Disabled"]
FRONT_ENDS = [*MODES, "stable-baselines3", "single"]


class Telling(gym.Wrapper):
    """Tells of an episode that `TimeLimit` cuts what the environment tells of any other that ends."""

    def step(self, action):
        *rest, truncated, info = self.env.step(action)
        return *rest, truncated, info | (self.unwrapped.episode_info() if truncated else {})


def single(options, id=ID):
    """The single environment of a task."""
    return Telling(gym.make(id, disable_env_checker=True, **options))


def made(front, rows):
    """A front end with a task in each row: a mode of Gymnasium's batch, a batch of stable-baselines3, or a loop."""
    if front == "single":
        return loop_of(front, rows)
    if front == "stable-baselines3":
        return ImpactVecEnv(len(rows), per_slot=rows, threads=1)
    return ImpactApproachVectorEnv(len(rows), autoreset_mode=front, per_slot=rows, threads=1)


def loop_of(front, rows):
    """What the front end is compared with."""
    singles = [partial(single, options) for options in rows]
    if front == "stable-baselines3":
        return DummyVecEnv(singles)
    return SyncVectorEnv(singles, autoreset_mode="NextStep" if front == "single" else front)


def stepped(front, envs, actions):
    """What a step returns, and with no autoreset what a reset then returns of the episodes that have ended."""
    returned = envs.step(actions)
    if front == "Disabled" and (ended := returned[2] | returned[3]).any():
        returned += envs.reset(options={"reset_mask": ended})
    return returned


def plain(values, row):
    """The entries of one row in Gymnasium's columns, but for their masks, as plain numbers."""
    picked = {}
    for name, column in values.items():
        if isinstance(column, dict):
            picked[name] = plain(column, row)
        elif not name.startswith("_"):
            picked[name] = column[row].item() if hasattr(column[row], "item") else column[row]
    return picked


def assert_has(infos, expected):
    """Columns have what a loop says of each row.

    Also, of rows that draw less than others, numbers of no meaning.
    """
    for name, column in expected.items():
        if isinstance(column, dict):
            assert_has(infos[name], column)
        elif not name.startswith("_"):
            rows = expected[f"_{name}"]
            assert name not in COMMANDED or (infos[f"_{name}"] == rows).all()
            assert infos[f"_{name}"][rows].all()
            assert_identical((name, infos[name][rows].tolist()), (name, column[rows].tolist()))


def assert_alike(returned, expected, exact):
    """Compare what a step of a front end returned, to the bit, with what its loop returned.

    It is exactly that where all rows have the same task.
    """
    if isinstance(returned[-1], dict) and not exact:
        assert [name for name in COMMANDED if name in returned[4] and name not in expected[4]] == []
        for place in range(4, len(expected), 2):  # of infos
            assert_has(returned[place], expected[place])
        returned, expected = (each[:4] + each[5:6] for each in (returned, expected))
    elif isinstance(returned[-1], list):
        for info, ended in zip(expected[-1], expected[2], strict=True):
            if not ended:
                del info["TimeLimit.truncated"]  # which a loop says in every step
    assert_identical(returned, expected)


def twin_of(envs, twin, fresh, actions):
    """The twin of a front end; the original goes on with actions of its own, which must change nothing for the twin.

    By its state, the twin is a `fresh()` one that had another state before.
    """
    if twin == "state" and hasattr(envs, "get_state"):
        other, state = fresh(), envs.get_state()
        envs.step(actions)
        other.set_state(state)
        other.step(actions)
        other.set_state(state)
        return other
    other = pickle.loads(pickle.dumps(envs)) if twin == "pickle" else copy.deepcopy(envs)
    envs.step(actions)
    return other
