"""Set-ups: shipped ones are complete, files are read as written, and `impact-gym check` prints true statements."""

from dataclasses import replace
from itertools import repeat
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import tomli_w
from episode_runs import Given, play
from refusal import refused
from solver_scenes import scene

import impact_gym as ig
from agents import check, load_setup
from agents.setups import feasible, owner, shipped, shipped_baselines
from agents.setups.evaluation import VARIED, Evaluation, changes, variants
from agents.setups.setup import FIXED
from agents.train.ppo import Run
from impact_gym.task import Task

SPRING = {"coupling": {"type": "SpringDamper", "stiffness": [40.0, 60.0]}, "tool_mass": 0.2}


@pytest.mark.parametrize("name", shipped())
def test_load_setup_finds_all_files_of_a_shipped_set_up(name):
    setup = load_setup(name)
    weights = list(setup.training.time_weight)
    assert Run(setup, setup.training).task.arguments() == {**setup.environment, "time_weight": weights}
    assert {*setup.against} <= {*setup.tuned, *shipped_baselines(), *FIXED}
    assert all(owner(baseline) == setup for baseline in setup.tuned)
    assert "is the unit right?" not in str(feasible.warnings(Run(setup, setup.training).task))
    setup.environment["tool_mass"] = 9.0
    assert load_setup(name).environment.get("tool_mass") != 9.0  # a caller cannot change the set-up of other callers


def test_load_setup_reads_a_file(mine):
    setup = load_setup(mine)
    single, several = setup.make(), setup.make_vec(3)
    assert np.array_equal(single.reset(seed=5)[0], several.reset(seed=5)[0][0])
    task, training = Task(**setup.environment), setup.training
    assert {*task.drawn} == {"tool_mass", "coupling.stiffness", "robot.stiffness", "range_noise"}
    assert [*setup.tuned] == ["mine-profile"] == [*setup.against]  # the defaults of a file without [baselines]
    assert setup.tuned["mine-profile"].rule == "RangedProfile"
    assert setup.folder == Path("runs/mine")
    assert (training.steps, setup.seeds, setup.budget, setup.evaluation.weights) == (2000, 2, 16, (1.0, 4.0))


@pytest.mark.filterwarnings("ignore:SpringDamper.stroke")
def test_variants_change_only_one_argument_each():
    own, changed = Task(**SPRING), variants(Evaluation(), SPRING)
    for change in changed:
        task = Task(**change.environment)
        assert (task == own) == (change.same or bool(change.scenarios)), change
        assert {*own.differs_in(task)} <= {change.argument.partition(".")[0]}
        if change.multiple:
            before, after = (task.by_path() | task.ranges for task in (own, task))
            assert after[change.argument] == pytest.approx(np.multiply(before[change.argument], change.value))
    missing = {name for name in VARIED if name.startswith(("range_", "coupling.front_stop", "robot.stiffness"))}
    asked = {*VARIED, "coupling.stroke", "scenario"} - missing
    assert {change.argument for change in changed} == asked


def test_a_users_set_up_is_varied_around_its_own_numbers():
    own = {"robot": {"type": "Robot", "mass": 3.0, "stiffness": 8e4, "damping": 60.0}, "reaction_delay": 0.02,
           "scenario": {"distance": [0.1, 0.3]}, "alarm_threshold": 3.0}  # fmt: skip
    varied = Evaluation.of_table({}, own).varied
    assert varied["robot"] == ["rigid"]
    assert 0.02 in varied["reaction_delay"]
    assert "scenario" not in varied  # the frozen set lies outside the default ranges, but not outside of these
    thresholds = changes("alarm_threshold", varied["alarm_threshold"], own)
    assert [change.environment["alarm_threshold"] for change in thresholds] == [0.75, 1.5, 3.0, 6.0, 12.0]  # N


def test_variants_start_from_the_nominal_arguments():
    robot = {"type": "Robot", "mass": [3.0, 5.0], "stiffness": 1e5, "damping": 50.0}
    environment = {"tool_mass": [0.1, 0.3], "force_noise": [0.0, 3.0], "alarm": "reading", "robot": robot}
    nominal = {"tool_mass": 0.2, "robot": "rigid", "force_noise": 0.0}
    table = {"nominal": nominal, "varied": {"tool_mass": [0.1, 0.2], "force_noise": [3.0]}}
    expected = [(0.1, 0.0, False), (0.2, 0.0, True), (0.2, 3.0, False)]
    varied = variants(Evaluation.of_table(table, environment), environment)
    for change, (mass, noise, same) in zip(varied, expected, strict=True):
        task = Task(**change.environment)
        assert (task.tool_mass, task.force_noise, task.robot, task.alarm) == (mass, noise, None, "reading")
        assert (task.drawn, change.same) == ({}, same)


