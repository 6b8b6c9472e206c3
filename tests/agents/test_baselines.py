"""The baselines do what they say, and what tuning leaves behind is what is loaded."""

import json

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, Always, play

from agents import baselines
from agents.baselines import BlindProfile, Clairvoyant, ConstantSpeed, Ranged, tuned
from agents.baselines.profile import KNOTS, ConstantDeceleration, constant_deceleration
from agents.baselines.reaction import REACTION
from agents.baselines.rule import Seen
from agents.baselines.tuned import load_baseline, names, read_tuned, write_tuned
from agents.evaluate import Validation
from agents.evaluate.stage import TEST_SEED, TUNING_SEED, VALIDATION_SEED, Stage
from agents.setups import load_setup
from agents.setups.evaluation import WEIGHTS
from agents.train.settings import FIRST_SEED
from agents.tune import A_SWITCH
from impact_gym.envs import evaluation_sets
from impact_gym.envs.observation import space
from impact_gym.envs.task import Task

RULES = [ConstantSpeed, ConstantDeceleration, BlindProfile, Ranged, Clairvoyant]
STAY = [0.0] * (len(REACTION) - 1) + [20.0]
NEEDS = {"range_noise": 0.01, "privileged": True}


def drawn(rule, rows, seed=0):
    """Return parameters evenly drawn within their limits."""
    low, high = (np.array([getattr(one, side) for one in rule.PARAMETERS]) for side in ("low", "high"))
    return np.random.default_rng(seed).uniform(low, high, (rows, len(low)))


def flange(controller, record, **options):
    """Return the flange's path (time, position, velocity) up to the first contact."""
    env = gym.make(ID, record_trace=True, **options)
    info = play(env, controller, record=record).info
    trace = env.unwrapped.trace()
    before = trace.time <= info["approach_time"]
    return trace.time[before], trace.flange_position[before], trace.flange_velocity[before]


def test_a_profile_is_followed_as_far_as_the_limits_allow():
    speeds = np.array([0.8, 0.8, 0.7, 0.75, 0.6, 0.5, 0.45, 0.4, 0.35, 0.3])
    time, position, velocity = flange(BlindProfile([*speeds, 20.0, *STAY]), {"distance": 0.5})
    assert np.abs(np.diff(velocity)).max() <= 20.0 * np.diff(time).max() + 1e-9
    acceleration = np.diff(velocity) / np.maximum(np.diff(time), 1e-12)
    assert np.abs(acceleration[np.diff(time) > 1e-6]).max() <= 20.0 + 1e-6
    settled = position > 0.05  # 0.8 m/s at 20 m/s^2 takes 16 mm, and a control period
    wanted = np.interp(position[settled], KNOTS, speeds)
    # between two commands the velocity is linear in time, over a corner too; the sharpest is 3.3 1/s to 2.5 1/s the
    # other way, which 13 mm of a period turn into 0.04 m/s
    assert np.abs(velocity[settled] - wanted).max() < 0.04
    smooth = np.abs(position[settled][:, None] - KNOTS).min(axis=1) > 0.013
    assert np.abs(velocity[settled] - wanted)[smooth].max() < 0.01


def test_constant_deceleration_is_recognised_and_its_opposite_is_not():
    """v^2 = 2 a (end - x)."""
    even = np.sqrt(2 * 1.2 * (0.4 - KNOTS))
    shape = constant_deceleration(BlindProfile([*even, 20.0, *STAY]))
    assert shape.r_squared > 0.999
    assert shape.deceleration == pytest.approx(1.2, rel=0.01)
    assert shape.end == pytest.approx(0.4, abs=0.002)
    valley = np.sqrt(0.1 + 10 * np.abs(KNOTS - 0.25))
    assert constant_deceleration(BlindProfile([*valley, 20.0, *STAY])).r_squared < 0.1
    rule = ConstantDeceleration([1.5, 1.2, 0.4, 0.01, 20.0, *STAY])
    assert constant_deceleration(rule).deceleration == pytest.approx(1.2, rel=1e-6)


def test_ranged_arrives_at_the_estimate_with_the_tuned_speed_whatever_the_distance():
    rule = Ranged([1.2, 0.25, 9.0, 0.01, *STAY])
    _, position, velocity = flange(rule, {"distance": 0.45, "distance_estimate": 0.3}, range_noise=0.01)
    assert np.interp(0.3, position, velocity) == pytest.approx(0.25, abs=1e-3)
    left = np.array([0.02, 0.04, 0.06])
    braking = np.sqrt(0.25**2 + 2 * 9.0 * left)
    assert np.interp(0.29 - left, position, velocity) == pytest.approx(braking, abs=0.01)
    assert velocity[position > 0.31] == pytest.approx(0.25, abs=1e-3)


