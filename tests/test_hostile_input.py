"""A good input with one hostile value works, or is refused in one line that names the place."""

import csv
import json
import math
import os
import random
import tomllib
from copy import deepcopy
from itertools import zip_longest

import gymnasium as gym
import numpy as np
import pytest
import tomli_w
from episode_runs import ID, all_finite, begin
from made_up_policies import made_up_policy
from own_set_up import TEXT
from random_tasks import EVERYTHING_DRAWN
from recorded_hits import FORCE, MOTION, SCENE, SCENE_FILE, TIME

import impact_gym as ig
from agents import archive, load_policy, load_setup
from agents.policies import Ensemble
from agents.policies.policy import FORMAT
from experiments.report.__main__ import scenarios_from
from impact_gym.identify import log as logs_of
from impact_gym.identify.__main__ import parse
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import evaluation_sets

MOST, MOST_PLACES, TRIES = 10**30, 60, 3
PLAIN = [  # values in a file
    True, False, 0, -1, 1, 3, MOST, -MOST, 0.0, -0.0, 1e-320, 1e300, -1.5, 0.5, math.nan, math.inf, -math.inf,
    "", "0.1", "nan", "Rigid", "a\nb", "x" * 5000, "\x00", [], [1.0], [1.0, 2.0], [2.0, 1.0], [[1.0], [1.0, 2.0]],
    [1, "a"], [True], {}, {"type": "Rigid"}, {"a": {"b": [1]}}, [math.nan, 1.0], [0.0, 1e300],
]  # fmt: skip
PYTHON = [  # values that only a Python call can have
    None, 1j, 10**400, b"1", bytearray(b"\xff"), {1, 2}, range(3), object, object(), len, Ellipsis, (1.0,),
    *(lambda values=values: np.array(values) for values in (1.0, [1.0, 2.0], [1j], ["a"], [[1.0]], [None], [])),
    lambda: np.float32(math.nan), lambda: np.int64(-5), lambda: np.zeros((3, 2, 2)), lambda: np.zeros(10**5),
    lambda: np.datetime64("2020"), lambda: iter([1.0]), lambda: np.ma.array([1.0, 2.0]),
]  # fmt: skip
KEYS = ["", "mass", "tool_mas", "__class__", "type", "scenario", "Stiffness", "a.b", "x\ny", "1", "k" * 300]


