"""Bad input is refused before anything is stepped, by an error that names what was wrong and what is allowed."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, Always, assert_identical, begin, play

import impact_gym as ig
from agents.baselines import PaperTrapezoid, encode
from impact_gym.envs.batch import Batch
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import Task

ZERO = np.zeros(2, np.float32)
MAKERS = {"single": gym.make, "vector": gym.make_vec, "stable": lambda _, **options: ImpactVecEnv(2, **options)}
EVERY = pytest.mark.parametrize("make", MAKERS.values(), ids=list(MAKERS))
SPRING, BISTABLE = {"type": "SpringDamper"}, {"type": "Bistable"}
TOO_SHORT = r"distance must begin below 0\.0938 m, got 0\.15 m: in 0\.1 s \(horizon\) the arm gets only 0\.0938 m far"

ARGUMENT_CASES = [  # beside a number beyond its limits, which tests/task has for all of them
    ({"scenaro": "train"}, TypeError, "'scenaro'.*scenario.*time_weight"),
    ({"ranges": None}, TypeError, "'ranges'.*scenario"),
    ({"scenario": "tests"}, ValueError, "hard.*test.*train.*'tests'"),
    ({"scenario": 3}, TypeError, "scenario.*3"),
    ({"scenario": {"mass": 1.0}}, ValueError, "'mass'.*object_mass"),
    ({"scenario": {"distance": (0.3, 0.2)}}, ValueError, "distance.*inverted.*0.3.*0.2 m"),
    ({"scenario": {"object_mass": (1.0, 2.0, 3.0)}}, ValueError, "object_mass.*pair"),
    ({"scenario": {"object_mass": (1e-10, 1e10)}}, ValueError, "object_mass.*factor"),
    ({"coupling": "Rigid"}, TypeError, "coupling.*Rigid.*SpringDamper"),
    ({"coupling": {"stiffness": 50.0}}, TypeError, "coupling.*type.*SpringDamper"),
    ({"coupling": SPRING}, TypeError, "coupling.*needs.*stiffness"),
    ({"coupling": SPRING | {"stifness": (40.0, 60.0)}}, TypeError, "stifness.*stiffness"),
    ({"coupling": SPRING | {"stiffness": (60.0, 40.0)}}, ValueError, "coupling.stiffness.*inverted.*N/m"),
    ({"coupling": BISTABLE | {"front_stop": (0.02, 0.07)}}, ValueError, "front_stop.*below the stroke.*0.07"),
    ({"coupling": BISTABLE | {"height": (0.02, 0.068)}}, ValueError, "front_stop.*below the stroke"),
    ({"coupling": BISTABLE | {"rear_stop": (-0.02, 0.01)}}, ValueError, "rear_stop.*below 0"),
    ({"coupling": BISTABLE | {"height": 0.1}}, ValueError, "height.*free_length"),
    ({"coupling": {"type": "Rigid", "stroke": 0.1}}, TypeError, "coupling has no field 'stroke'"),
    ({"robot": "Viper"}, TypeError, "robot.*Robot.*Viper"),
    ({"robot": {"type": "Robot", "weight": 5.0}}, TypeError, "weight.*mass"),
    ({"robot": {"type": "Robot", "mass": 3.0}}, TypeError, "robot.*needs.*stiffness.*damping"),
    ({"time_weight": (8.0, 0.5)}, ValueError, "time_weight.*8.*0.5"),
    ({"reaction_delay": np.array([[0.01, 0.02]])}, (TypeError, ValueError), "reaction_delay.*number"),
    ({"friction": (0.3, 0.1)}, ValueError, "friction"),
    ({"horizon": 0.1}, ValueError, TOO_SHORT),
    ({"dissipation": "flores"}, ValueError, "dissipation.*hu-guo.*exact.*flores"),
    ({"reference_velocity": 1.0}, ValueError, 'reference_velocity must be None unless dissipation is "fixed"'),
    ({"alarm": "bell"}, ValueError, "alarm must be one of .'force', 'reading'., got 'bell'"),
    ({"velocity_range": 1.0}, ValueError, "velocity_range.*pair.*m/s"),
    ({"velocity_range": (1.0, 1.0)}, ValueError, "velocity_range.*low below high"),
    ({"velocity_range": (-1.0, 0.0)}, ValueError, "velocity_range.*above 0"),
    ({"velocity_range": (-1e4, 1.0)}, ValueError, "velocity_range.*-1000"),
    ({"acceleration_range": (0.0, 8.0)}, ValueError, r"acceleration_range\[0\].*at least 1e-09.*m/s\^2"),
    ({"acceleration_range": (8.0, 1.0)}, ValueError, "acceleration_range.*inverted"),
    ({"deflection_sensor": 1}, TypeError, "deflection_sensor.*True or False"),
    ({"deflection_sensor": True, "coupling": ig.Rigid()}, ValueError, "deflection_sensor.*Rigid"),
    ({"privileged": "yes"}, TypeError, "privileged.*True or False"),
    ({"range_noise": 0.01, "observe_range_noise": 1}, TypeError, "observe_range_noise must be True or False, got 1"),
    ({"observe_range_noise": True}, ValueError, "without an estimate"),
    ({"range_bias": 0.01}, ValueError, "without an estimate"),
    ({"range_bias": (-0.01, 0.01)}, ValueError, "without an estimate"),
    ({"past_readings": 4}, ValueError, "past_readings.*at most 3 .*got 4"),
    ({"past_readings": -1}, ValueError, "past_readings.*at least 0, got -1"),
    ({"past_readings": 1.0}, TypeError, "past_readings.*whole"),
    ({"past_readings": np.array([])}, TypeError, "past_readings.*whole"),
    ({"alarm": np.array([])}, ValueError, "alarm must be one of"),
]


def cases(table):
    """Parametrise over rows of (what, error, message), named by what."""
    return pytest.mark.parametrize(("bad", "error", "message"), table, ids=[str(row[0])[:60] for row in table])


@EVERY
@cases(ARGUMENT_CASES)
def test_front_end_names_a_bad_argument(make, bad, error, message):
    """A wrong type or name is a ValueError too."""
    with pytest.raises(ValueError, match=message) as raised:
        make(ID, **bad)
    assert isinstance(raised.value, error)


@cases([
    ({"num_envs": 0}, ValueError, "num_envs.*at least 1.*0"),
    ({"num_envs": 2.5}, (TypeError, ValueError), "num_envs.*whole.*2.5"),
    ({"threads": 0}, ValueError, "threads.*at least 1"),
    ({"threads": -1}, ValueError, "threads.*at least 1"),
    ({"threads": "two"}, TypeError, "threads.*whole number"),
    ({"max_episode_steps": 0}, ValueError, "max_episode_steps.*at least 1"),
    ({"max_episode_steps": 2.5}, TypeError, "max_episode_steps.*whole"),
    ({"autoreset_mode": "never"}, ValueError, "(?i)autoreset_?mode"),
    ({"autoreset_mod": "NextStep"}, TypeError, "'autoreset_mod'.*autoreset_mode"),
    ({"render_mode": "human"}, ValueError, "render_mode.*None.*'rgb_array'.*'human'"),
    ({"render_mode": "rgb_array", "num_envs": 17}, ValueError, "num_envs.*at most 16.*17"),
])  # fmt: skip
def test_batch_names_a_bad_argument(bad, error, message):
    with pytest.raises(error, match=message):
        gym.make_vec(ID, **bad)


@cases([
    ({"render_mode": "ansi"}, ValueError, "render_mode.*None.*'human'.*rgb_array.*'ansi'"),
    ({"max_episode_steps": 3}, TypeError, "max_episode_steps.*TimeLimit"),  # not taken and then forgotten
])  # fmt: skip
def test_single_environment_by_itself_names_a_bad_argument(bad, error, message):
    with pytest.raises(error, match=message):
        ImpactApproachEnv(**bad)


def test_batch_takes_its_size_from_numpy():
    assert gym.make_vec(ID, num_envs=np.int64(3)).num_envs == 3


@pytest.mark.parametrize("make", [gym.make, partial(gym.make_vec, num_envs=2)], ids=["single", "one slot of a batch"])
@cases([
    (np.array([np.nan, 0.0], np.float32), ValueError, "finite.*nan"),
    (np.array([0.0, -np.inf]), ValueError, "finite.*inf"),
    (np.zeros(3, np.float32), ValueError, "shape.*2.*3"),
    (np.zeros((2, 2, 1), np.float32), ValueError, "shape"),
    (np.zeros((), np.float32), ValueError, "shape"),
    (np.array([True, False]), TypeError, "action.*numbers.*bool"),
    (np.array(["0", "1"]), TypeError, "action.*numbers.*U1"),
    (np.array([0.0, 0.5], object), TypeError, "action.*numbers.*object"),
    (np.array([0.0, 0.5j]), TypeError, "action.*numbers.*complex"),
    (None, TypeError, "action.*numbers"),
])  # fmt: skip
def test_step_refuses_a_bad_action_and_moves_nothing(make, bad, error, message):
    env, twin = make(ID), make(ID)
    assert np.array_equal(env.reset(seed=3)[0], twin.reset(seed=3)[0])
    in_one_slot = make is not gym.make and bad is not None
    with pytest.raises(error, match=message) as raised:
        env.step(np.stack([np.zeros_like(bad), bad]) if in_one_slot else bad)
    assert "shape" not in message or str(env.action_space.shape) in str(raised.value)
    good = np.broadcast_to(encode(1.0, 8.0), env.action_space.shape)
    assert_identical(env.step(good), twin.step(good))


def test_actions_outside_the_box_act_as_its_edge():
    for outside, edge in (([3.0, -1.7], [1.0, -1.0]), ([-1e30, 1e30], [-1.0, 1.0]), ([1.0000001, 2], [1.0, 1.0])):
        env, twin = gym.make(ID), gym.make(ID)
        env.reset(seed=3), twin.reset(seed=3)
        for _ in range(25):
            assert_identical(env.step(np.float32(outside)), twin.step(np.float32(edge)))


def step(env, controller):
    """Step any front end: whether all has ended, and the info."""
    slots = (env.num_envs,) if isinstance(env, ImpactVecEnv) else env.action_space.shape[:-1]
    result = env.step(controller.predict(np.zeros((*slots, 8)))[0])
    return np.all(result[2]), result[-1]


@EVERY
@cases([
    ({"scenari": {}}, ValueError, "'scenari'.*'scenario'"),
    ({"scenario": 0.3}, TypeError, "scenario.*mapping"),
    ({"scenario": {"masss": 1.0}}, ValueError, "'masss'.*object_mass"),
    ({"scenario": {"time_weight": 1.0}}, ValueError, "'time_weight'.*object_mass"),
    ({"scenario": {"object_mass": -1.0}}, ValueError, "object_mass.*at least 1e-12.*kg"),
    ({"scenario": {"object_mass": (0.1, 0.2)}}, (TypeError, ValueError), "object_mass.*number"),
    ({"record": [1.0]}, TypeError, "record.*mapping"),
    ({"record": {"noise": 1.0}}, ValueError, "'noise'.*noise_seed"),
    ({"record": {"noise_seed": 0.5}}, ValueError, "noise_seed.*whole"),
    ({"record": {"reaction_delay": 0.017}}, ValueError, "reaction_delay.*at most 0.016 s"),
    ({"record": {"tool_mass": 0.5}}, ValueError, "tool_mass.*at most 0.2 kg.*0.5"),
    ({"record": {"coupling.stiffness": 50.0}}, ValueError, "no field 'coupling.stiffness'"),
    ({"episode_index": -1}, ValueError, "episode_index.*at least 0"),
    ({"episode_index": 1.5}, TypeError, "episode_index.*whole"),
])  # fmt: skip
def test_reset_names_bad_options_and_draws_nothing(make, bad, error, message):
    env, twin = (make(ID, tool_mass=(0.1, 0.2)) for _ in range(2))
    assert np.array_equal(begin(env, seed=7), begin(twin, seed=7))
    with pytest.raises(error, match=message):
        begin(env, options=bad)
    infos = []
    for each in (env, twin):
        begin(each, options={})
        ended = False
        while not ended:
            ended, info = step(each, Always(1.0, 8.0))
        infos.append(str(info))
    assert "object_mass" in infos[0]
    assert infos[0] == infos[1]


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
@pytest.mark.parametrize("options", [3, "scenario", [("scenario", {})]], ids=repr)
def test_reset_refuses_options_that_are_no_mapping(make, options):
    with pytest.raises((TypeError, ValueError), match=r"options.*mapping"):
        make(ID).reset(options=options)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"seed": [1]}, "seed.*2"),
    ({"seed": 1.5}, "(?i)seed.*1.5"),
    ({"seed": -1}, "(?i)seed.*-1"),
    ({"options": {"reset_mask": np.zeros(2, bool)}}, "reset_mask.*2 booleans"),
    ({"options": {"reset_mask": np.ones(3, bool)}}, "reset_mask.*2 booleans"),
    ({"options": {"reset_mask": np.ones(2, int)}}, "reset_mask.*2 booleans"),
    *(({"options": {"record": {"distance": values}}}, "distance")
      for values in ([0.2] * 3, [0.2, "1"], [0.2, -1.0], [[0.2], [0.3]])),
], ids=str)  # fmt: skip
def test_batch_names_a_bad_seed_mask_or_list(arguments, message):
    with pytest.raises((TypeError, ValueError, gym.error.Error), match=message):
        gym.make_vec(ID, num_envs=2).reset(**arguments)


@pytest.mark.parametrize("make", [*MAKERS.values(), lambda _: ImpactApproachEnv()], ids=[*MAKERS, "by itself"])
def test_step_before_the_first_reset_is_refused(make):
    with pytest.raises((RuntimeError, gym.error.ResetNeeded), match="reset"):
        step(make(ID), Always(1.0, 8.0))


def test_step_after_the_end_is_refused_instead_of_rewarded_again():
    """`gym.make` lets such a step through to the environment; the batch without autoreset refuses it as well."""
    env = gym.make(ID)
    play(env, PaperTrapezoid())
    with pytest.raises((RuntimeError, gym.error.ResetNeeded), match="reset"):
        env.step(ZERO)
    env.reset()
    assert env.step(ZERO)[2] is False


@pytest.mark.parametrize("count", [0, 2, 4])
def test_batch_needs_one_task_or_one_for_each_row(count):
    with pytest.raises(ValueError, match=f"3 rows needs one task for all or 3 of them, got {count}"):
        Batch(3, [Task()] * count)


@pytest.mark.parametrize("option", [
    {"deflection_sensor": True}, {"privileged": True}, {"range_noise": 0.01}, {"velocity_range": (0.0, 1.0)},
], ids=str)  # fmt: skip
def test_rows_that_observe_different_things_are_refused_and_the_option_and_the_row_named(option):
    with pytest.raises(ValueError, match=rf"(?s)(?=.*the same observations)(?=.*{next(iter(option))})(?=.*row 1)"):
        Batch(3, [Task(), Task(**option), Task()])
