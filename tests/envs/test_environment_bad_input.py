"""Bad input is refused before anything is stepped, by an error that names field, value, unit and what is allowed.

A number beyond its limits, of a wrong type, a reversed pair and an unknown key: tests/task/test_quantities.py.
"""

import math
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, Always, assert_identical, begin, play
from refusals import refused
from steered import ARM

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
REACH, DAYS = {"type": "Reach", "place_error": 0.0, "creep": 0.1}, [[0.0, 100.0], [16.0, 120.0]]


def replay(times, velocities, **more):
    return ARM | {"operator": {"type": "Replay", "time": times, "velocity": velocities, **more}}


def reach(**options):
    return ARM | {"operator": REACH} | options


ARGUMENTS = [
    ({"scenaro": "train"}, "'scenaro'", "scenario", "time_weight"),
    ({"scenario": "tests"}, "scenario", "'tests'", "hard", "test", "train"),
    ({"scenario": 3}, "scenario", "got 3"),
    ({"scenario": {"object_mass": (1.0, 2.0, 3.0)}}, "object_mass", "(1.0, 2.0, 3.0)", "pair", "kg"),
    ({"scenario": {"object_mass": (1e-10, 1e10)}}, "object_mass", "1e-10 to 1e+10", "kg", "1e+12"),
    ({"coupling": "Rigid"}, "coupling", "'Rigid'", "SpringDamper"),
    ({"coupling": {"stiffness": 50.0}}, "coupling", "type", "SpringDamper"),
    ({"coupling": SPRING}, "coupling", "needs", "stiffness"),
    ({"coupling": BISTABLE | {"front_stop": (0.02, 0.07)}}, "front_stop", "0.07", "below the stroke"),
    ({"coupling": BISTABLE | {"height": (0.02, 0.068)}}, "front_stop", "below the stroke"),
    ({"coupling": BISTABLE | {"rear_stop": (-0.02, 0.01)}}, "rear_stop", "0.01", "below 0"),
    ({"coupling": BISTABLE | {"height": 0.1}}, "height", "0.1", "free_length"),
    ({"robot": "Viper"}, "robot", "'Viper'", "Robot"),
    ({"robot": {"type": "Robot", "mass": 3.0}}, "robot", "needs", "stiffness", "damping"),
    ({"reaction_delay": np.array([[0.01, 0.02]])}, "reaction_delay", "number"),
    ({"horizon": 0.1}, "scenario.distance", "0.15 m", "below 0.0938 m", "0.1 s (horizon)"),
    ({"dissipation": "flores"}, "dissipation", "'flores'", "hu-guo", "exact", "fixed"),
    ({"reference_velocity": 1.0}, "reference_velocity", 'None unless dissipation is "fixed"'),
    ({"alarm": "bell"}, "alarm", "'bell'", "force", "reading"),
    ({"alarm": np.array([])}, "alarm", "force", "reading"),
    ({"velocity_range": 1.0}, "velocity_range", "1.0", "pair", "m/s"),
    ({"velocity_range": (1.0, 1.0)}, "velocity_range", "(1.0, 1.0)", "low below high", "m/s"),
    ({"velocity_range": (-1.0, 0.0)}, "velocity_range", "(-1.0, 0.0)", "above 0 m/s"),
    ({"deflection_sensor": 1}, "deflection_sensor", "got 1", "True or False"),
    ({"deflection_sensor": True, "coupling": ig.Rigid()}, "deflection_sensor", "Rigid"),
    ({"privileged": "yes"}, "privileged", "'yes'", "True or False"),
    ({"range_noise": 0.01, "observe_range_noise": 1}, "observe_range_noise", "got 1", "True or False"),
    ({"observe_range_noise": True}, "observe_range_noise", "without an estimate"),
    ({"range_bias": 0.01}, "range_bias", "without an estimate"),
    ({"range_bias": (-0.01, 0.01)}, "range_bias", "without an estimate"),
    ({"past_readings": 4}, "past_readings", "4", "at most 3"),
    ({"past_readings": -1}, "past_readings", "-1", "at least 0"),
    ({"past_readings": 1.0}, "past_readings", "1.0", "whole"),
    ({"past_readings": np.array([])}, "past_readings", "whole"),
    ({"max_episode_steps": 0}, "max_episode_steps", "0", "at least 1"),
    ({"max_episode_steps": 2.5}, "max_episode_steps", "2.5", "whole"),
    (ARM | {"operator": {"type": "Pilot"}}, "operator", "Pilot", "Replay"),
    (ARM | {"operator": {"type": "Reach"}}, "operator", "needs", "place_error", "creep"),
    (replay([0, 1], [0, 0.1], length=4.0), "Replay.length", "4.0 s", "at least the horizon, 8 s"),
    (replay([0, 9], [0, 0.1], length=8.0, recording=(0, 3)), "Replay.recording", "at most 2"),
    (replay([0, 1], [0, 0.7]), "Replay.velocity", "0.7 m/s", "-0.3 to 0.5 m/s"),
    (replay([0, 1], [0, -0.4]), "Replay.velocity", "-0.4 m/s", "-0.3 to 0.5 m/s"),
    (replay([0, 1, 0.5], [0, 0.1, 0]), "Replay", "1.0 s", "rise from 0 s"),
    (replay([0, math.nan], [0, 0.1]), "Replay.time[1]", "nan s", "finite"),
    (reach(operator=REACH | {"speed": 0.6}), "operator.speed", "0.6 m/s", "at most", "0.5 m/s"),
    (reach(operator=REACH | {"creep": (0.1, 0.6)}), "operator.creep", "0.6 m/s", "at most", "0.5 m/s"),
    (reach(velocity_range=(0.2, 0.5)), "velocity_range", "0.2 m/s", "not begin above 0 m/s"),
    (reach(friction=0.0), "friction", "above 0"),
    (reach(uplink={"delay": 9.0}), "uplink.delay", "9 s", "below the horizon, 8 s"),
    (reach(downlink={"delay": (0.1, 8.0)}), "downlink.delay", "8 s", "below the horizon"),
    (reach(uplink={"delay": 1.0, "jitter": 100.0}), "uplink.delay", "101 s", "8 s", "mean jitter"),
    (reach(downlink={"tail": 100.0, "tail_share": (0.0, 1.0)}), "downlink.delay", "100 s", "8 s"),
    (reach(downlink={"trace": DAYS}), "downlink.trace", "120 s", "horizon, 8 s", "ms"),
    (reach(downlink={"timeout": 0.2}), "downlink.timeout", "0.2 s", "left out"),
    (reach(uplink={"delay": 0.1, "trace": [[0, 0.1], [1, 0.1]]}), "Channel.delay", "must be 0"),
    (reach(uplink={"trace": [[0.0, 0.1], [1.0, -0.1]]}), "delay[1]", "-0.1 s", "at least 0"),
    (reach(uplink={"trace": [[0.0, 0.1], [1.0, math.nan]]}), "trace", "delay[1]", "nan s"),
    (reach(uplink={"trace": [[0.0, 0.1], [2.0, 0.1], [1.0, 0.1]]}), "trace", "2.0 s and 1.0 s", "rise from 0 s"),
    (reach(uplink={"trace": "nowhere.csv"}), "trace", "'nowhere.csv'"),
    ({"uplink": {"delay": 0.1}}, "uplink", "without an operator"),
]


