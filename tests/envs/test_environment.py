"""The environment plays the physics of `simulate` and of the independent solver; its actions are in SI units."""

import json
from itertools import product
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import ID, PAPERS_SPRING, ROBOT, Always, Given, encode, play, scenes_of

import impact_gym as ig
from agents.baselines import PaperTrapezoid
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.setups import load_setup
from experiments.reference import task as slow
from impact_gym.task import ActionSpec, Task
from impact_gym.task.scenario import FIELDS

COUPLINGS = [PAPERS_SPRING, ig.SpringDamper(150.0, 0.2), ig.Rigid(), ig.Bistable()]
PERIODS_AND_DELAYS = [
    (0.016, 0.016), (0.004, 0.016), (0.008, 0.016), (0.011, 0.016), (0.016, 0.0), (0.016, 0.005), (0.016, 0.040),
    (0.011, 0.040),
]  # fmt: skip


@pytest.mark.parametrize("options", [
    *({"coupling": coupling, "control_period": period, "reaction_delay": delay}
      for coupling, (period, delay) in product(COUPLINGS, PERIODS_AND_DELAYS)),
    *({"coupling": coupling, "friction": friction} for coupling, friction in product(COUPLINGS, (0.1, 0.5))),
    {"alarm_threshold": 5.0}, {"alarm_threshold": 0.2}, {"dissipation": "exact"}, {"scenario": "hard"},
    {"dissipation": "fixed"}, {"coupling": ig.SpringDamper(150.0, stroke=0.018)},
    {"velocity_range": (-1.0, 2.0), "acceleration_range": (0.5, 20.0)},
], ids=str)  # fmt: skip
def test_papers_rule_played_in_the_environment_equals_simulate(options):
    coupling, friction = options.get("coupling", PAPERS_SPRING), options.get("friction", 0.0)
    # a bistable tool's flight has no closed form and multiplies errors near the alignment
    rtol, flight_error = (1e-11, 1e-11) if isinstance(coupling, ig.Bistable) or friction else (1e-8, 1e-12)
    task, late = Task(rtol=rtol, **options), []
    played = ScenarioBatch(31, 12 if friction else 60, task).play(PaperTrapezoid().for_task(task))
    brake = ig.Brake(options.get("alarm_threshold", 1.0), options.get("reaction_delay", 0.016), 8.0)
    law = {"dissipation": options.get("dissipation", "hu-guo"), "friction": friction}
    for row, struck in enumerate(scenes_of(played, coupling, **law)):
        outcome = ig.simulate(struck, ig.Trapezoid(1.0, 8.0, brake), duration=5.0, rtol=rtol)
        velocity = outcome.peak_object_velocity if friction else outcome.object_velocity
        assert played.object_velocity[row] == pytest.approx(velocity, rel=0, abs=1e-9)
        assert played.approach_time[row] == pytest.approx(outcome.contacts[0].start, rel=0, abs=flight_error)
        assert played.peak_force[row] == pytest.approx(outcome.peak_force, rel=1e-8)
        if friction:
            assert played.slide[row] == pytest.approx(outcome.slide, rel=1e-7)
            late.append(played.rest_time[row] - outcome.rest_time)
        else:
            assert played.contact_count[row] == len(outcome.contacts)
    if friction:
        assert played.slide.max() > 0.01
        assert np.min(late) > -1.5e-3  # in an episode, rest is detected at control steps, after it each ms
        assert np.percentile(late, 90) < 1.5e-3
        assert np.max(late) < 2.0 * task.control_period


@pytest.mark.parametrize(("options", "count"), [
    ({}, 75), ({"control_period": 0.008}, 150), ({"control_period": 0.011, "missed_cost": 3.5}, 110),
    ({"horizon": 0.4}, 25), ({"horizon": 2.4, "missed_cost": 3.5, "time_weight": 0.7}, 150),
], ids=str)  # fmt: skip
@pytest.mark.parametrize("velocity", [0.0, -0.5])
def test_object_never_reached_is_missed_after_the_horizon(options, count, velocity):
    env = gym.make(ID, **options)
    horizon, cost, weight = options.get("horizon", 1.2), options.get("missed_cost", 2.0), options.get("time_weight", 2)
    observations, rewards, info = play(env, Always(velocity, 20.0), seed=1)
    assert (info["approach_time"], info["missed"], info["peak_force"], len(rewards)) == (horizon, True, 0.0, count)
    terms = {"time": -weight * horizon, "velocity": 0.0, "force": 0.0, "missed": -cost}
    assert info["reward_terms"] == pytest.approx(terms, rel=1e-12)
    longest = {0.4: 0.55, 1.2: 1.5, 2.4: 3.0}[horizon]  # the observation's scale, s
    assert observations[-1, 2] == pytest.approx(2.0 * horizon / longest - 1.0, rel=0, abs=1.3e-7)


