"""What each table of refusals.toml calls, and the Python values of its texts "=...": both evaluated in this module."""

import os
import tomllib
from dataclasses import replace  # noqa: F401
from functools import cache, partial
from itertools import count
from pathlib import Path

import gymnasium as gym
import made_up_arms
import numpy as np
import pytest
import tomli_w
from episode_runs import ID, assert_identical, begin, encode
from made_up_policies import made_up_policy
from recorded_hits import FORCE, MOTION, NOISE, SCENE, SCENE_FILE, TIME, put  # noqa: F401
from refusal import changed

import impact_gym as ig
from agents import load_policy, load_setup
from agents.baselines import PaperTrapezoid  # noqa: F401
from agents.policies import Ensemble
from agents.policies.policy import FORMAT
from experiments.design.options import DesignOptions
from experiments.play import __main__ as playing
from experiments.report import __main__ as reports
from impact_gym.identification.__main__ import parse
from impact_gym.robot import all_joints, default_approach
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.support.archive import archive_of
from impact_gym.task import evaluation_sets

MOMENTS, APPROACH = count(1), default_approach()
MAKERS = (gym.make, gym.make_vec, lambda _, num_envs=2, **options: ImpactVecEnv(num_envs, **options))
TWO = partial(gym.make_vec, num_envs=2)
STIFF_SHOULDER = partial(made_up_arms.edited, old=made_up_arms.SHOULDER, new=r'\1"0.2" upper="0.4"')
HARD = (evaluation_sets.SHIPPED / "hard.csv").read_text()


def value_of(text):
    """The value of a Python expression, such as "FORCE / 1e3"."""
    return eval(text, globals())


def read_file(name, read, text):
    Path(name).write_text(text)
    read(name)


def set_up_file(text="", **tree):
    Path("bad.toml").write_text(text or tomli_w.dumps(tree))
    os.utime("bad.toml", ns=(moment := next(MOMENTS), moment))  # read anew, however soon after the last one
    return load_setup("bad.toml")


def report(out="out", **options):
    """A refused report writes nothing."""
    Path("crooked.py").write_text("class Rule:\n    def predict(self, seen, **more):\n        return seen[0], None\n")
    try:
        reports.write(reports.ReportOptions(**{"policy": ("linear-blind",), "out": Path(out), **options}))
    finally:
        assert not Path("out").exists()


def policy_file(content, arrays):
    packed, weights = Ensemble([made_up_policy(sizes=())], 0).packed()
    Path("policy.npz").write_bytes(archive_of(FORMAT, changed(packed, content), weights | arrays))
    load_policy("policy.npz")


def refusing(make, call):
    """A refused call changes nothing: steps and draws, which a critic observes, are those of a twin without it."""
    env, twin = (make(ID, tool_mass=(0.1, 0.2), privileged=True) for _ in range(2))
    assert_identical(begin(env, seed=7), begin(twin, seed=7))
    with pytest.raises(ValueError, match=r"option|action") as refusal:
        call(env)
    good = np.broadcast_to(encode(1.0, 8.0), (2,) if make is gym.make else (2, 2))
    assert_identical(env.step(good), twin.step(good))
    assert_identical(begin(env, options={}), begin(twin, options={}))
    raise refusal.value


def stepped(make, action):
    """In a batch the action of the last slot is bad."""
    bad = action if action is None or make is gym.make else np.stack([np.zeros_like(action), action])
    refusing(make, lambda env: env.step(bad))


def arm(make=made_up_arms.rods, **options):
    return made_up_arms.elastic(make(Path()), **options)


usual_line = cache(lambda: arm().along((0.1, 1.6), (1.0, 0.5, 0.0), 0.2))
CALLS = {
    "impact-gym report": report, "set-up file": set_up_file, "set-up": set_up_file,
    "policy file": policy_file,
    "make": [partial(make, ID) for make in MAKERS], "make_vec": partial(gym.make_vec, ID),
    "make with an operator": [partial(make, ID) for make in MAKERS],
    "make a batch of one or stable-baselines3's": [partial(make, ID) for make in MAKERS[1:]],
    "step": [partial(stepped, make) for make in (gym.make, TWO)],
    "set_scenario": [lambda scenario, make=make: make(ID).unwrapped.set_scenario(scenario) for make in MAKERS],
    "reset options": [lambda make=make, **options: refusing(make, lambda env: begin(env, options=options))
                      for make in (gym.make, TWO, MAKERS[2])],
    "reset": [make(ID).unwrapped.reset for make in (gym.make, gym.make_vec)],
    "reset of a batch of 2": gym.make_vec(ID, num_envs=2).reset,
    "file of delays": partial(read_file, "delays.csv", lambda name: ig.Channel(trace=Path(name))),
    "log file": partial(read_file, "log.csv", lambda name: ig.identify(name, SCENE, MOTION, ("contact.stiffness",))),
    "URDF": lambda new="", old="(?=</robot>)", **more: arm(partial(made_up_arms.edited, old=old, new=new), **more),
    "scene file": lambda changes: parse(changed(tomllib.loads(SCENE_FILE), changes), ("contact.stiffness",)),
    "altered set": partial(read_file, "mine.csv", evaluation_sets.load),
    "impact-gym play": lambda setup="teleop-rigid", **options: playing.work(playing.Play(setup, open=False, **options)),
    "DesignOptions": lambda **options: DesignOptions(out=Path(), **options), "from_urdf": arm,
    "along": lambda start, direction, length, **options: arm(**options).along(start, direction, length),
    "all_joints.simulate": lambda **given: all_joints.simulate(**{"arm": arm(), "line": usual_line()} | given),
}  # fmt: skip
"""The function that each table calls, by the table's name. If there are several, all refuse the same input."""
