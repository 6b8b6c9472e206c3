"""Every front end behind one interface: rows that begin, step, and begin again by themselves.

`begin(seed, options)` returns the first observations, `step(actions)` for each row (observation, reward, terminated,
truncated, final info, first observation of the next episode or None), or None where it took no action.
"""

import copy
import pickle

import gymnasium as gym
import numpy as np
from episodes import COMMANDED, ID

from impact_gym.envs.batch import Batch
from impact_gym.envs.infos import SLIDE
from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import Task
from impact_gym.task.episodes import RECORD_IDS, episode_index, fixed_records, skip_episodes


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


class Singles:
    """Environments of `gymnasium.make`, one for each row: what all others are compared with."""

    def __init__(self, rows):
        self.env = [gym.make(ID, **arguments) for arguments in rows]

    def begin(self, seed, options):
        return [env.reset(seed=seed + row, options=options)[0] for row, env in enumerate(self.env)]

    def step(self, actions):
        return [self._step(env, action) for env, action in zip(self.env, actions, strict=True)]

    def _step(self, env, action):
        observation, reward, terminated, truncated, info = env.step(action)
        info = scalars(info)
        if not (terminated or truncated):
            return observation, reward, False, False, info, None
        info |= env.unwrapped.episode_info()  # TimeLimit truncates without telling the environment
        return observation, reward, terminated, truncated and not terminated, info, env.reset()[0]


class Vector:
    """The native batch of Gymnasium's vector interface."""

    def __init__(self, rows, mode="NextStep"):
        self.env = ImpactApproachVectorEnv(len(rows), autoreset_mode=mode, per_slot=rows, threads=1)
        self.mode = mode
        self.tasks = [Task(**arguments) for arguments in rows]
        self.waiting = np.zeros(len(rows), bool)  # for the step that begins an episode

    def begin(self, seed, options):
        return self.env.reset(seed=seed, options=options)[0]

    def step(self, actions):
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        ended = terminated | truncated
        seen, first, step, finals = observations, [None] * len(actions), infos, infos
        if ended.any() and self.mode == "SameStep":
            seen = [infos["final_obs"][row] if ended[row] else observations[row] for row in range(len(actions))]
            first = [observations[row] if ended[row] else None for row in range(len(actions))]
            finals = infos["final_info"]
        elif ended.any() and self.mode == "Disabled":
            begun = self.env.reset(options={"reset_mask": ended})[0]
            first = [begun[row] if ended[row] else None for row in range(len(actions))]
        results = []
        for row, task in enumerate(self.tasks):
            info = plain(finals if ended[row] else {name: step[name] for name in COMMANDED if name in step}, row)
            if ended[row]:  # columns have what any row draws, and how far objects slide if any has friction
                info["record"] = {name: info["record"][name] for name in (*RECORD_IDS, *task.drawn)}
                info = {name: value for name, value in info.items() if task.rough or name not in SLIDE}
            flags = bool(terminated[row]), bool(truncated[row] and not terminated[row])
            results.append((seen[row], float(rewards[row]), *flags, info, first[row]))
        if self.mode == "NextStep":
            for row in np.flatnonzero(self.waiting):
                assert results[row][1:4] == (0.0, False, False)
                results[row] = (None, None, None, None, None, observations[row])
            self.waiting = ended
        return results


class Stable:
    """The batch of stable-baselines3."""

    def __init__(self, rows):
        self.env = ImpactVecEnv(num_envs=len(rows), per_slot=rows, threads=1)

    def begin(self, seed, options):
        self.env.seed(seed)
        self.env.set_options(options)
        return self.env.reset()

    def step(self, actions):
        observations, rewards, ended, infos = self.env.step(actions)
        results = []
        for observation, reward, over, given in zip(observations, rewards, ended, infos, strict=True):
            info = {name: value if name == "terminal_observation" else scalars({name: value})[name]
                    for name, value in given.items()}  # fmt: skip
            if over:
                last, cut = info.pop("terminal_observation"), info.pop("TimeLimit.truncated")
                results.append((last, reward, not cut, cut, info, observation))
            else:
                results.append((observation, reward, False, False, info, None))
        return results


class Rows:
    """The batch behind the native front ends."""

    def __init__(self, rows):
        self.tasks = [Task(**arguments) for arguments in rows]
        self.env = Batch(len(rows), self.tasks, threads=1)

    def begin(self, seed, options):
        rows = np.arange(len(self.tasks))
        self.generators = [gym.utils.seeding.np_random(seed + row)[0] for row in rows.tolist()]
        for generator in self.generators:
            skip_episodes(generator, episode_index(options) or 0)
        self.env.draw_and_begin(rows, self.generators, fixed_records(options, self.tasks, len(rows)))
        return self.env.observations.copy()

    def step(self, actions):
        batch = self.env
        batch.step(actions, np.zeros(len(actions), bool))
        ended, seen, rewards = batch.ended, batch.observations.copy(), batch.rewards.copy()
        terminated, infos = batch.episodes["terminated"] == 1, batch.infos(np.arange(len(actions)))
        steps = [scalars(info) for info in batch.link_infos()]
        if ended.any():
            batch.draw_and_begin(np.flatnonzero(ended), self.generators)
        results = []
        for row, over in enumerate(ended):
            flags = bool(terminated[row]), bool(over and not terminated[row])
            first = batch.observations[row].copy() if over else None
            results.append((seen[row], float(rewards[row]), *flags, steps[row] | (infos[row] if over else {}), first))
        return results


FRONT_ENDS = {
    "NextStep": Vector, "SameStep": lambda rows: Vector(rows, "SameStep"),
    "Disabled": lambda rows: Vector(rows, "Disabled"), "stable-baselines3": Stable, "batch": Rows,
}  # fmt: skip
TWINS = {"itself": None, "copy": copy.deepcopy, "pickle": lambda front: pickle.loads(pickle.dumps(front))}


def trails(front, actions, seed, options=None, twin="itself"):
    """What each row meets, playing its own column of `actions` (ticks, rows, n), episode after episode.

    In the middle the front end is replaced by its twin, and the original steps on by other actions.
    """
    trail = [[observation] for observation in front.begin(seed, options)]
    ticks, rows, commands = actions.shape
    played = np.zeros(rows, int)
    begun = 0
    while played.min() < ticks:
        begun += 1
        if begun == ticks // 2 and twin != "itself":
            original, front = front, TWINS[twin](front)
            original.step(np.ones((rows, commands), np.float32))  # what it does next is its own affair
        now = actions[np.minimum(played, ticks - 1), np.arange(rows)]
        for row, (*result, first) in enumerate(front.step(now)):
            if played[row] == ticks:
                continue
            if result[0] is not None:
                trail[row].append(result)
                played[row] += 1
            if first is not None and played[row] < ticks:
                trail[row].append(first)
    return trail