@pytest.mark.parametrize("after", [0.15, 0.3])
def test_episode_ends_a_given_time_after_the_alarm(after):
    env = gym.make(ID, after_alarm=after, max_episode_steps=200)
    last = play(env, PaperTrapezoid(), 1).observations[-1]
    assert env.unwrapped.observation_spec.decode(last, "time_since_alarm") == pytest.approx(after, rel=1e-6)


def test_touch_too_soft_for_the_alarm_lasts_to_the_horizon():
    crawl = Always(0.05, 1.0)
    soft = {"object_mass": 0.1, "contact_stiffness": 1e3, "restitution": 0.5, "distance": 0.02}
    observations, rewards, info = play(gym.make(ID), crawl, scenario=soft)
    assert info["scenario"] == soft
    assert not observations[:, 3].any()
    assert (0.0 < info["peak_force"] < 1.0, info["missed"], len(rewards)) == (True, False, 75)
    assert info["approach_time"] < 0.6
    outcome = slow.play(crawl, soft, options={}, time_weight=2.0)
    assert info["contact_count"] == outcome.contact_count >= 1
    assert info["object_velocity"] == pytest.approx(outcome.object_velocity, rel=0, abs=1e-8)


def test_float32_actions_encode_round_numbers_to_rounding():
    decode = ActionSpec(Task()).decode
    assert encode(1.0, 8.0).dtype == np.float32
    assert decode(encode([1.0, 0.0], 8.0)).tolist() == [[1.0, 8.0], [0.0, 8.0]]  # exactly, as in the paper
    velocity, part = np.meshgrid(np.arange(-50, 151) / 100, [0, 1, 2])
    acceleration = np.choose(part, (1.0, 8.0 + velocity, 20.0))
    decoded = decode(encode(velocity, acceleration))
    assert decoded == pytest.approx(np.stack([velocity, acceleration], axis=-1), rel=1e-15, abs=1e-300)


@pytest.mark.parametrize("options", [{}, {"velocity_range": (-1.0, 0.5), "acceleration_range": (0.5, 10.0)}], ids=str)
def test_flange_moves_as_the_decoded_action_says(options):
    envs = gym.make_vec(ID, num_envs=np.int64(200), scenario={"distance": 0.5}, **options)
    spec = ActionSpec(Task(**options))
    action = np.random.default_rng(0).uniform(-1.2, 1.2, (200, 2)).astype(np.float32)
    (velocity, acceleration), moved = spec.decode(action).T, []
    envs.reset(seed=0)
    for _ in range(20):
        envs.step(action)
        moved.append(envs.unwrapped.sensors()["velocity"])
    assert moved[0] == pytest.approx(np.sign(velocity) * np.minimum(0.016 * acceleration, np.abs(velocity)), rel=1e-12)
    arrived = np.abs(velocity) <= 0.3 * acceleration
    assert np.sum(arrived) > 100
    assert np.array_equal(moved[-1][arrived], velocity[arrived])
    assert spec.encode(velocity, acceleration) == pytest.approx(np.clip(action, -1.0, 1.0), abs=2e-6)


@pytest.mark.parametrize(("options", "message"), [({}, "record_trace"), ({"record_trace": True}, "trace points")])
def test_trace_that_is_not_recorded_or_too_long_is_refused(options, message):
    env = gym.make(ID, horizon=40.0, control_period=0.15, **options)
    play(env, Always(0.0, 20.0))
    with pytest.raises(RuntimeError, match=message):
        env.unwrapped.trace()


RIGID = {"coupling": {"type": "Rigid"}}
RIPPLING = json.loads((Path(__file__).parents[1] / "helpers" / "rippling_scenes.json").read_text("utf-8"))
"""Draws and actions of two episodes of `ranged-robust`.

In each the force of a soft contact on an oscillating robot falls to 0, rises and falls to 0 again in one step.
"""


def both(controllers, numbers, options, frozen="validation", rtol=1e-8):
    """The results of the environment and of the reference in these scenarios of a set."""
    stage = ScenarioBatch.of(frozen, len(numbers), Task(rtol=rtol, **options), time_weight=[1.0])
    return stage.play(controllers[0]), slow.rescore(controllers[1], frozen, numbers, options, 1.0)