@pytest.mark.parametrize("robot", [None, ig.Robot(5.0, 3e3, 200.0)])
@pytest.mark.parametrize("coupling", [ig.Rigid(), ig.SpringDamper(200.0, 1.0)])
def test_lag_equals_the_lag_after_a_long_acceleration(coupling, robot):
    chain = scene(coupling=coupling, robot=robot, m_t=0.3, distance=1e6)
    trace = ig.simulate(chain, ig.Trapezoid(1e3, 20.0), 5.0, trace=True).trace
    lag = trace.command_position[-1] - trace.tool_position[-1]
    assert check.lag(Task(tool_mass=0.3, coupling=coupling, robot=robot)) == pytest.approx(lag, rel=1e-6, abs=1e-9)


def test_lines_state_the_consequences(mine):
    lags = [check.lag(corner) for corner in feasible.corners(Task(**load_setup(mine).environment))]
    hand = [4.0 * m / k + 4.0 * (8.0 + m) / k_r for m in (0.3, 0.5) for k in (200, 400) for k_r in (5e4, 2e5)]
    assert sorted(lags) == pytest.approx(sorted(hand), rel=1e-12)
    text, of_mechanism = ("\n".join(check.lines(load_setup(name))) for name in (mine, "bistable-paper"))
    assert "robot.stiffness: 50000 to 200000 N/m, log-uniform" in text
    assert "warning" not in text
    assert "the front stop holds the tool with 1.05 N" in of_mechanism  # 8.38 m/s^2 times 0.125 kg


@pytest.mark.parametrize(("acceleration", "speed"), [(20.0, 1.5), (2.0, 0.4), (1.5, 10.0)])
def test_reach_is_the_farthest_distance_within_an_episode(acceleration, speed):
    """At full acceleration the flange touches an object 0.1 % nearer than that, and misses one 0.1 % farther."""
    arm = {"acceleration_range": (1.0, acceleration), "velocity_range": (-0.1, speed), "coupling": {"type": "Rigid"}}
    env, reach = gym.make("ImpactApproach-v0", scenario={"distance": 0.1}, **arm), Task(scenario="train", **arm).reach
    for share, missed in ((0.999, False), (1.001, True)):
        options = {"record": {"distance": share * reach}}
        assert play(env, Given(repeat(np.ones(2, np.float32))), seed=0, **options).info["missed"] == missed


GENTLE = {"coupling": ig.Bistable(), "acceleration_range": (1.0, 8.0)}


@pytest.mark.parametrize(("environment", "words"), [
    ({}, []), (GENTLE, []),
    ({"scenario": {"distance": (0.2, 1.7)}}, ["ends at a flange position of 0.75"]),
    ({"scenario": {"distance": (0.01, 0.3)}}, ["10 mm ahead: the tool can get there before the first reading"]),
    ({"coupling": ig.Bistable()}, ["holds the tool up to 8.38 m/s^2, the arm reaches 20 m/s^2: above 8.38"]),
    ({"velocity_range": (-200.0, 600.0), "friction": (3.0, 30.0), "robot": ig.Robot(5.0, 80.0, 9.0)}, ["-200 to 600 m",
     "friction is 3 to 30 (no unit), expected is 0 to 1 (no unit): is the unit", "robot.stiffness is 80 N/m, expecte"]),
    (GENTLE | {"robot": ig.Robot(5.0, 1e5, 50.0)}, ["m/s^2, and a compliant robot can overshoot to 2 times this"]),
], ids=str)  # fmt: skip
def test_warnings_name_the_problems_of_some_episodes(environment, words):
    sentences = feasible.warnings(Task(**environment))
    assert len(sentences) == len(words)
    assert all(part in sentence for part, sentence in zip(words, sentences, strict=True))


def test_set_up_extends_another_key_by_key(tmp_path):
    """A set-up extends a file beside it, which extends a shipped one; it keeps its own baselines and words."""
    arm = {"extends": "linear-ranged", "environment": {"tool_mass": 0.2}, "training": {"steps": 5_000_000}}
    own = {"title": "Mine", "environment": {"range_noise": 0.02}, "evaluation": {"typical": 1.0}}
    (tmp_path / "arm.toml").write_text(tomli_w.dumps(arm))
    (tmp_path / "mine.toml").write_text(tomli_w.dumps({"extends": "arm.toml"} | own))
    mine, shipped_one = load_setup(tmp_path / "mine.toml"), load_setup("linear-ranged")
    assert mine.environment == {**shipped_one.environment, "tool_mass": 0.2, "range_noise": 0.02}
    assert mine.training == replace(shipped_one.training, steps=5_000_000)
    varied = mine.evaluation.varied  # defaults for the user's arm, not for the shipped one
    assert mine.evaluation == replace(shipped_one.evaluation, typical=1.0, varied=varied)
    assert varied == Evaluation.of_table({}, mine.environment).varied
    assert (mine.title, mine.about, [*mine.tuned]) == ("Mine", "Mine", ["mine-profile"])
    (tmp_path / "arm.toml").write_text('extends = "mine.toml"')
    refused(lambda: load_setup(tmp_path / "arm.toml"), "extends must", "got 'arm.toml'")
