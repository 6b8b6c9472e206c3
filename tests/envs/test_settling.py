"""How episodes end: V_p is final or the status says that it is not; friction, limits of the task, any input."""

import math
from itertools import cycle
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
import solver_scenes
from episode_runs import ID, ROBOT, all_finite, play
from hypothesis import given, settings
from hypothesis import strategies as st
from random_tasks import STORM, rows_of_tasks

import impact_gym as ig
from agents.baselines import ConstantSpeed, PaperTrapezoid
from agents.evaluate.scenario_batch import ScenarioBatch
from impact_gym.envs.infos import SLIDE
from impact_gym.physics.impact import GRAVITY
from impact_gym.task import Task

SEED, SOFT = 7, {"contact_stiffness": (1.0, 100.0), "object_mass": (1.0, 5.0)}
HEAVY = {"contact_stiffness": (1.0, 1e4), "object_mass": (10.0, 1e4)}
FAMILIES = [  # coupling, robot, scenario, number of episodes, and whether all of them settle
    (ig.SpringDamper(5.0, 0.0), None, {}, 2000, True), (ig.SpringDamper(50.0, 0.003), None, {}, 2000, True),
    (ig.SpringDamper(50.0, 1.0), None, SOFT, 500, True), (ig.Bistable(), None, SOFT, 100, True),
    (ig.SpringDamper(2.0, 0.1), None, {"object_mass": (5.0, 10.0)}, 500, True),
    (ig.SpringDamper(50.0, 0.0), ROBOT, {}, 100, True), (ig.SpringDamper(50.0, 0.01), ROBOT, HEAVY, 60, False),
    (ig.Rigid(), None, HEAVY, 400, False), (ig.SpringDamper(2.0, 0.1), None, HEAVY, 400, False),
    (ig.Bistable(), None, HEAVY, 60, False),
]  # fmt: skip
RULE, MOTION = ConstantSpeed(1.0, 8.0), ig.Trapezoid(1.0, 8.0, ig.Brake(threshold=1e-3))


@pytest.mark.parametrize(("coupling", "robot", "scenario", "count", "settles"), FAMILIES, ids=str)
def test_settled_velocity_is_that_of_a_minute_later(coupling, robot, scenario, count, settles):
    task = {"coupling": coupling, "robot": robot, "scenario": scenario, "alarm_threshold": 1e-3}
    episodes = ScenarioBatch(SEED, count, Task(**task), lenient=True).play(RULE)  # not settled counts as missed
    assert (episodes.contact_count > 0).all()
    chain = solver_scenes.scene(coupling=coupling, robot=robot)
    paths = ("object.mass", "contact.stiffness", "contact.restitution", "object.distance")
    columns = dict(zip(paths, episodes.scenario.values(), strict=True))
    later = ig.sweep(chain, MOTION, columns, duration=60.0)
    settled, gap = ~episodes.missed, np.abs(episodes.object_velocity - later.object_velocity)
    assert gap[settled].max() < 1e-7
    assert np.array_equal(episodes.contact_count[settled], later.contact_count[settled])
    assert settled.any()
    assert settled.all() == settles
    assert settles or gap[~settled].max() > 1e-4


def test_status_says_that_an_episode_has_not_settled():
    task = {"scenario": {"object_mass": 1e4}, "coupling": ig.SpringDamper(2.0)}
    info = play(gym.make(ID, **task), RULE, SEED).info
    assert info["status"].startswith("not settled")
    assert 0.0 < info["object_velocity"] == -info["reward_terms"]["velocity"]
    assert info["reward_terms"]["missed"] == 0.0
    with pytest.raises(RuntimeError, match=f"scenario with seed {SEED}: not settled"):
        ScenarioBatch(SEED, 2, Task(**task)).play(RULE)


def test_info_has_slide_and_rest_time_only_with_friction():
    usual = {"object_velocity", "approach_time", "peak_force", "contact_count", "missed", "time_weight", "reward_terms",
             "scenario", "record", "status"}  # fmt: skip
    for options in ({}, {"friction": 0.0}):
        assert play(gym.make(ID, **options), PaperTrapezoid()).info.keys() == usual
    missed = play(gym.make(ID, friction=0.3), ConstantSpeed(0.05)).info
    assert missed.keys() == usual | {*SLIDE}
    assert (missed["missed"], missed["slide"], missed["object_velocity"]) == (True, 0.0, 0.0)
    played, smooth = (ScenarioBatch(0, 50, Task(friction=each)).play(PaperTrapezoid()) for each in (0.3, None))
    assert (played.slide >= played.object_velocity**2 / (0.6 * GRAVITY) * (1 - 1e-9)).all()
    assert np.isfinite(played.rest_time).all()
    assert smooth.slide is None
    assert (played.object_velocity < smooth.object_velocity).mean() > 0.9
    missed = ScenarioBatch(0, 3, Task(missed_cost=3.5)).play(ConstantSpeed(0.05))
    assert missed.loss(1.0) == pytest.approx(1.2 + 3.5)


