"""Set-ups: shipped ones are complete, files are read as written, and `impact-gym check` prints true statements."""

import re
from dataclasses import replace
from itertools import repeat

import gymnasium as gym
import numpy as np
import pytest
import tomli_w
from episode_runs import SLOW, Given, play
from refusal import refused
from solver_scenes import scene

import impact_gym as ig
from agents import check, load_setup
from agents.baselines import FIXED, RULES, PaperTrapezoid
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.evaluate.specs import environment_and_scenarios
from agents.setups import feasible, setup_tuning, shipped, shipped_baselines, trained
from agents.setups.evaluation import VARIED, Evaluation, variants
from agents.train.ppo import Run
from impact_gym.task import Task


def test_shipped_set_ups_have_policies():
    assert shipped() == trained()


@pytest.mark.parametrize("name", shipped())
def test_load_setup_finds_all_files_of_a_shipped_set_up(name):
    setup = load_setup(name)
    weights = list(setup.training.time_weight)
    assert Run(setup, setup.training).task.arguments() == {**setup.environment, "time_weight": weights}
    assert {*setup.against} <= {*setup.tuned, *shipped_baselines(), *FIXED}
    assert all(setup_tuning(baseline) == setup for baseline in setup.tuned)
    setup.environment["tool_mass"] = 9.0
    assert load_setup(name).environment.get("tool_mass") != 9.0  # a caller cannot change the set-up of other callers


@pytest.mark.filterwarnings("ignore:SpringDamper.stroke")
def test_variants_change_only_one_argument_each():
    spring = {"coupling": {"type": "SpringDamper", "stiffness": [40.0, 60.0]}, "tool_mass": 0.2}
    own, changed = Task(**spring), variants(Evaluation(), spring)
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


def test_variants_start_from_the_users_own_and_nominal_numbers():
    robot = {"type": "Robot", "mass": [3.0, 5.0], "stiffness": 1e5, "damping": 50.0}
    environment = {"tool_mass": [0.1, 0.3], "force_noise": [0.0, 3.0], "alarm": "reading", "robot": robot}
    nominal = {"tool_mass": 0.2, "robot": "rigid", "force_noise": 0.0}
    table = {"nominal": nominal, "varied": {"tool_mass": [0.1, 0.2], "force_noise": [3.0]}}
    expected = [(0.1, 0.0, False), (0.2, 0.0, True), (0.2, 3.0, False)]
    varied = variants(Evaluation.of_table(table, environment, own=False), environment)
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


@pytest.mark.parametrize(("acceleration", "speed"), [(20.0, 1.5), (2.0, 0.4), (1.5, 10.0)])
def test_reach_is_the_farthest_distance_within_an_episode(acceleration, speed):
    """At full acceleration the flange touches an object 0.1 % nearer than that, and misses one 0.1 % farther."""
    arm = {"acceleration_range": (1.0, acceleration), "velocity_range": (-0.1, speed), "coupling": {"type": "Rigid"}}
    env = gym.make("ImpactApproach-v0", scenario={"distance": 0.1}, **arm)
    reach = env.unwrapped.task.reach
    for share, missed in ((0.999, False), (1.001, True)):
        options = {"record": {"distance": share * reach}}
        assert play(env, Given(repeat(np.ones(2, np.float32))), seed=0, **options).info["missed"] == missed