@pytest.mark.parametrize("rule", RULES)
def test_a_row_of_a_batch_acts_as_the_same_rule_alone(rule):
    box = space(Task(**NEEDS))
    seen = np.random.default_rng(1).uniform(box.low, box.high, (200, *box.shape)).astype(np.float32)
    seen[:, 3] = np.arange(200) % 2
    parameters = drawn(rule, 200)
    actions, state = rule.of(parameters).predict(seen, state="kept")
    assert state == "kept"
    assert np.abs(actions).max() <= 1.0 + 1e-6
    for row, one in enumerate(parameters):
        assert np.array_equal(rule.of(one).predict(seen[row])[0], actions[row])
        assert np.array_equal(rule.of(one).predict(seen)[0][row], actions[row])


@pytest.mark.parametrize("rule", RULES)
def test_parameters_beyond_the_limits_or_too_few_are_refused_by_name(rule):
    parameters = drawn(rule, 3)
    for place, parameter in enumerate(rule.PARAMETERS):
        wrong = parameters.copy()
        wrong[1, place] = parameter.high * 1.01 + 0.01
        with pytest.raises(ValueError, match=f"{parameter.name} must be .*at most {parameter.high:g}"):
            rule.of(wrong)
    if rule is not ConstantSpeed:
        with pytest.raises(ValueError, match="has the parameters"):
            rule.of(parameters[:, 1:])


def test_the_clairvoyant_goes_by_the_true_gap():
    env = gym.make(ID, **NEEDS)
    seen, _ = env.reset(options={"scenario": {"distance": 0.2718}})
    contact = Clairvoyant([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 10.0, 20.0, *STAY])
    velocity, _ = contact.approach(Seen(seen))
    far = np.sqrt(0.6**2 + 2 * 10.0 * (0.2718 - 0.04))
    assert velocity == pytest.approx(min(1.5, far), abs=1e-6)  # not there within a period: what it goes for
    gaps = np.array([0.015, 0.0, -0.015, -0.1])
    assert contact.speed(-gaps) == pytest.approx([0.45, 0.3, 0.15, 0.1])


@pytest.mark.parametrize("rule", [baselines.PaperTrapezoid(), Always(0.0, 1.0)], ids=["paper", "misses"])
def test_a_stage_plays_the_frozen_set_as_validation_does(rule):
    expected = Validation({"range_noise": 0.01}, WEIGHTS, 40).score(rule)
    played = Stage.of("validation", 40, copies=len(WEIGHTS), time_weight=WEIGHTS, range_noise=0.01).play(rule)
    weights = np.repeat(WEIGHTS, 40)
    assert played.loss(weights).reshape(-1, 40).mean(axis=1) == pytest.approx(expected["cost"], rel=1e-12)
    assert played.approach_time.reshape(-1, 40).mean(axis=1) == pytest.approx(expected["approach_time"], rel=1e-12)
    frozen = evaluation_sets.load("validation").scenario
    assert np.array_equal(played.scenario["distance"], np.tile(frozen["distance"][:40], len(WEIGHTS)))
    with pytest.raises(ValueError, match="1000 scenarios"):
        Stage.of("validation", 1001)


def test_random_actions_fill_the_action_space_and_repeat_with_their_seed():
    seen = np.zeros((4000, 8), np.float32)
    one, two, other = (baselines.RandomActions(seed).predict(seen)[0] for seed in (1, 1, 2))
    assert np.array_equal(one, two)
    assert not np.array_equal(one, other)
    assert np.abs(one).max() <= 1.0
    assert np.histogram(one, bins=10, range=(-1, 1))[0] == pytest.approx(800, abs=6 * np.sqrt(800))
    assert baselines.RandomActions().predict(seen[0])[0].shape == (2,)


def test_training_tuning_and_evaluation_meet_each_their_own_scenarios():
    """By the seeds of environments: of evaluation, of tuning, of training, one above the other."""
    sets = [evaluation_sets.load(name) for name in ("validation", "test", "hard")]
    assert [one.seed for one in sets[:2]] == [VALIDATION_SEED, TEST_SEED]
    assert all(one.seed + one.count <= TUNING_SEED for one in sets)
    assert TUNING_SEED + 1_000_000 <= FIRST_SEED