def each_row(table):
    """Parametrise over rows of what is bad and the words that its refusal has, named by both."""
    return pytest.mark.parametrize("row", table, ids=lambda row: f"{row[0]} {row[1:]}"[:90])


@each_row(ARGUMENTS)
def test_every_front_end_names_a_bad_argument(row):
    bad, *says = row
    for name, make in MAKERS.items():
        if name != "single" or "max_episode_steps" not in bad:  # which is Gymnasium's there
            refused(lambda make=make: make(ID, **bad), *says)


@each_row([
    ({"num_envs": 0}, "num_envs", "0", "at least 1"),
    ({"num_envs": 2.5}, "num_envs", "2.5", "whole"),
    ({"threads": 0}, "threads", "0", "at least 1"),
    ({"threads": -1}, "threads", "-1", "at least 1"),
    ({"threads": "two"}, "threads", "'two'", "whole number"),
    ({"autoreset_mode": "never"}, "utoreset", "never"),
    ({"autoreset_mod": "NextStep"}, "'autoreset_mod'", "autoreset_mode"),
    ({"render_mode": "human"}, "render_mode", "'human'", "None", "'rgb_array'"),
    ({"render_mode": "rgb_array", "num_envs": 17}, "num_envs", "17", "at most 16"),
    ({"num_envs": 2, "per_slot": [{}]}, "per_slot", "1", "2 slots"),
])  # fmt: skip
def test_batch_names_a_bad_argument_of_its_own(row):
    bad, *says = row
    refused(lambda: gym.make_vec(ID, **bad), *says)