def test_warnings_name_the_problems_of_some_episodes():
    bistable, robot, light = {"coupling": ig.Bistable()}, ig.Robot(5.0, 80.0, 9.0), {"tool_mass": 0.01}
    for environment, words in (
        ({}, []), (bistable | {"acceleration_range": (1.0, 8.0)}, []), (bistable, ["holds the tool up to 8.38 m/s^2"]),
        ({"scenario": {"distance": (0.2, 1.7)}}, ["ends at a flange position of 0.75"]),
        ({"friction": (3.0, 30.0), "robot": robot}, [
            "friction is 3 to 30", "robot.stiffness is 80 N/m", "lags 1331 mm behind",
        ]),
        ({"scenario": {"distance": 0.6}, "range_noise": 0.01}, ["ends at an estimated distance of 0.5 m"]),
        (SLOW, []), (SLOW | {"after_alarm": 0.0801}, []), (SLOW | {"after_alarm": 0.0799}, ["needs 0.16 s to stop"]),
        (SLOW | {"horizon": 1.2}, ["the arm needs at least 0.52 m/s to 60 cm, more than a quarter"]),
        (SLOW | {"acceleration_range": (0.1, 0.5)}, ["1.6 s to stop", "stops in 64 cm, but no object"]),
        (light | {"coupling": ig.SpringDamper(0.5)}, ["lags 400 mm behind at 20 m/s^2, more than the 350 mm from"]),
        (light | {"coupling": ig.SpringDamper(1.9)}, ["lags 105 mm behind at 20 m/s^2, more than the 100 mm of"]),
        ({"coupling": ig.SpringDamper(49.0), "deflection_sensor": True}, ["lags 51 mm behind at 20 m/s^2, but"]),
        ({"missed_cost": 0.41}, ["missed_cost is 0.41 m/s, but V_p can be 0.42 m/s"]), ({"missed_cost": 0.42}, []),
    ):  # fmt: skip
        sentences = feasible.doubts(Task(**environment), (0.7, 4.0))
        assert len(sentences) == len(words), environment
        assert all(part in sentence for part, sentence in zip(words, sentences, strict=True))


def test_weights_above_which_only_full_speed_pays_are_named():
    """With V_p = 2 v, the cost 2 v + w d / v of a constant speed v falls up to v = sqrt(w d / 2)."""
    task = Task(velocity_range=(-0.1, 0.3))
    highest = 2.0 * 0.3**2 / 0.25
    assert feasible.doubts(task, (0.99 * highest, 4.0)) == feasible.doubts(task)
    (sentence,) = feasible.doubts(task, (1.01 * highest, 4.0))
    assert "all time weights are above 0.72 m/s per s" in sentence


@pytest.mark.filterwarnings("ignore:scenario.distance ends")
def test_least_speed_says_if_the_farthest_object_is_out_of_reach():
    far = {"scenario": {"distance": (0.2, 1.75)}, "horizon": 1.2}
    assert feasible.least_speed(Task(**far)) == "within the horizon of 1.2 s the arm cannot reach 175 cm"
    assert feasible.least_speed(Task(**far, velocity_range=(0.0, 2.0))).endswith("needs at least 1.5 m/s to 175 cm")


