"""The environment agrees with the independent solver of the whole task."""

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from episodes import ROBOT, Given

import impact_gym as ig
from agents import load_policy
from agents.baselines import PaperTrapezoid
from agents.baselines.tuned import load_baseline
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.setups import load_setup
from experiments.reference.task import play, rescore
from impact_gym.task import Task
from impact_gym.task.scenario import FIELDS

RIGID = {"coupling": {"type": "Rigid"}}
RIPPLING = json.loads((Path(__file__).parents[1] / "helpers" / "rippling_scenes.json").read_text("utf-8"))
"""Draws and actions of two episodes of `ranged-robust`.

In each the force of a soft contact on an oscillating robot falls to 0, rises and falls to 0 again in one step.
"""


def both(controllers, numbers, options, frozen="validation", rtol=1e-8):
    """The results of the environment and of the reference in these scenarios of a set."""
    stage = ScenarioBatch.of(frozen, len(numbers), Task(rtol=rtol, **options), time_weight=[1.0])
    return stage.play(controllers[0]), rescore(controllers[1], frozen, numbers, options, 1.0)


def assert_same(fast, slow, velocity_error):
    assert np.array_equal(slow["contact_count"], fast.contact_count)
    assert np.array_equal(slow["missed"], fast.missed)
    assert slow["object_velocity"] == pytest.approx(fast.object_velocity, rel=0, abs=velocity_error)
    assert slow["approach_time"] == pytest.approx(fast.approach_time, rel=0, abs=1e-9)
    assert slow["peak_force"] == pytest.approx(fast.peak_force, rel=1e-6)


@pytest.mark.parametrize(("setup", "controller", "velocity_error"), [
    ("linear-blind", PaperTrapezoid(), 1e-8),
    # if a bit of a float32 observation differs, the command may differ by its resolution of 1e-6 m/s
    ("linear-blind", load_policy("linear-blind"), 1e-6),
    ("linear-ranged", load_policy("linear-ranged"), 1e-6),
    ("bistable-blind", load_baseline("bistable-constant-speed", 1.0), 1e-7),
], ids=["paper", "blind policy", "ranged policy", "bistable"])  # fmt: skip
def test_environment_has_the_results_of_the_reference(setup, controller, velocity_error):
    fast, slow = both([controller, controller], range(4), load_setup(setup).environment)
    assert not slow["missed"].any()
    assert_same(fast, slow, velocity_error)


@pytest.mark.parametrize(("frozen", "options", "rows", "velocity_error"), [
    *(("validation", {"alarm": alarm, "control_period": period, "reaction_delay": delay}, 4, 1e-8)
      for alarm in ("force", "reading")
      for period, delay in ((0.016, 0.016), (0.011, 0.0), (0.016, 0.04), (0.004, 0.016), (0.008, 0.005), (0.15, 0.04))),
    ("validation", {"coupling": ig.Bistable(), "deflection_sensor": True, "range_noise": 0.0}, 3, 1e-7),
    ("validation", {"range_noise": 0.01, "deflection_sensor": True, "privileged": True}, 3, 1e-7),
    ("validation", {"range_noise": 0.02, "range_bias": -0.01, "observe_range_noise": True, "alarm": "reading"}, 3,
     1e-7),
    ("validation", {"reaction_delay": 0.04, "control_period": 0.011, "deflection_sensor": True}, 3, 1e-7),
    ("validation", {"reaction_delay": 0.0, "alarm_threshold": 5.0, "dissipation": "exact", "tool_mass": 0.2}, 3, 1e-7),
    ("hard", {"coupling": ig.SpringDamper(150.0, 0.1), "reaction_delay": 0.005}, 3, 1e-7),
    ("hard", dict(load_setup("bistable-blind").environment), 3, 1e-7),
    ("validation", {"robot": ROBOT, "deflection_sensor": True}, 3, 1e-7),
    ("validation", {"velocity_range": (-0.1, 1.0), "acceleration_range": (0.5, 8.0), "privileged": True}, 3, 1e-7),
    ("validation", {"robot": ROBOT} | RIGID, 3, 1e-7),
    ("validation", {"friction": 0.3, "after_alarm": 0.2, "horizon": 1.0}, 4, 1e-8),
    ("validation", {"friction": 0.8, "dissipation": "fixed", "reference_velocity": 0.5} | RIGID, 4, 1e-8),
], ids=str)  # fmt: skip
def test_environment_has_the_results_and_observations_of_the_reference_for_random_actions(
    frozen, options, rows, velocity_error
):
    actions = np.random.default_rng(3).uniform([-0.8, -1.0], [1.2, 1.0], (1000, rows, 2)).astype(np.float32)
    controllers = Given(np.clip(actions, -1.0, 1.0)), Given(np.clip(actions, -1.0, 1.0))
    assert_same(*both(controllers, range(rows), options, frozen), velocity_error)
    expected, seen = (np.array(controller.seen) for controller in controllers)
    assert len(expected) == len(seen)
    assert seen.dtype == np.float32
    for row in range(rows):  # after its end, the reference repeats the observation before the last step
        steps = 1 + np.count_nonzero(np.diff(seen[:, row, 2]))
        assert 0.24 / options.get("control_period", 0.016) < steps <= len(seen)
        assert seen[:steps, row] == pytest.approx(expected[:steps, row], rel=0, abs=1.3e-7)  # bits of a float32


@pytest.mark.parametrize("episode", RIPPLING, ids=["once", "twice"])
@pytest.mark.parametrize("rtol", [1e-5, 1e-6])
def test_contact_whose_force_falls_to_0_several_times_in_a_step_ends(episode, rtol):
    setup, drawn = load_setup("ranged-robust").environment, episode["drew"]
    env, actions = gym.make("ImpactApproach-v0", **setup, rtol=rtol), np.array(episode["actions"], np.float32)[:, None]
    env.reset(seed=0, options={"record": drawn})
    for (action,) in actions:
        _, _, terminated, _, info = env.step(action)
    assert terminated
    assert info["status"] == "ok"
    task = Task(**setup).at(drawn)
    fixed = {name: getattr(task, name) for name in ("tool_mass", "coupling", "robot", "alarm", "alarm_threshold")}
    scenario = {name: drawn[name] for name in FIELDS}
    options = fixed | {"reaction_delay": drawn["reaction_delay"]}
    slow = play(Given([*actions, actions[-1]]), scenario, options=options, time_weight=1.0)
    assert info["object_velocity"] == pytest.approx(slow.object_velocity, abs=0.1 * rtol)
    assert info["contact_count"] == slow.contact_count
