"""Set-ups: what is shipped is whole, and a file means what it says, its table [evaluation] included."""

import math
from pathlib import Path

import numpy as np
import pytest

from agents import load_setup
from agents.setups import owner, same_environment, shipped, shipped_baselines
from agents.setups.evaluation import VARIED, Evaluation, changes, variants
from agents.setups.setup import FIXED
from agents.train.ppo import Run
from agents.tune import Tune
from impact_gym.task import Task

SPRING = {"coupling": {"type": "SpringDamper", "stiffness": [40.0, 60.0]}, "tool_mass": 0.2}


@pytest.mark.parametrize("name", shipped())
def test_load_setup_finds_all_that_is_shipped_for_a_set_up(name):
    setup = load_setup(name)
    weights = list(setup.training.time_weight)
    assert Run(setup, setup.training).environment == {**setup.environment, "time_weight": weights}
    assert {*setup.against} <= {*setup.tuned, *shipped_baselines(), *FIXED}
    assert all(owner(baseline) == setup for baseline in setup.tuned)
    setup.environment["tool_mass"] = 9.0
    assert load_setup(name).environment.get("tool_mass") != 9.0  # nobody can change a set-up for all


@pytest.mark.parametrize(("first", "second"), [
    ({}, {"tool_mass": 0.125, "coupling": {"type": "SpringDamper", "stiffness": 50.0}, "time_weight": [0.3, 8.0]}),
    ({"reaction_delay": [0.01, 0.02]}, {"reaction_delay": np.array([0.01, 0.02])}),
    ({"scenario": {"distance": [0.1, 0.2]}}, {"scenario": {"distance": (0.1, 0.2)}}),
    ({"scenario": "train"}, {"scenario": {"distance": [0.15, 0.35]}}),
], ids=str)  # fmt: skip
def test_same_environment_whatever_is_left_to_defaults_or_written_as(first, second):
    assert same_environment(first, second)
    for other in ({"tool_mass": 0.2}, {"tool_mass": [0.1, 0.15]}):
        assert not same_environment(first, other)


def test_load_setup_makes_what_a_file_says(mine):
    setup = load_setup(mine)
    single, several = setup.make(), setup.make_vec(3)
    assert np.array_equal(single.reset(seed=5)[0], several.reset(seed=5)[0][0])
    task = Task(**setup.environment)
    assert {*task.drawn} == {"tool_mass", "coupling.stiffness", "robot.stiffness", "range_noise"}
    assert (task.velocity_range, task.scenario.object_mass) == ((-0.2, 0.6), (0.2, 1.0))
    assert [*setup.tuned] == ["mine-profile"] == [*setup.against]  # what is usual, where the file says nothing
    assert setup.tuned["mine-profile"].rule == "RangedProfile"
    assert setup.folder == Path("runs/mine")
    training = setup.training
    assert (training.steps, training.rollout, training.seeds, setup.budget) == (2000, 16, 2, 16)
    assert setup.evaluation.weights == Tune((str(mine),)).weights_of(setup) == (1.0, 4.0)


@pytest.mark.filterwarnings("ignore:SpringDamper.stroke")
def test_variants_change_one_argument_each_and_leave_the_rest():
    own = Task(**SPRING)
    for change in variants(Evaluation(), SPRING):
        task = Task(**change.environment)
        assert (task == own) == (change.same or bool(change.scenarios)), change
        if change.argument == "reaction_delay":
            assert task.ranges["reaction_delay"] == (change.value, change.value)
        elif change.argument == "coupling.stiffness":
            assert change.multiple
            low, high = task.drawn.get("coupling.stiffness", (math.nan, math.nan))
            assert (low, high) == pytest.approx((40.0 * change.value, 60.0 * change.value))
            assert task.coupling.damping_ratio == own.coupling.damping_ratio
        elif change.argument == "tool_mass":
            assert task.tool_mass == pytest.approx(0.2 * change.value)
            assert task.drawn == own.drawn
    arguments = {change.argument for change in variants(Evaluation(), SPRING)}
    assert arguments == set(VARIED) - {"range_noise", "coupling.front_stop"}  # which this environment does not have


def test_variants_start_from_what_is_nominal():
    nominal = {"tool_mass": 0.2, "robot": "rigid", "force_noise": 0.0}
    varied = {"tool_mass": [0.1, 0.2], "force_noise": [3.0]}
    robot = {"type": "Robot", "mass": [3.0, 5.0], "stiffness": 1e5, "damping": 50.0}
    environment = {"tool_mass": [0.1, 0.3], "force_noise": [0.0, 3.0], "alarm": "reading", "robot": robot}
    assert set(Task(**environment).drawn) == {"tool_mass", "force_noise", "robot.mass"}
    changed = variants(Evaluation.of_table({"nominal": nominal, "varied": varied}, environment), environment)
    expected = [(0.1, 0.0, False), (0.2, 0.0, True), (0.2, 3.0, False)]
    for change, (mass, noise, same) in zip(changed, expected, strict=True):
        task = Task(**change.environment)
        assert (task.tool_mass, task.force_noise, task.robot, task.alarm) == (mass, noise, None, "reading")
        assert not task.drawn
        assert change.same == same


def test_changes_leave_out_what_makes_no_environment():
    tight = {"type": "Bistable", "free_length": 0.07, "height": 0.06995, "front_stop": 0.001, "rear_stop": -0.001}
    kept = changes("coupling.front_stop", {"times": [1.0, 4.0]}, {"coupling": tight})
    assert [change.value for change in kept] == [1.0]