def test_single_environment_names_a_bad_argument_of_its_own():
    refused(lambda: ImpactApproachEnv(render_mode="ansi"), "render_mode", "'ansi'", "None", "'human'", "rgb_array")
    refused(lambda: ImpactApproachEnv(max_episode_steps=3), "max_episode_steps", "TimeLimit")  # not taken and forgotten


def test_batch_takes_its_size_from_numpy():
    assert gym.make_vec(ID, num_envs=np.int64(3)).num_envs == 3


@pytest.mark.parametrize("make", [gym.make, partial(gym.make_vec, num_envs=2)], ids=["single", "one slot of a batch"])
@each_row([
    (np.array([np.nan, 0.0], np.float32), "action", "nan", "finite"),
    (np.array([0.0, -np.inf]), "action", "-inf", "finite"),
    (np.zeros(3, np.float32), "action", "3", "shape"),
    (np.zeros((2, 2, 1), np.float32), "action", "shape"),
    (np.zeros((), np.float32), "action", "shape"),
    (np.array([True, False]), "action", "bool", "numbers"),
    (np.array(["0", "1"]), "action", "U1", "numbers"),
    (np.array([0.0, 0.5], object), "action", "object", "numbers"),
    (np.array([0.0, 0.5j]), "action", "complex", "numbers"),
    (None, "action", "numbers"),
])  # fmt: skip
def test_step_refuses_a_bad_action_and_moves_nothing(make, row):
    bad, *says = row
    env, twin = make(ID), make(ID)
    assert np.array_equal(env.reset(seed=3)[0], twin.reset(seed=3)[0])
    in_one_slot = make is not gym.make and bad is not None
    says += [str(env.action_space.shape)] if "shape" in says else []
    refused(lambda: env.step(np.stack([np.zeros_like(bad), bad]) if in_one_slot else bad), *says)
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


OPTIONS = [
    ({"scenari": {}}, "'scenari'", "'scenario'"),
    ({"scenario": 0.3}, "scenario", "0.3", "mapping"),
    ({"scenario": {"time_weight": 1.0}}, "'time_weight'", "object_mass"),
    ({"scenario": {"object_mass": (0.1, 0.2)}}, "object_mass", "number", "kg"),
    ({"record": [1.0]}, "record", "[1.0]", "mapping"),
    ({"record": {"noise": 1.0}}, "'noise'", "noise_seed"),
    ({"record": {"noise_seed": 0.5}}, "noise_seed", "0.5", "whole"),
    ({"record": {"reaction_delay": 0.017}}, "reaction_delay", "0.017 s", "at most 0.016 s"),
    ({"record": {"tool_mass": 0.5}}, "tool_mass", "0.5 kg", "at most 0.2 kg"),
    ({"record": {"coupling.stiffness": 50.0}}, "no field 'coupling.stiffness'"),
    ({"episode_index": -1}, "episode_index", "-1", "at least 0"),
    ({"episode_index": 1.5}, "episode_index", "1.5", "whole"),
]


