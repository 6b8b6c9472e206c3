"""The table [evaluation] of a set-up: what it says happens, a mistake in it gets one line."""

import math

import pytest

from agents import load_setup
from agents.evaluate import Validation
from agents.setup import check
from agents.setups.evaluation import VARIED, Evaluation, changes, variants
from agents.tune import Tune
from experiments.report.__main__ import ReportOptions, matchups_of
from impact_gym.envs.task import Task

SPRING = {"coupling": {"type": "SpringDamper", "stiffness": [40.0, 60.0]}, "tool_mass": 0.2}


def written(tmp_path, evaluation, environment="tool_mass = 0.2"):
    path = tmp_path / "mine.toml"
    path.write_text(f"[environment]\n{environment}\n[evaluation]\n{evaluation}\n")
    return path


def test_its_weights_are_those_of_tuning_validation_and_report(tmp_path):
    setup = load_setup(written(tmp_path, "weights = [3.0, 0.5]\ncurve = [1.0]\ntypical = 3.0"))
    assert setup.evaluation.weights == (0.5, 3.0)
    assert Tune((str(setup.path),)).weights_of(setup) == (0.5, 3.0)
    assert Tune((str(setup.path),), weights=(1.0,)).weights_of(setup) == (1.0,)
    assert Validation(setup.environment, setup.evaluation.weights, 2).weights == (0.5, 3.0)


@pytest.mark.parametrize(("options", "scenarios"), [
    ({}, {"set": "test", "count": 2000}),
    ({"count": 7}, {"set": "test", "count": 7}),
    ({"scenarios": "hard", "count": 7}, {"set": "hard", "count": 7}),
])  # fmt: skip
def test_its_set_is_the_reports_unless_another_is_asked_for(options, scenarios):
    (found,) = matchups_of(ReportOptions(setups=("rigid-blind",), **options))
    assert dict(found.scenarios) == scenarios
    assert found.evaluation == load_setup("rigid-blind").evaluation


def test_each_change_is_what_it_says_and_the_rest_stays():
    own = Task(**SPRING)
    for change in variants(Evaluation(), SPRING):
        task = Task(**change.environment)
        assert (task == own) == (change.same or bool(change.scenarios)), change
        if change.argument == "reaction_delay":
            assert task.delays == (change.value, change.value)
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


def test_single_changes_start_from_what_is_nominal(tmp_path):
    evaluation = """nominal = { tool_mass = 0.2, robot = "rigid", force_noise = 0.0 }
    varied = { tool_mass = [0.1, 0.2], force_noise = [3.0] }"""
    robot = "{ type = 'Robot', mass = [3.0, 5.0], stiffness = 1e5, damping = 50.0 }"
    inline = f"tool_mass = [0.1, 0.3]\nforce_noise = [0.0, 3.0]\nalarm = 'reading'\nrobot = {robot}"
    setup = load_setup(written(tmp_path, evaluation, inline))
    assert set(Task(**setup.environment).drawn) == {"tool_mass", "force_noise", "robot.mass"}
    found = variants(setup.evaluation, setup.environment)
    expected = [(0.1, 0.0, False), (0.2, 0.0, True), (0.2, 3.0, False)]
    for change, (mass, noise, same) in zip(found, expected, strict=True):
        task = Task(**change.environment)
        assert (task.tool_mass, task.force_noise, task.robot, task.alarm) == (mass, noise, None, "reading")
        assert not task.drawn
        assert change.same == same


def test_a_change_that_leaves_no_environment_is_left_out_unless_a_file_asks_for_it(tmp_path):
    tight = {"type": "Bistable", "free_length": 0.07, "height": 0.06995, "front_stop": 0.001, "rear_stop": -0.001}
    found = [one.value for one in changes("coupling.front_stop", {"times": [1.0, 4.0]}, {"coupling": tight})]
    assert found == [1.0]
    inline = (
        "coupling = { type = 'Bistable', free_length = 0.07, height = 0.06995, front_stop = 1e-3, rear_stop = -1e-3 }"
    )
    path = written(tmp_path, "varied = { 'coupling.front_stop' = { times = [4.0] } }", inline)
    with pytest.raises(ValueError, match=r"mine.toml: evaluation.varied.coupling.front_stop: "):
        load_setup(path)


@pytest.mark.parametrize(("table", "message"), [
    ("weigths = [1.0]", r"unknown key evaluation.weigths; did you mean 'weights'\?"),
    ("weights = []", "evaluation.weights must hold weights"),
    ("weights = [1.0, 1.0]", "none twice"),
    ("weights = [0.0]", r"evaluation.weights\[0\] must be .*above 0 m/s per s"),
    ("weights = 'all'", "evaluation.weights must be a sequence of numbers"),
    ("typical = -1", "evaluation.typical must be .*above 0"),
    ("at_most = 0", "evaluation.at_most must be .*above 0"),
    ("set = 'tset'", "no evaluation set 'tset'"),
    ("set = 3", "evaluation.set must be a name"),
    ("scenarios = 1", "evaluation.scenarios must be a whole number of at least 2"),
    ("scenarios = 5000", "evaluation.scenarios must be at most the 2000 of the set"),
    ("nominal = { tool_mas = 1.0 }", "unknown key evaluation.nominal.tool_mas; did you mean 'tool_mass'"),
    ("nominal = { tool_mass = -1.0 }", "evaluation.nominal: tool_mass must be .*above 0"),
    ("nominal = 3", r"evaluation.nominal must be a table, \[evaluation.nominal\]"),
    ("varied = [1]", r"evaluation.varied must be a table, \[evaluation.varied\]"),
    ("varied = { tool_mas = [1.0] }", "unknown key evaluation.varied.tool_mas; did you mean 'tool_mass'"),
    ("varied = { tool_mass = 1.0 }", "evaluation.varied.tool_mass must be a list of values, or a table"),
    ("varied = { tool_mass = [] }", "evaluation.varied.tool_mass must be a list of values"),
    ("varied = { tool_mass = [-1.0] }", "evaluation.varied.tool_mass: tool_mass must be .*above 0"),
    ("varied = { tool_mass = { time = [1.0] } }", "unknown key evaluation.varied.tool_mass.time; did you mean 'times'"),
    ("varied = { tool_mass = { times = [0.0] } }", "evaluation.varied.tool_mass: times must be .*above 0"),
    ("varied = { scenario = ['easy'] }", "no evaluation set 'easy'"),
    ("varied = { robot = [{ type = 'Robot', mass = 1.0 }] }", "evaluation.varied.robot: robot, a Robot, needs"),
])  # fmt: skip
def test_a_mistake_gets_one_line_that_names_file_key_and_what_is_allowed(table, message, tmp_path):
    with pytest.raises(ValueError, match=message) as raised:
        load_setup(written(tmp_path, table))
    assert "mine.toml: " in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_weight_for_which_no_policy_is_trained_is_refused_before_anything_is_trained(tmp_path):
    path = written(tmp_path, "weights = [1.0, 20.0]")
    with pytest.raises(ValueError, match=r"mine.toml: evaluation: weights .* at most 8 m/s per s, got 20"):
        check(load_setup(path), str(path))
