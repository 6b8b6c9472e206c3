"""Every front end behind one interface: rows that begin, step, and begin again by themselves.

`begin(seed, options)` returns the first observations, `step(actions)` for each row (observation, reward, terminated,
truncated, info, first observation of the next episode or None), or None where it took no action.
"""

import copy
import pickle
from functools import partial

import gymnasium as gym
import numpy as np
from episodes import COMMANDED, ID

from impact_gym.envs import of_objectives
from impact_gym.envs.infos import SLIDE
from impact_gym.envs.objectives import MOImpactApproachVectorEnv
from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import Task
from impact_gym.task.episodes import RECORD_IDS

OF_STEP = (*COMMANDED, "original_reward")
"""Entries that the info of every step may have."""


def scalars(info):
    """An info with plain numbers for arrays of one."""
    return {name: value.item() if isinstance(value, np.ndarray) else value for name, value in info.items()}


def plain(values, row):
    """The entries of one row in Gymnasium's columns, but for their masks, as plain numbers."""
    picked = {}
    for name, column in values.items():
        if isinstance(column, dict):
            picked[name] = plain(column, row)
        elif not name.startswith("_"):
            picked[name] = column[row].item() if hasattr(column[row], "item") else column[row]
    return picked


def first_infos(envs, controller, seed):
    """Play until the first episode of every row of a batch has ended: the final infos, by row."""
    observation, _ = envs.reset(seed=seed)
    finals = {}
    while len(finals) < envs.num_envs:
        actions = np.broadcast_to(controller.predict(observation)[0], (envs.num_envs, 2))
        observation, _, ended, _, infos = envs.step(actions)
        finals = {row: plain(infos, row) for row in np.flatnonzero(ended)} | finals
    return [finals[row] for row in range(envs.num_envs)]


class Singles:
    """Environments of `gymnasium.make`, one for each row: what all others are compared with."""

    def __init__(self, rows, id=ID):
        self.env = [gym.make(id, disable_env_checker=True, **arguments) for arguments in rows]

    def begin(self, seed, options):
        return [env.reset(seed=seed + row, options=options)[0] for row, env in enumerate(self.env)]

    def step(self, actions):
        results = []
        for env, action in zip(self.env, actions, strict=True):
            observation, reward, terminated, truncated, info = env.step(action)
            info, first = scalars(info), None
            if terminated or truncated:
                info |= env.unwrapped.episode_info()  # TimeLimit truncates without telling the environment
                first = env.reset()[0]
            results.append((observation, reward, terminated, truncated and not terminated, info, first))
        return results


class Vector:
    """A native batch of Gymnasium's vector interface."""

    def __init__(self, rows, mode="NextStep", kind=ImpactApproachVectorEnv):
        self.arguments = rows, mode, kind
        self.env = kind(len(rows), autoreset_mode=mode, per_slot=rows, threads=1)
        self.tasks = [Task(**arguments) for arguments in rows]
        self.waiting = np.zeros(len(rows), bool)  # for the step that begins an episode

    def begin(self, seed, options):
        return self.env.reset(seed=seed, options=options)[0]

    def get_state(self):
        return self.env.get_state(), self.waiting

    def set_state(self, state):
        there, self.waiting = state
        self.env.set_state(there)

    def step(self, actions):
        mode = self.arguments[1]
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        ended = terminated | truncated
        assert all(infos[f"_{name}"].all() for name in OF_STEP if name in infos)
        seen, first, finals = observations, [None] * len(actions), infos
        if ended.any() and mode == "SameStep":
            seen = [infos["final_obs"][row] if ended[row] else observations[row] for row in range(len(actions))]
            first = [observations[row] if ended[row] else None for row in range(len(actions))]
            finals = infos["final_info"]
        elif ended.any() and mode == "Disabled":
            begun = self.env.reset(options={"reset_mask": ended})[0]
            first = [begun[row] if ended[row] else None for row in range(len(actions))]
        results = []
        for row, task in enumerate(self.tasks):
            info = plain({name: infos[name] for name in OF_STEP if name in infos}, row)
            if ended[row]:  # columns have what any row draws, and how far objects slide if any has friction
                info |= plain(finals, row)
                info["record"] = {name: info["record"][name] for name in (*RECORD_IDS, *task.drawn)}
                info = {name: value for name, value in info.items() if task.rough or name not in SLIDE}
            reward = rewards[row] if rewards.ndim > 1 else float(rewards[row])
            flags = bool(terminated[row]), bool(truncated[row] and not terminated[row])
            results.append((seen[row], reward, *flags, info, first[row]))
        if mode == "NextStep":
            for row in np.flatnonzero(self.waiting):
                assert not np.any([*results[row][2:4], *np.ravel(results[row][1])])
                results[row] = (None, None, None, None, None, observations[row])
            self.waiting = ended
        return results


