"""Rows of a batch with each its own task: every one plays what the single environment of its task plays, to the bit."""

import copy
import pickle
from dataclasses import fields

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, ROBOT, TABLE, action_table, assert_identical

import impact_gym as ig
from impact_gym.envs import batch
from impact_gym.envs.batch import Batch
from impact_gym.task import Task

CHANGES = {
    "tool_mass": (0.05, 0.4, (0.05, 0.4)),
    "coupling": (
        ig.Rigid(),
        ig.SpringDamper(150.0, 0.3),
        ig.Bistable(),
        ig.Bistable(80.0, rear_stop=-0.01),
        {"type": "SpringDamper", "stiffness": (20.0, 200.0), "damping_ratio": (0.1, 1.5)},
        {"type": "Bistable", "stiffness": (40.0, 80.0), "front_stop": (0.001, 0.02), "stop_stiffness": (1e4, 1e5)},
    ),
    "robot": (
        ROBOT,
        ig.Robot(2.0, 4e4, 10.0),
        TABLE,
        {"type": "Robot", "mass": (2.0, 6.0), "stiffness": (5e4, 2e5), "damping": (10.0, 60.0)},
    ),
    "alarm": ("reading",),
    "alarm_threshold": (0.2, 15.0, (0.2, 15.0)),
    "dissipation": ("exact",),
    "force_noise": (0.3, 2.0, (0.0, 2.0)),
    "force_bias": (0.2, 1.0, (0.2, 1.0)),
    "range_noise": (0.001, 0.05, (0.001, 0.05)),
    "range_bias": (0.01, (-0.02, 0.02)),
    "acceleration_range": ((0.5, 8.0),),
    "force_weight": (0.02,),
    "control_period": (0.009, 0.03),
    "rtol": (1e-5, 1e-11),
    "max_episode_steps": (13, 41),
}
DRAWN = {
    "scenario": ({"distance": (0.1, 0.12)}, {"object_mass": (0.02, 0.1)}),
    "time_weight": (0.5, (1.0, 8.0)),
    "reaction_delay": (0.0, 0.05, (0.0, 0.04)),
}
"""What the tasks of one batch may differ in; of all, beside the first, the default with an estimate of the distance."""

OBSERVED = {
    "observe_range_noise",
    "past_readings",
    "deflection_sensor",
    "privileged",
    "velocity_range",
}  # other observations: all rows must agree
ONE_FOR_ALL = {"range_noise": 0.01}


def test_every_option_of_a_task_is_tried_here():
    assert {field.name for field in fields(Task) if field.init} == {*CHANGES, *DRAWN, *OBSERVED}


def actions_for(rows, ticks=260, seed=0):
    """Some lean forward so little that the object is missed."""
    return action_table(seed, ticks, rows, lean=(-0.1, 0.6))


def play_batch(some, actions, seeds, twin=None):
    """Episode after episode in every row: what each sees, gets, and comes to."""
    generators = [gym.utils.seeding.np_random(seed)[0] for seed in seeds]
    rows, skip = np.arange(some.size), np.zeros(some.size, np.bool_)
    some.draw_and_begin(rows, generators)
    history = [[some.observations[row].copy()] for row in rows]
    for tick, action in enumerate(actions):
        if twin is not None and tick == len(actions) // 3:
            some = twin(some)
        some.step(action, skip)
        ended = (some.episodes["terminated"] == 1) | (some.episodes["truncated"] == 1)
        for row in rows:
            flags = bool(some.episodes["terminated"][row]), bool(some.episodes["truncated"][row])
            info = some.info(row) if ended[row] else {}
            history[row] += [some.observations[row].copy(), float(some.rewards[row]), *flags, info]
        some.draw_and_begin(np.flatnonzero(ended), generators)
        for row in np.flatnonzero(ended):
            history[row].append(some.observations[row].copy())
    return history


def play_alone(options, actions, seed):
    """The same of Gymnasium's single environment."""
    env = gym.make(ID, **options)
    history = [env.reset(seed=seed)[0]]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        if truncated:
            info = env.unwrapped.episode_info()
        history += [observation, reward, terminated, truncated, info]
        if terminated or truncated:
            history.append(env.reset()[0])
    return history


def assert_each_as_alone(options, actions, seeds, threads=1):
    history = play_batch(Batch(len(options), [Task(**one) for one in options], threads), actions, seeds)
    for row, one in enumerate(options):
        assert_identical(history[row], play_alone(one, actions[:, row], seeds[row]))
    return history


def random_options(rng):
    """Options of which each is changed as often as not."""
    changed = {name: values[rng.integers(len(values))] for name, values in CHANGES.items() if rng.random() < 0.5}
    return ONE_FOR_ALL | changed


@pytest.mark.parametrize("threads", [1, 3])
def test_every_row_plays_what_the_single_environment_of_its_task_plays(threads, monkeypatch):
    monkeypatch.setattr(batch, "ROWS_PER_THREAD", 2)
    rng = np.random.default_rng(4)
    options = [random_options(rng) for _ in range(24)]
    kinds = {(type(one.get("coupling")), type(one.get("robot"))) for one in options}
    assert len(kinds) >= 8  # of couplings on robots
    history = assert_each_as_alone(options, actions_for(24), rng.integers(0, 1000, 24).tolist(), threads)
    infos = [info for row in history for info in row if isinstance(info, dict) and info]
    assert len(infos) > 100
    assert {info["missed"] for info in infos} == {True, False}
    assert max(info["contact_count"] for info in infos) > 1


@pytest.mark.parametrize(
    ("name", "value"), [(name, value) for name, some in (CHANGES | DRAWN).items() for value in some], ids=str
)
def test_one_option_changes_the_row_that_has_it_and_no_other(name, value):
    options, actions = [ONE_FOR_ALL, ONE_FOR_ALL | {name: value}, ONE_FOR_ALL], actions_for(1, ticks=160, seed=1)
    first, other, last = assert_each_as_alone(options, np.repeat(actions, 3, axis=1), [5, 5, 5])
    assert_identical(first, last)
    with pytest.raises(AssertionError):
        assert_identical(first, other)


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))], ids=["copy", "pickle"])
def test_a_copy_of_such_a_batch_goes_on_with_each_rows_own_task(twin):
    rng = np.random.default_rng(6)
    tasks = [Task(**random_options(rng)) for _ in range(8)]
    actions, seeds = actions_for(8, ticks=120, seed=3), list(range(8))
    copied, whole = (play_batch(Batch(8, tasks), actions, seeds, copier) for copier in (twin, None))
    assert_identical(copied, whole)


@pytest.mark.parametrize("count", [0, 2, 4])
def test_a_batch_needs_one_task_or_one_for_each_row(count):
    with pytest.raises(ValueError, match=f"3 rows needs one task for all or 3 of them, got {count}"):
        Batch(3, [Task()] * count)


@pytest.mark.parametrize("option", [
    {"deflection_sensor": True}, {"privileged": True}, {"range_noise": 0.01}, {"velocity_range": (0.0, 1.0)},
], ids=str)  # fmt: skip
def test_rows_that_observe_different_things_are_refused_and_the_option_and_the_row_named(option):
    with pytest.raises(ValueError, match=rf"(?s)(?=.*the same observations)(?=.*{next(iter(option))})(?=.*row 1)"):
        Batch(3, [Task(), Task(**option), Task()])