@EVERY
def test_reset_names_bad_options_and_draws_nothing(make):
    env, twin = (make(ID, tool_mass=(0.1, 0.2)) for _ in range(2))
    assert np.array_equal(begin(env, seed=7), begin(twin, seed=7))
    for bad, *says in OPTIONS:
        refused(lambda bad=bad: begin(env, options=bad), *says)
    infos = []
    for each in (env, twin):
        begin(each, options={})
        ended = False
        while not ended:
            ended, info = step(each, Always(1.0, 8.0))
        infos.append(str(info))
    assert "object_mass" in infos[0]
    assert infos[0] == infos[1]


@each_row([
    *(({"options": options}, "options", "mapping") for options in (3, "scenario", [("scenario", {})])),
    ({"seed": [1]}, "seed", "2"), ({"seed": 1.5}, "seed", "1.5"), ({"seed": -1}, "seed", "-1"),
    *(({"options": {"reset_mask": mask}}, "reset_mask", "2 booleans")
      for mask in (np.zeros(2, bool), np.ones(3, bool), np.ones(2, int))),
    *(({"options": {"record": {"distance": values}}}, "distance", "m")
      for values in ([0.2] * 3, [0.2, "1"], [0.2, -1.0], [[0.2], [0.3]])),
])  # fmt: skip
def test_batch_names_a_bad_seed_mask_or_list(row):
    arguments, *says = row
    refused(lambda: gym.make_vec(ID, num_envs=2).reset(**arguments), *says)
    if not isinstance(arguments.get("options", {}), dict) or arguments.get("seed") == -1:
        refused(lambda: gym.make(ID).unwrapped.reset(**arguments), *says)


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
    refused(lambda: Batch(3, [Task()] * count), "3 rows", f"got {count}")


@pytest.mark.parametrize("option", [
    {"deflection_sensor": True}, {"privileged": True}, {"range_noise": 0.01}, {"velocity_range": (0.0, 1.0)},
], ids=str)  # fmt: skip
def test_rows_that_observe_different_things_are_refused_and_the_option_and_the_row_named(option):
    refused(lambda: Batch(3, [Task(), Task(**option), Task()]), "the same observations", next(iter(option)), "row 1")


def test_trace_that_is_not_kept_and_the_state_of_another_batch_are_refused():
    env = gym.make(ID, horizon=40.0, control_period=0.15)
    with pytest.raises(RuntimeError, match="record_trace"):
        env.unwrapped.trace()
    env = gym.make(ID, horizon=40.0, control_period=0.15, record_trace=True)
    play(env, Always(0.0, 20.0))
    with pytest.raises(RuntimeError, match="trace points"):  # longer than a trace can be
        env.unwrapped.trace()
    for kind in (partial(gym.make_vec, ID), ImpactVecEnv):
        state = kind(num_envs=1).unwrapped.get_state() if kind is not ImpactVecEnv else kind(1).get_state()
        envs = kind(num_envs=8)
        refused(lambda envs=envs, state=state: getattr(envs, "unwrapped", envs).set_state(state), "(1,", "(8,")


@pytest.mark.parametrize(("text", "says"), [
    ("nan,0.1\n1,0.1\n", ("time[0]", "nan s", "finite")), ("", ("trace", "rows of time and delay in s")),
    ("time,delay\n0,0.1\n1,soon\n", ("delay[1]", "nan s", "finite")),
    ("0,0.1\n1,0.1,7\n", ("trace", "rows of time and delay in s")),
    ("0;0.1\n1;0.1\n", ("trace", "rows of time and delay in s")),
])  # fmt: skip
def test_bad_file_of_delays_is_refused(tmp_path, text, says):
    (tmp_path / "delays.csv").write_text(text)
    refused(lambda: ig.Channel(trace=tmp_path / "delays.csv"), *says)