def assert_same(ours, theirs, velocity_error):
    assert np.array_equal(theirs["contact_count"], ours.contact_count)
    assert np.array_equal(theirs["missed"], ours.missed)
    assert theirs["object_velocity"] == pytest.approx(ours.object_velocity, rel=0, abs=velocity_error)
    assert theirs["approach_time"] == pytest.approx(ours.approach_time, rel=0, abs=1e-9)
    assert theirs["peak_force"] == pytest.approx(ours.peak_force, rel=1e-6)


@pytest.mark.parametrize(("frozen", "options", "velocity_error"), [
    *(("validation", {"alarm": alarm, "control_period": period, "reaction_delay": delay}, 1e-8)
      for alarm in ("force", "reading")
      for period, delay in ((0.016, 0.016), (0.011, 0.0), (0.016, 0.04), (0.004, 0.016), (0.008, 0.005), (0.15, 0.04))),
    ("validation", {"coupling": ig.Bistable(), "deflection_sensor": True, "range_noise": 0.0}, 1e-7),
    ("validation", {"range_noise": 0.01, "deflection_sensor": True, "privileged": True}, 1e-7),
    ("validation", {"range_noise": 0.02, "range_bias": -0.01, "observe_range_noise": True, "alarm": "reading"}, 1e-7),
    ("validation", {"reaction_delay": 0.04, "control_period": 0.011, "deflection_sensor": True}, 1e-7),
    ("validation", {"reaction_delay": 0.0, "alarm_threshold": 5.0, "dissipation": "exact", "tool_mass": 0.2}, 1e-7),
    ("hard", {"coupling": ig.SpringDamper(150.0, 0.1), "reaction_delay": 0.005}, 1e-7),
    ("hard", dict(load_setup("bistable-blind").environment), 1e-7),
    ("validation", {"robot": ROBOT, "deflection_sensor": True}, 1e-7),
    ("validation", {"velocity_range": (-0.1, 1.0), "acceleration_range": (0.5, 8.0), "privileged": True}, 1e-7),
    ("validation", {"robot": ROBOT} | RIGID, 1e-7),
    ("validation", {"friction": 0.3, "after_alarm": 0.2, "horizon": 1.0}, 1e-8),
    ("validation", {"friction": 0.8, "dissipation": "fixed", "reference_velocity": 0.5} | RIGID, 1e-8),
], ids=str)  # fmt: skip
def test_random_actions_give_what_the_reference_gives(frozen, options, velocity_error):
    rows = 2
    actions = np.random.default_rng(3).uniform([-0.8, -1.0], [1.2, 1.0], (1000, rows, 2)).astype(np.float32)
    controllers = Given(np.clip(actions, -1.0, 1.0)), Given(np.clip(actions, -1.0, 1.0))
    assert_same(*both(controllers, range(rows), options, frozen), velocity_error)
    expected, seen = (np.array(controller.seen) for controller in controllers)
    assert len(expected) == len(seen)
    assert seen.dtype == np.float32
    for row in range(rows):  # after its end, the reference repeats the observation before the last step
        count = 1 + np.count_nonzero(np.diff(seen[:, row, 2]))
        assert 0.24 / options.get("control_period", 0.016) < count <= len(seen)
        assert seen[:count, row] == pytest.approx(expected[:count, row], rel=0, abs=1.3e-7)  # bits of a float32


@pytest.mark.parametrize("episode", RIPPLING, ids=["once", "twice"])
@pytest.mark.parametrize("rtol", [1e-5, 1e-6])
def test_contact_whose_force_is_0_twice_in_a_step_ends(episode, rtol):
    setup, drawn = load_setup("ranged-robust").environment, episode["drew"]
    env, actions = gym.make(ID, **setup, rtol=rtol), np.array(episode["actions"], np.float32)
    _, rewards, info = play(env, Given(actions), 0, record=drawn)
    assert (len(rewards), info["status"]) == (len(actions), "ok")
    task = Task(**setup).at(drawn)
    fixed = {name: getattr(task, name) for name in ("tool_mass", "coupling", "robot", "alarm", "alarm_threshold")}
    scenario = {name: drawn[name] for name in FIELDS}
    options = fixed | {"reaction_delay": drawn["reaction_delay"]}
    expected = slow.play(Given([*actions[:, None], actions[-1:]]), scenario, options=options, time_weight=1.0)
    assert info["object_velocity"] == pytest.approx(expected.object_velocity, abs=0.1 * rtol)
    assert info["contact_count"] == expected.contact_count