def test_check_says_what_a_file_means(mine):
    setup = load_setup(mine)
    played = ScenarioBatch(1_000_000, 500, setup.task).play(PaperTrapezoid().for_task(setup.task))
    of_rule = [500, played.object_velocity.mean(), played.approach_time.mean(), played.missed.sum()]
    lags = [4e3 * (m / k + (8.0 + m) / k_r) for m in (0.3, 0.5) for k in (200, 400) for k_r in (5e4, 2e5)]  # mm
    for begin, expected in {
        "in 500 scenarios": of_rule, "the tool lags": [min(lags), max(lags), 4.0, 2.0], "on 30": [30, 1.0, 4.0],
        "within the horizon": [2.5, round(4.0 * (2.5 - (2.5**2 - 2.0 * 0.3 / 4.0) ** 0.5), 2), 30],
        "distance: ": [0.1, 0.3],
        "an object that is missed": [2.0, 2.0 * 0.6 / (1.0 + 0.2 / 0.5), 0.02], "velocity to go to": [-0.2, 0.6],
    }.items():  # fmt: skip
        (line,) = [line for line in check.lines(setup) if line.strip().startswith(begin)]
        numbers = [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?", line)]
        assert numbers == pytest.approx(expected, abs=6e-4, rel=5e-3), line


def test_set_up_extends_another_key_by_key(tmp_path):
    """A set-up extends a file beside it, which extends a shipped one; it keeps its own baselines and words."""
    arm = {"extends": "linear-ranged", "environment": {"tool_mass": 0.2}, "training": {"steps": 5_000_000}}
    own = {"extends": "arm.toml", "title": "Mine", "environment": {"range_noise": 0.02}}
    (tmp_path / "arm.toml").write_text(tomli_w.dumps(arm))
    (tmp_path / "mine.toml").write_text(tomli_w.dumps(own), "utf-8-sig")  # as some editors do
    mine, shipped_one = load_setup(tmp_path / "mine.toml"), load_setup("linear-ranged")
    assert mine.environment == {**shipped_one.environment, "tool_mass": 0.2, "range_noise": 0.02}
    assert mine.training == replace(shipped_one.training, steps=5_000_000)
    assert mine.evaluation.varied == Evaluation.of_table({}, mine.environment).varied  # for the user's arm
    simple = [f"mine-{end}" for end in ("constant-speed", "threshold", "even-braking")]
    assert (mine.title, mine.about, [*mine.tuned]) == ("Mine", "Mine", ["mine-profile", *simple])
    base = {"extends": "teleop-spring", "environment": {"uplink": {"trace": "a.csv"}}}
    (tmp_path / "arm.toml").write_text(tomli_w.dumps(base))  # files edited in one process
    for delay in (0.25, 0.75):
        (tmp_path / "a.csv").write_text(f"0,{delay}\n1,{delay}\n")
        assert load_setup(tmp_path / "mine.toml").task.uplink.delays == (delay, delay)
    (tmp_path / "arm.toml").write_text('extends = "mine.toml"')
    refused(lambda: load_setup(tmp_path / "arm.toml"), "extends must", "got 'arm.toml'")


def test_own_set_up_gets_simple_rivals_and_its_surroundings(tmp_path):
    """Whatever its file names; a copy of a shipped set-up gets what that one has."""
    own = {"environment": {"scenario": {"distance": [0.1, 0.6], "object_mass": [0.1, 3.2]}, "range_noise": 0.01},
           "baselines": {"tuned": {"fast": "ConstantSpeed"}, "against": ["blind-profile"]},
           "evaluation": {"varied": {"tool_mass": [0.2]}}}  # fmt: skip
    (path := tmp_path / "own.toml").write_text(tomli_w.dumps(own))
    setup, rivals = load_setup(path), ["own-threshold", "own-even-braking"]
    assert ([*setup.tuned], [*setup.against]) == (["fast", *rivals], ["blind-profile", *rivals])
    varied = setup.evaluation.varied
    assert varied["scenario.distance"] == [[0.05, 0.1], [0.6, 0.7]]  # a fifth of 0.5 m; not below half of 0.1 m
    assert varied["scenario.object_mass"] == [[0.05, 0.1], [3.2, 6.4]]  # a fifth of 32, in logarithms
    assert varied["scenario.restitution"] == [[0.05, 0.1]]  # none is above 1
    assert (varied["range_bias"], varied["tool_mass"]) == ([-0.01, 0.0, 0.01], [0.2])
    places = [each.ranges.get("distance") for each in variants(setup.evaluation, {})]
    assert places[:3] == [(0.05, 0.1), (0.6, 0.7), None]
    (tmp_path / "linear-blind.toml").write_bytes((shipped_one := load_setup("linear-blind")).path.read_bytes())
    copy = load_setup(tmp_path / "linear-blind.toml")
    assert (copy.tuned, "scenario.distance" in copy.evaluation.varied) == (shipped_one.tuned, False)
    for wrong in ([[0.7, 0.6]], {"times": [2.0]}, [-0.1]):
        path.write_text(tomli_w.dumps({"evaluation": {"varied": {"scenario.distance": wrong}}}))
        refused(lambda: load_setup(path), "evaluation.varied.scenario.distance")


def test_horizon_of_a_set_up_does_not_depend_on_its_scenario(tmp_path):
    """The report plays scenarios in an environment without them."""
    (path := tmp_path / "slow.toml").write_text(tomli_w.dumps({"environment": SLOW}))
    setup = load_setup(path)
    environment, _ = environment_and_scenarios(setup.environment, {"set": "test", "count": 2})
    assert (setup.task.horizon, Task(**environment).horizon, Task(**SLOW).horizon) == (3.8, 3.8, 3.8)
    assert load_setup("paper-limits").task.horizon == 1.2


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_set_up_tunes_a_rule_only_with_the_sensors_it_needs(rule, tmp_path):
    for name, environment in {"without": {}, "with": rule.NEEDS}.items():
        path, content = tmp_path / f"{name}.toml", {"baselines": {"tuned": {"mine": rule.__name__}}}
        path.write_text(tomli_w.dumps({"environment": environment, **content}))
        if environment == rule.NEEDS:
            assert load_setup(path).tuned["mine"].rule is rule
        else:
            refused(lambda path=path: load_setup(path), f"baselines.tuned.mine: {rule.__name__} needs")