SHORT = {"type": "SpringDamper", "stiffness": (20.0, 80.0), "stroke": (0.02, 0.2)}


@pytest.mark.parametrize(("options", "said"), [
    ({"coupling": ig.SpringDamper(50.0, stroke=0.02)}, r"stroke .* 0\.02 m, .* 20 m/s\^2 .* 0\.05 m"),
    ({"coupling": SHORT, "tool_mass": (0.1, 0.14)}, r"stroke .* 0\.02 m, .* 0\.14 m"),  # 20 m/s^2 * 0.14 kg / 20 N/m
    ({"horizon": 0.2}, r"distance .* 0\.35 m, .* 0\.2 s \(horizon\) .* 0\.244 m"),
], ids=["stroke", "shortest stroke", "distance"])  # fmt: skip
def test_short_stroke_and_objects_out_of_reach_are_warned_of(options, said):
    with pytest.warns(UserWarning, match=said):
        gym.make(ID, **options)


def powers(low, high):
    """Numbers of every order of magnitude between two."""
    return st.floats(math.log10(low), math.log10(high)).map(lambda power: float(10.0**power))


EXTREME = {
    "object_mass": powers(1e-6, 1e6), "contact_stiffness": powers(1e-2, 1e9), "restitution": powers(1e-4, 1.0),
    "distance": powers(1e-6, 0.5),
}  # fmt: skip
SPRING = st.fixed_dictionaries({"stiffness": powers(1e-3, 1e7), "damping_ratio": st.floats(0.0, 10.0)})
EXTREME_ARGUMENTS = {
    "tool_mass": powers(1e-4, 1e3), "time_weight": powers(1e-3, 1e3), "force_weight": st.floats(0.0, 10.0),
    "control_period": powers(2e-3, 0.15), "reaction_delay": st.floats(0.0, 1.0), "rtol": powers(1e-12, 1e-2),
    "force_noise": st.floats(0.0, 100.0), "coupling": SPRING.map(lambda numbers: {"type": "SpringDamper", **numbers}),
}  # fmt: skip


def check_sensors(env, seen):
    """What the controller sees, (steps, n_obs), agrees with the sensors, the state and earlier readings."""
    task, spec, now, state = env.task, env.observation_spec, env.sensors(), env.episode_state()
    assert not math.isfinite(state.end)
    for name, value in now.items():
        assert type(value) is float
        scaled = np.clip(spec.encode(name, value), spec.scaled_low[spec.index(name)], 1.0)
        assert abs(seen[-1][spec.index(name)] - scaled) <= 1e-6
    assert now["alarm"] == (state.alarm <= now["time"] < state.alarm_over - 1e-9)
    assert now["time_since_alarm"] == (now["time"] - state.alarm if now["alarm"] else 0.0)
    peak = spec.index("force_peak")
    assert seen[-1][peak] >= max(seen[-1][spec.index("force")], seen[len(seen) > 1 and -2][peak]) - 1e-6
    info = env.episode_info()
    assert not info["missed"]  # not yet
    if task.alarm == "force":
        assert state.alarm == state.detection + info["record"]["reaction_delay"]
    elif now["time"] < task.horizon - 1e-9:  # at the horizon, and at the end of a shortened step, two may arrive
        for before in range(1, min(task.past_readings, len(seen) - 1) + 1):
            for name in ("force", "deflection") if task.deflection_sensor else ("force",):
                assert seen[-1][spec.index(f"{name}_{before}")] == seen[-1 - before][spec.index(name)]


@pytest.mark.filterwarnings("ignore:SpringDamper.stroke")
@settings(STORM, max_examples=50)
@given(
    rows_of_tasks(count=1),
    st.fixed_dictionaries({}, optional=EXTREME_ARGUMENTS),
    st.fixed_dictionaries({}, optional=EXTREME),
    st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)), min_size=1, max_size=8),
)
def test_episode_of_any_arguments_is_finite_and_consistent(rows, extreme, scenario, actions):
    options, seen = rows[0] | extreme | {"max_episode_steps": None}, []
    env = gym.make(ID, **options)
    sized = cycle([np.resize(action, env.action_space.shape) for action in actions])

    def predict(observation, state=None):
        seen.append(observation)
        check_sensors(env.unwrapped, seen)
        return next(sized), state

    observations, rewards, info = play(env, SimpleNamespace(predict=predict), seed=0, scenario=scenario)
    assert all(observation in env.observation_space for observation in observations)
    assert len(rewards) < 1 + (1.2 + 0.15 + 1.0) / options.get("control_period", 0.016) + 2
    assert math.isfinite(rewards.sum())
    assert all_finite({name: value for name, value in info.items() if name not in SLIDE})  # infinite without friction
    if info["status"] != "ok" and not info["status"].startswith("not settled"):
        assert info["reward_terms"]["missed"] == -options.get("missed_cost", 2.0)
