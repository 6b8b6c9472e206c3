"""Friction under the object in the environment, and the task's own ends and costs."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, PAPERS_SPRING, play, scene

import impact_gym as ig
from agents.baselines import ConstantSpeed, PaperTrapezoid
from agents.evaluate import ScenarioBatch
from impact_gym.physics.impact import GRAVITY
from impact_gym.task import Task

SCENARIO = {"object_mass": 0.25, "contact_stiffness": 1e5, "restitution": 0.5, "distance": 0.2505}


def final(controller, **options):
    """The final info of an episode, and its last observation."""
    episode = play(gym.make(ID, **options), controller, 1, scenario=SCENARIO)
    return episode.info, episode.observations[-1]


@pytest.mark.parametrize(
    "coupling", [ig.Rigid(), PAPERS_SPRING, ig.SpringDamper(150.0, 0.2), ig.Bistable(stop_damping_ratio=0.9)], ids=str
)
@pytest.mark.parametrize("friction", [0.1, 0.5])
def test_papers_rule_on_rough_ground_leaves_what_simulate_says(coupling, friction):
    info, _ = final(PaperTrapezoid(), coupling=coupling, friction=friction)
    struck = scene(SCENARIO, coupling)
    struck = replace(struck, object=replace(struck.object, friction=friction))
    motion = ig.Trapezoid(1.0, 8.0, ig.Brake())
    outcome = ig.simulate(struck, motion, duration=5.0)
    assert info["object_velocity"] == pytest.approx(outcome.peak_object_velocity, rel=1e-9)
    assert info["slide"] == pytest.approx(outcome.slide, rel=1e-7)
    assert info["rest_time"] == pytest.approx(outcome.rest_time, abs=1.5e-3)
    assert info["slide"] > 0.0
    assert info["reward_terms"]["velocity"] == -info["object_velocity"]


def test_rest_is_noted_within_two_control_steps_and_to_a_millisecond_after_the_episode():
    spring = ig.SpringDamper(50.0)
    played, late = ScenarioBatch(0, 60, coupling=spring, friction=0.5).play(PaperTrapezoid()), []
    for row, rest_time in enumerate(played.rest_time):
        struck = scene({name: values[row] for name, values in played.scenario.items()}, spring)
        struck = replace(struck, object=replace(struck.object, friction=0.5))
        late.append(rest_time - ig.simulate(struck, ig.Trapezoid(1.0, 8.0, ig.Brake()), duration=5.0).rest_time)
    assert np.min(late) > -1.5e-3
    assert np.percentile(late, 90) < 1.5e-3
    assert np.max(late) < 2.0 * Task.control_period


def test_info_has_slide_and_rest_time_where_there_is_friction_alone():
    assert final(PaperTrapezoid(), friction=0.0)[0].keys() == final(PaperTrapezoid())[0].keys()
    missed, _ = final(ConstantSpeed(0.05), friction=0.3)
    assert missed["missed"]
    assert (missed["slide"], missed["object_velocity"]) == (0.0, 0.0)
    played = ScenarioBatch(0, 50, friction=0.3).play(PaperTrapezoid())
    assert (played.slide >= played.object_velocity**2 / (0.6 * GRAVITY) * (1 - 1e-9)).all()
    assert (played.first(3).slide == played.slide[:3]).all()
    assert np.isfinite(played.rest_time).all()
    smooth = ScenarioBatch(0, 50).play(PaperTrapezoid())
    assert smooth.slide is None
    assert (played.object_velocity < smooth.object_velocity).mean() > 0.9


def test_horizon_time_after_the_alarm_and_cost_of_a_miss_are_those_asked_for():
    info, observation = final(ConstantSpeed(0.05), horizon=0.4, missed_cost=3.5)
    assert (info["approach_time"], info["reward_terms"]["missed"]) == (0.4, -3.5)
    spec = gym.make(ID, horizon=0.4).unwrapped.observation_spec
    assert spec.decode(observation, "time") == pytest.approx(0.4, rel=1e-6)
    assert spec.scale("time").high == pytest.approx(0.55)
    assert Task(horizon=2.4).ends("horizon") == (0.0, 3.0)
    assert Task().ends("horizon") == (0.0, 1.5)
    _, observation = final(PaperTrapezoid(), after_alarm=0.3)
    spec = gym.make(ID, after_alarm=0.3).unwrapped.observation_spec
    assert spec.decode(observation, "time_since_alarm") == pytest.approx(0.3, rel=1e-6)
    assert ScenarioBatch(0, 3, missed_cost=3.5).play(ConstantSpeed(0.05)).loss(1.0) == pytest.approx(1.2 + 3.5)


def test_short_stroke_is_said_where_the_environment_is_made():
    said = r"stroke is 0\.02 m, but under 20 m/s\^2 the tool's place of rest is 0\.05 m away"
    with pytest.warns(UserWarning, match=said):
        gym.make(ID, coupling=ig.SpringDamper(50.0, stroke=0.02))
    worst = {"type": "SpringDamper", "stiffness": (20.0, 80.0), "stroke": (0.02, 0.2)}  # 20 m/s^2 * 0.14 kg / 20 N/m
    with pytest.warns(UserWarning, match=r"stroke is 0\.02 m, .* the tool's place of rest is 0\.14 m away"):
        gym.make(ID, coupling=worst, tool_mass=(0.1, 0.14))


def test_objects_beyond_the_way_of_an_episode_are_said_where_the_environment_is_made():
    with pytest.warns(
        UserWarning, match=r"distance ends at 0\.35 m, but in 0\.2 s \(horizon\) the arm gets only 0\.244 m far"
    ):
        gym.make(ID, horizon=0.2)