def places(tree, path=()):
    """Every place inside an input, outer places first."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from places(value, (*path, key))


def spoiled(tree, path, how, value, new):
    """An input with one place replaced or removed, or a key beside it; and keys of which a refusal names one."""
    tree = deepcopy(tree)
    *outer, last = path
    node = tree
    for key in outer:
        node = node[key]
    if how == "remove":
        del node[last]
    else:
        last = new if how == "add" else last
        node[last] = value() if getattr(value, "__name__", "") == "<lambda>" else deepcopy(value)
    return tree, [str(key) for key in (*outer, last, *(node if isinstance(node, dict) else [])) if isinstance(key, str)]


ACTION = [0.4, -0.2]
RESET = {"seed": 3, "options": {
    "scenario": {"object_mass": 0.3, "contact_stiffness": 1e5, "restitution": 0.5, "distance": 0.2},
    "record": {"noise_seed": 7, "reaction_delay": 0.01, "tool_mass": 0.1},
}}  # fmt: skip
ARGUMENTS = EVERYTHING_DRAWN["mechanism"] | {
    "alarm": "reading", "dissipation": "exact", "force_weight": 0.01, "control_period": 0.02, "rtol": 1e-6,
    "velocity_range": [-0.5, 1.0], "acceleration_range": [1.0, 8.0], "past_readings": 2, "privileged": True,
    "observe_range_noise": True, "deflection_sensor": True,
}  # fmt: skip
ARGUMENTS = {name: list(value) if isinstance(value, tuple) else value for name, value in ARGUMENTS.items()}
VECTOR = {"num_envs": 2, "threads": 1, "autoreset_mode": "SameStep", "max_episode_steps": 9, "tool_mass": 0.2,
          "per_slot": [{"tool_mass": 0.1}, {"coupling": {"type": "Rigid"}}]}  # fmt: skip
LOG = {"time": TIME[::5].tolist(), "force": FORCE[::5].tolist()}
SETUP = tomllib.loads(TEXT)
SETUP["training"] |= {"time_weight": [0.5, 8.0], "nominal": 0.5, "teacher": "mine", "activation": "relu", "rtol": 1e-6}
SETUP["training"]["imitation_steps"] = SETUP["training"]["steps"]
SETUP["baselines"] |= {"against": ["mine"], "tuned": {"mine": {"rule": "Ranged", "jitter": 0.1}}}
SETUP["baselines"]["bound"] = "linear-blind"
SETUP["evaluation"] |= {"nominal": {"robot": "rigid"}, "typical": 2.0}
SETUP["evaluation"]["varied"] = {"tool_mass": {"times": [0.8, 1.1]}, "robot": ["rigid"], "scenario": ["hard"]}
MEASURED = tomllib.loads(SCENE_FILE)
MEASURED["sensor"]["force"] |= {"low_pass": 1e3, "bias": "estimated", "noise": 0.2}
CONTENT, ARRAYS = Ensemble([made_up_policy(sizes=(3,))], 0).packed()
OWN_SCENARIOS = {"ranges": {"object_mass": [0.1, 0.2]}, "seed": 3, "count": 5, "environment": {"tool_mass": 0.2}}


def step(env, actions):
    env.reset(seed=0)
    return list(env.step(actions)[:2])


def read_log(source):
    log = logs_of.read(source, "log")
    logs_of.check(log, SCENE, MOTION, dict.fromkeys(log.columns, ig.Sensor()))


def written(tree, folder, suffix):
    path = folder / f"{len(os.listdir(folder))}{suffix}"
    if suffix == ".toml":
        path.write_text(tomli_w.dumps(tree), encoding="utf-8-sig")
    elif suffix == ".json":
        path.write_text(json.dumps(tree))
    elif suffix == ".csv":
        with path.open("w", newline="", encoding="utf-8-sig") as file:
            columns = [value if isinstance(value, list) else [value] for value in tree.values()]
            csv.writer(file).writerows([tree, *zip_longest(*columns)])
    else:
        path.write_bytes(archive.archive_of(FORMAT, tree, ARRAYS))
    return path


def reset(env, tree):
    return begin(env, tree.get("seed"), tree.get("options"))


POLICY, BATCH, DRAWN = made_up_policy(), gym.make_vec(ID, num_envs=2), {"tool_mass": (0.1, 0.2)}
SLOTS = RESET | {"options": RESET["options"] | {"reset_mask": [True, True]}}
ANY = PLAIN + PYTHON
BORDERS = {
    "make": (ARGUMENTS, ANY, lambda tree, _: gym.make(ID, **tree).reset(seed=0)[0]),
    "make a batch": (VECTOR, ANY, lambda tree, _: gym.make_vec(ID, **tree).reset(seed=0)[0]),
    "actions": ({"action": [ACTION] * 2}, ANY, lambda tree, _: step(BATCH, tree.get("action"))),
    "reset": (RESET, ANY, lambda tree, _: reset(gym.make(ID, **DRAWN), tree)),
    "reset of a batch": (SLOTS, ANY, lambda tree, _: reset(gym.make_vec(ID, num_envs=2, **DRAWN), tree)),
    "reset of stable-baselines3": (RESET, ANY, lambda tree, _: reset(ImpactVecEnv(2, **DRAWN), {**tree, "seed": 0})),
    "set-up": (SETUP, PLAIN, lambda tree, folder: load_setup(written(tree, folder, ".toml"))),
    "scene": (MEASURED, PLAIN, lambda tree, _: parse(tree, ("contact.stiffness",))),
    "log": (LOG, ANY, lambda tree, _: read_log(tree)),
    "log's file": (LOG, PLAIN, lambda tree, folder: read_log(written(tree, folder, ".csv"))),
    "scenarios": (OWN_SCENARIOS, PLAIN, lambda tree, folder: scenarios_from(str(written(tree, folder, ".json")), None)),
    "policy": (CONTENT, PLAIN, lambda tree, folder: load_policy(written(tree, folder, ".npz")).predict(np.zeros(8))[0]),
    "observation": ({"observation": [0.0] * 8}, ANY, lambda tree, _: POLICY.predict(tree.get("observation"))[0]),
    **{f"{kind}'s name": ({kind: "test"}, ANY, lambda tree, _, load=load, kind=kind: load(tree.get(kind)))
       for kind, load in {"set-up": load_setup, "policy": load_policy, "set": evaluation_sets.load}.items()},
}  # fmt: skip
ALSO_NAMED = {
    "policy": [".npz is no policy of this version"], "set-up": ["evaluation.weights"],
    "log's file": ["line "], "reset": ["option"], "reset of a batch": ["option"],
}  # fmt: skip
"""Words that a refusal may contain instead of a key, such as the line of a table."""


def spoiled_inputs(good, hostile, chance):
    """Each place with some hostile values, removed, and with a hostile key beside it."""
    paths = [*places(good)]
    for path in chance.sample(paths, min(MOST_PLACES, len(paths))):
        for how in ["replace"] * TRIES + ["remove", "add"] * isinstance(path[-1], str):
            yield spoiled(good, path, how, chance.choice(hostile), chance.choice(KEYS))


@pytest.mark.filterwarnings("ignore::UserWarning")  # an unlikely unit, or objects out of reach
@pytest.mark.parametrize("border", BORDERS)
def test_one_hostile_place_works_or_is_named_in_one_line(tmp_path, border):
    good, hostile, use = BORDERS[border]
    for tree, keys in spoiled_inputs(good, hostile, random.Random(os.environ.get("HOSTILE", border))):
        try:
            result = use(tree, tmp_path)
        except ValueError as error:
            says = str(error).partition(" was raised from the environment creator")[0]  # the rest is Gymnasium's
        else:
            assert all_finite(result)
            continue
        assert "\n" not in says
        assert len(says) < 3000
        parts = {part for key in keys for part in (key, repr(key)[1:-1], key.rpartition(".")[2])}
        assert any(part in says for part in [*parts, *ALSO_NAMED.get(border, ())]), says