def found(rule, seed):
    one = drawn(rule, 1, seed)[0].tolist()
    return {"parameters": {parameter.name: value for parameter, value in zip(rule.PARAMETERS, one, strict=True)}}


def test_what_was_tuned_is_loaded_for_the_nearest_weight(tmp_path):
    weights = {"4": found(BlindProfile, 4), "1": found(BlindProfile, 1)}
    write_tuned("blind-profile", weights, load_setup("linear-blind"), tmp_path)
    for weight, nearest in ((0.1, "1"), (1.0, "1"), (1.9, "1"), (2.1, "4"), (50.0, "4")):
        rule = load_baseline("blind-profile", weight, tmp_path)
        assert isinstance(rule, BlindProfile)
        assert rule.parameters.tolist() == list(weights[nearest]["parameters"].values())
    assert isinstance(load_baseline("paper-trapezoid", 3.0, tmp_path), baselines.PaperTrapezoid)


def refused(reason, folder):
    """Expect that the tuned `Ranged` of a folder is refused, with the remedy."""
    with pytest.raises(ValueError, match=rf"({reason}).*python -m agents.tune linear-ranged"):
        load_baseline("ranged", 2.0, folder)


@pytest.mark.parametrize(("changes", "sealed_anew", "reason"), [
    ({"weights": {"2": found(Ranged, 2)}}, False, "was altered"),
    ({"environment": {"range_noise": 0.02}}, True, "another environment"),
    ({"parameters": []}, True, "another table of parameters"),
], ids=str)  # fmt: skip
def test_a_tuned_file_that_is_not_what_was_written_is_refused_with_the_remedy(tmp_path, changes, sealed_anew, reason):
    path = write_tuned("ranged", {"2": found(Ranged, 1)}, load_setup("linear-ranged"), tmp_path)
    content = json.loads(path.read_text()) | changes
    if sealed_anew:
        content["sha256"] = tuned._checksum(content)
    path.write_text(json.dumps(content))
    refused(reason, tmp_path)


def test_a_tuned_file_that_is_cut_short_or_missing_is_refused_with_the_remedy(tmp_path):
    path = write_tuned("ranged", {"2": found(Ranged, 1)}, load_setup("linear-ranged"), tmp_path)
    path.write_text(path.read_text()[: path.stat().st_size // 2])
    refused("damaged", tmp_path)
    path.unlink()
    refused("was not tuned", tmp_path)


def test_an_unknown_baseline_is_refused_with_a_list_of_those_there_are():
    with pytest.raises(ValueError, match=r"no baseline 'blind'.*blind-profile.*paper-trapezoid"):
        load_baseline("blind")
    with pytest.raises(ValueError, match=r"time_weight must be .*above 0"):
        load_baseline("ranged", 0.0)


@pytest.mark.parametrize("name", names())
def test_a_shipped_baseline_beats_the_papers_rule_at_its_weight_and_misses_nothing(name):
    content = read_tuned(name)
    for weight in map(float, content["weights"]):
        told = content["weights"][f"{weight:g}"]["search"].get("told", False)
        environment = content["environment"] | (A_SWITCH if told else {})
        stage = Stage.of("validation", 200, time_weight=[weight], **environment)
        ours, paper = stage.play(load_baseline(name, weight)), stage.play(baselines.PaperTrapezoid())
        assert not ours.missed.any()
        assert ours.loss(weight).mean() < paper.loss(weight).mean()


@pytest.mark.parametrize("name", ["blind-profile", "constant-deceleration"])
def test_a_rule_by_position_goes_where_the_objects_stand(name):
    rule = load_baseline(name, 2.0)
    farther = rule.for_environment({"scenario": {"distance": [0.3, 0.7]}})  # twice as far, and twice as wide
    x = np.linspace(0.15, 0.35, 9)
    if name == "blind-profile":  # it has the same speeds there
        assert farther.speed(2.0 * x) == pytest.approx(rule.speed(x))
        assert farther.speed(2.0 * np.array([0.08, 0.12])) == pytest.approx(rule.speed(np.array([0.08, 0.12])))
    else:  # it has the same deceleration, and as much farther to go
        assert farther.speed(2.0 * rule["end"] - x) == pytest.approx(rule.speed(rule["end"] - x))
    same = rule.for_environment({"scenario": {"object_mass": 1.0}})
    assert np.array_equal(same.speed(x), rule.speed(x))
    fixed = rule.for_environment({"scenario": {"distance": 0.4}})
    assert np.isfinite(fixed.speed(np.linspace(0.0, 1.0, 50))).all()