class Stable:
    """The batch of stable-baselines3."""

    def __init__(self, rows):
        self.arguments = (rows,)
        self.env = ImpactVecEnv(num_envs=len(rows), per_slot=rows, threads=1)

    def begin(self, seed, options):
        self.env.seed(seed)
        self.env.set_options(options)
        return self.env.reset()

    def get_state(self):
        return self.env.get_state()

    def set_state(self, state):
        self.env.set_state(state)

    def step(self, actions):
        observations, rewards, ended, infos = self.env.step(actions)
        results = []
        for observation, reward, over, info in zip(observations, rewards, ended, infos, strict=True):
            seen, cut, first = observation, False, None
            if over:
                seen, cut, first = info.pop("terminal_observation"), info.pop("TimeLimit.truncated"), observation
            results.append((seen, reward, bool(over and not cut), cut, scalars(info), first))
        return results


FRONT_ENDS = {
    "NextStep": Vector, "SameStep": partial(Vector, mode="SameStep"), "Disabled": partial(Vector, mode="Disabled"),
    "stable-baselines3": Stable,
}  # fmt: skip
OBJECTIVES = {
    "single": partial(Singles, id=of_objectives(ID)),
    **{mode: partial(Vector, mode=mode, kind=MOImpactApproachVectorEnv) for mode in ("NextStep", "SameStep")},
}
"""Those with vector rewards."""
TWINS = {"itself": None, "copy": copy.deepcopy, "pickle": lambda front: pickle.loads(pickle.dumps(front))}


def twin_of(front, twin, actions):
    """The twin of a front end; the original goes on with actions of its own, which must change nothing for the twin."""
    if twin != "state" or not hasattr(front, "get_state"):
        other = TWINS.get(twin, copy.deepcopy)(front)
        front.step(actions)
        return other
    other, state = type(front)(*front.arguments), front.get_state()
    front.step(actions)
    other.set_state(state)
    other.step(actions)
    other.set_state(state)
    return other


def trails(front, actions, seed, options=None, twin="itself"):
    """What each row meets, playing its own column of `actions` (ticks, rows, n), episode after episode.

    As an episode ends after a third of them, or in the middle, the front end is replaced by its twin.
    """
    trail = [[observation] for observation in front.begin(seed, options)]
    ticks, rows, commands = actions.shape
    played, replaced = np.zeros(rows, int), twin == "itself"
    while played.min() < ticks:
        results = front.step(actions[np.minimum(played, ticks - 1), np.arange(rows)])
        for row, (*result, first) in enumerate(results):
            if played[row] == ticks:
                continue
            if result[0] is not None:
                trail[row].append(result)
                played[row] += 1
            if first is not None and played[row] < ticks:
                trail[row].append(first)
        due = ticks // 3 if any(result[2] or result[3] for result in results) else ticks // 2
        if not replaced and played.min() >= due:
            front, replaced = twin_of(front, twin, np.ones((rows, commands), np.float32)), True
    return trail
