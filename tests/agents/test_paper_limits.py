"""paper-limits: an arm that can do what the paper's rule does and no more, beside one that can do more."""

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, assert_identical, play

from agents.baselines import BlindProfile, ConstantSpeed, PaperTrapezoid, RandomActions
from agents.baselines.profile import KNOTS
from agents.baselines.reaction import REACTION
from agents.baselines.tuned import load_baseline, read_tuned
from agents.evaluate import RESULTS
from agents.evaluate.stage import Stage
from agents.setups import load_setup

PAPERS, OURS = (load_setup(name).environment for name in ("paper-limits", "linear-blind"))
FASTEST = [1.5] * len(KNOTS) + [20.0] + [-0.5] * (len(REACTION) - 1) + [20.0]  # and back again


def played(controller, environment, count=500):
    found = Stage.of("test", count, **environment).play(controller.for_environment(environment))
    return {name: getattr(found, name) for name in RESULTS}


def flange(rule, environment):
    """Velocity (m/s) and acceleration (m/s^2) of the flange, through the episode and after it."""
    env = gym.make(ID, record_trace=True, **environment)
    play(env, rule.for_environment(environment), seed=3)
    trace = env.unwrapped.trace()
    steps = np.diff(trace.time) > 1e-6
    return trace.flange_velocity, (np.diff(trace.flange_velocity) / np.diff(trace.time).clip(1e-9))[steps]


def test_the_papers_rule_is_the_same_in_either_set_up():
    assert_identical(played(PaperTrapezoid(), PAPERS, 2000), played(PaperTrapezoid(), OURS, 2000))


def test_no_command_gets_more_of_the_arm_than_the_paper_does():
    velocity, acceleration = flange(BlindProfile(FASTEST), PAPERS)
    assert (velocity.min(), velocity.max()) == pytest.approx((0.0, 1.0), abs=1e-5)  # it brakes, but does not retreat
    assert np.abs(acceleration).max() == pytest.approx(8.0, abs=1e-3)
    velocity, acceleration = flange(BlindProfile(FASTEST), OURS)
    assert velocity.min() < -0.3
    assert velocity.max() > 1.2
    assert np.abs(acceleration).max() == pytest.approx(20.0, abs=1e-3)
    asked, rule = played(ConstantSpeed(1.5, 20.0), PAPERS), played(PaperTrapezoid(), PAPERS)
    assert_identical(asked, rule)  # all that the arm can is the paper's rule


@pytest.mark.parametrize("seed", range(4))
def test_nothing_arrives_before_the_papers_rule_with_its_limits(seed):
    rng, rule = np.random.default_rng(seed), played(PaperTrapezoid(), PAPERS)
    low, high = np.array([(one.low, one.high) for one in BlindProfile.PARAMETERS]).T
    for other in (BlindProfile(rng.uniform(low, high)), load_baseline("paper-limits-profile", 4.0)):
        assert (played(other, PAPERS)["approach_time"] >= rule["approach_time"]).all()
    random = Stage.of("test", 500, **PAPERS).play(RandomActions(seed))
    assert (random.approach_time >= rule["approach_time"]).all()
    sooner = played(ConstantSpeed(1.5, 20.0), OURS)["approach_time"] < rule["approach_time"]
    assert sooner.all()  # what it takes is a stronger arm


@pytest.mark.parametrize(("name", "most"), [("constant-speed", 20.0), ("paper-limits-constant-speed", 8.0)])
def test_a_tuned_constant_speed_brakes_as_hard_as_the_arm_can(name, most):
    for found in read_tuned(name)["weights"].values():
        assert min(found["parameters"]["deceleration"], most) == pytest.approx(most, rel=1e-3)
