"""Baselines and the filter of range readings do what their docstrings say; `load_baseline` returns what was tuned."""

import hashlib
import json

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import ID, estimates, play, started
from made_up_policies import observations
from refusal import refused

from agents import load_setup
from agents.baselines import RULES, BlindProfile, Clairvoyant, ConstantSpeed, OperatorAlone, PaperTrapezoid, Ranged
from agents.baselines.constant import ThresholdBrake
from agents.baselines.filtered import FilteredProfile, SelfCalibratingProfile
from agents.baselines.profile import KNOTS, LEAST_SPREAD, REACTION
from agents.baselines.rule import View, tuned_rule
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.setups import load_baseline, setup_tuning, shipped_baselines
from agents.setups.tuned import read_tuned, write_tuned
from agents.tune import CLEAN_ALARM
from impact_gym.envs.batch import Batch
from impact_gym.task import ObservationSpec, Task

STAY = [0.0] * (len(REACTION) - 1) + [20.0]


def drawn(rule, rows, seed=0):
    low, high = (np.array([getattr(parameter, side) for parameter in rule.PARAMETERS]) for side in ("low", "high"))
    return np.random.default_rng(seed).uniform(low, high, (rows, len(low)))


def flange(controller, environment, **record):
    """Return times, positions and velocities of the flange until the touch, in an episode with the numbers `record`."""
    env = gym.make(ID, record_trace=True, **environment)
    touch = play(env, controller, seed=3, record=record).info["approach_time"]
    trace = env.unwrapped.trace()
    return np.array([trace.time, trace.flange_position, trace.flange_velocity])[:, trace.time <= touch]


def test_constant_speed_goes_until_the_alarm_and_then_stops():
    fast = ConstantSpeed(1.5, 20.0, 1.0)
    for rule, go, stop in ((PaperTrapezoid(), (1.0, 8.0), (0.0, 8.0)), (fast, (1.5, 20.0), (0.0, 1.0))):
        seen = observations(rule, 50)
        expected = np.where(rule.spec.decode(seen, "alarm")[:, None] > 0.5, stop, go)
        assert Task().action.decode(rule.predict(seen)[0]) == pytest.approx(expected, rel=0, abs=1e-6)


def test_flange_follows_a_blind_profile_within_the_limits():
    speeds = np.array([0.8, 0.8, 0.7, 0.75, 0.6, 0.5, 0.45, 0.4, 0.35, 0.3])
    time, position, velocity = flange(BlindProfile([*speeds, 20.0, *STAY]), {}, distance=0.5)
    steps = np.diff(time)
    assert np.abs((np.diff(velocity) / np.maximum(steps, 1e-12))[steps > 1e-6]).max() <= 20.0 + 1e-6
    # away from corners of the profile, and after 16 mm of acceleration and a control period
    there = (position > 0.05) & (np.abs(position[:, None] - KNOTS).min(axis=1) > 0.013)
    assert np.abs(velocity[there] - np.interp(position[there], KNOTS, speeds)).max() < 0.01


def test_ranged_arrives_at_the_estimate_with_the_tuned_speed():
    rule = Ranged([1.2, 0.25, 9.0, 0.01, *STAY])
    _, position, velocity = flange(rule, {"range_noise": 0.01}, distance=0.45, distance_estimate=0.3)
    assert np.interp(0.3, position, velocity) == pytest.approx(0.25, abs=1e-3)
    left = np.array([0.02, 0.04, 0.06])
    assert np.interp(0.29 - left, position, velocity) == pytest.approx(np.sqrt(0.25**2 + 2 * 9.0 * left), abs=0.01)
    assert velocity[position > 0.31] == pytest.approx(0.25, abs=1e-3)


def test_threshold_brake_reacts_to_the_force_and_not_to_the_alarm():
    rule, spec, seen = ThresholdBrake([0.5, 4.0, 9.0, 3.0]), ObservationSpec(Task()), np.zeros(8, np.float32)
    for force, alarm, expected in ((2.9, 1.0, (0.5, 4.0)), (3.1, 0.0, (0.0, 9.0))):
        seen[spec.index("force_peak")], seen[spec.index("alarm")] = spec.encode("force_peak", force), alarm
        assert Task().action.decode(rule.predict(seen)[0]) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("rule", [*RULES.values(), Clairvoyant])
def test_rule_acts_on_a_row_of_a_batch_as_it_does_alone(rule):
    task, parameters = Task(**rule.NEEDS), drawn(rule, 24)
    batch = rule.of(parameters).for_task(task)
    seen = observations(batch, 24)
    actions, _ = batch.predict(seen)
    assert np.abs(actions).max() <= 1.0 + 1e-6
    for row, own in enumerate(parameters):
        alone = rule.of(own).for_task(task)
        assert np.array_equal(alone.predict(seen[row])[0], actions[row])
        assert np.array_equal(alone.predict(seen)[0][row], actions[row])


def test_rule_over_position_is_mapped_to_the_distances_of_a_task():
    """Here twice as far, and twice as wide: the same speeds at the corresponding places, or the same deceleration."""
    x, farther = np.linspace(0.08, 0.35, 11), Task(scenario={"distance": [0.3, 0.7]})
    blind, brake = (load_baseline(name, 2.0) for name in ("blind-profile", "constant-deceleration"))
    assert blind.for_task(farther).speed(2.0 * x) == pytest.approx(blind.speed(x))
    assert brake.for_task(farther).speed(2.0 * brake["end"] - x) == pytest.approx(brake.speed(brake["end"] - x))


def parameters_of(rule, seed):
    return {"parameters": dict(zip(rule.names(), drawn(rule, 1, seed)[0].tolist(), strict=True))}


def test_load_baseline_interpolates_over_the_logarithmic_weight(tmp_path):
    weights = {"4": parameters_of(BlindProfile, 4), "1": parameters_of(BlindProfile, 1)}
    weights["4"]["parameters"] = dict(reversed(weights["4"]["parameters"].items()))  # the order makes no difference
    write_tuned("blind-profile", weights, load_setup("linear-blind"), tmp_path)
    low, high = (np.array([weights[weight]["parameters"][name] for name in BlindProfile.names()]) for weight in "14")
    for weight, share in ((0.1, 0.0), (1.0, 0.0), (2.0, 0.5), (4.0, 1.0), (50.0, 1.0)):
        rule = load_baseline("blind-profile", weight, tmp_path)
        assert rule.parameters == pytest.approx((1.0 - share) * low + share * high, rel=1e-12)
    assert (load_baseline(tmp_path / "blind-profile.json", 1.0).parameters == low).all()
    assert isinstance(load_baseline("paper-trapezoid", 3.0, tmp_path), PaperTrapezoid)


def test_missing_or_changed_tuned_file_is_refused_with_a_remedy(tmp_path):
    again = "impact-gym tune linear-ranged"
    refused(lambda: load_baseline("ranged", 2.0, tmp_path), "was not tuned", again)
    path = write_tuned("ranged", {"2": parameters_of(Ranged, 1)}, load_setup("linear-ranged"), tmp_path)
    good = json.loads(path.read_text())
    checksum = good.pop("sha256")
    (tmp_path / "a.csv").write_text("0,0.1\n1,0.1\n")
    traced = {"operator": {"type": "Person"}, "uplink": {"trace": f"{tmp_path}/a.csv"}, "friction": 0.3}
    given = good["weights"]["2"]["parameters"]
    first, *others = given
    without = {name: given[name] for name in others}
    parameters = [*(given | {first: value} for value in ("0.1", np.nan, 1e300)), without, 3]
    for content, words in (
        ({}, "damaged"), ([], "damaged"), (good | {"sha256": checksum, "rule": "Ranged "}, "was altered"),
        (good | {"environment": {"range_noise": 0.02}}, "the environment in"), (good | {"rule": [1]}, "the rule in"),
        (good | {"environment": traced}, "uplink.trace must be rows of time and delay in s"),
        *((good | {"weights": {key: {"parameters": given}}}, words)
          for key, words in (("nan", "got nan"), ("-1", "got -1"), ("inf", "got inf"), ("two", "'two'"))),
        (good | {"weights": {key: {"parameters": given} for key in ("2", "2.0")}}, "no equal entries, got 2.0 twice"),
        *((good | {"weights": {"2": {"parameters": values}}}, "damaged") for values in parameters),
        (good | {"weights": {"2": {}}}, "has no 'parameters'"), (good | {"weights": [2]}, "damaged"),
    ):  # fmt: skip
        right = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
        path.write_text(json.dumps({"sha256": right} | content if content else content))
        refused(lambda: load_baseline(str(path)), words, again)


@pytest.mark.parametrize("name", shipped_baselines())
def test_shipped_baseline_beats_the_papers_rule_at_each_weight(name):
    """With an operator the rival is the operator alone."""
    content, setup = read_tuned(name), setup_tuning(name)
    rival = OperatorAlone() if "operator" in content["environment"] else PaperTrapezoid()
    poor = isinstance(content["environment"].get("range_noise"), list)  # errors of the estimate: up to 30 mm
    task = Task(**content["environment"] | (CLEAN_ALARM if setup.tuned[name].clean_alarm else {}))
    weights, count = sorted(map(float, content["weights"])), 40 if task.operator else 100
    every = np.repeat(weights, count)
    batch = ScenarioBatch.of("validation", count, task, copies=len(weights), time_weight=weights)
    ours, theirs = (batch.play(each.for_task(task)) for each in (tuned_rule(content).at(every), rival))
    assert ours.missed.reshape(len(weights), count).sum(axis=1).max() <= (1 if poor else 0)
    better = theirs.loss(every) - ours.loss(every)
    assert (better.reshape(len(weights), count).mean(axis=1) > 0.0).all()


FILTERS = [FilteredProfile, SelfCalibratingProfile]
PRIOR = 12.0 / 0.2**2  # 1/m^2, weight of the prior: uniform between 15 and 35 cm


@pytest.mark.parametrize("kind", FILTERS)
@pytest.mark.parametrize("coupling", [{"type": "Rigid"}, {"type": "SpringDamper", "stiffness": 50.0}])
def test_without_errors_the_estimate_is_the_distance(coupling, kind):
    sensor = {"delay": 0.05, "bias": 0.01}
    error, _, age, touched = estimates(200, 12, kind=kind, coupling=coupling, range_sensor=sensor)
    read = np.isfinite(age) & ~touched
    assert read.any(axis=0).all()
    prior = PRIOR / (PRIOR + LEAST_SPREAD**-2) * 0.1  # m, remaining influence of the prior
    swing = 0.0 if coupling["type"] == "Rigid" else 2e-3  # m, because the flange's acceleration changes within a step
    assert np.abs(error[read]).max() < prior + swing + 1e-6


@pytest.mark.parametrize(("kind", "sensor", "weight"), [
    *((kind, {"dropout": 0.3}, lambda count: count / 0.02**2) for kind in FILTERS),
    (SelfCalibratingProfile, {"bias": (-0.03, 0.03), "correlation": 0.5},
     lambda count: 1.0 / (0.06**2 / 12.0 + 3.0 * 0.02**2 / count)),
])  # fmt: skip
def test_spread_is_that_of_readings_weighted_by_inverse_variance(kind, sensor, weight):
    """At rest the mean of n readings with correlation r has (1 + r) / (1 - r) sigma^2 / n for large n; a bias stays."""
    _, spread, age, _ = estimates(500, 10, speed=-0.5, kind=kind, range_sensor={"noise": 0.02, **sensor})
    assert spread == pytest.approx((PRIOR + weight(np.cumsum(age == 0.0, axis=0))) ** -0.5, rel=1e-9)


def test_errors_have_the_standard_deviation_of_the_filter():
    sensor = {"noise": 0.01, "dropout": 0.2, "delay": 0.02}
    drawn = {"noise": 0.005, "bias": (-0.02, 0.01), "scale": (-0.1, 0.1), "delay": (0.0, 0.04)}
    for kind, own in ((FilteredProfile, sensor), (SelfCalibratingProfile, drawn)):
        error, spread, age, touched = estimates(1500, 12, kind=kind, range_sensor=own)
        last = np.isfinite(age[-1]) & ~touched[-1]
        score = (error / spread)[-1][last]
        assert abs(score.mean()) < 5.0 / np.sqrt(score.size) + 0.05
        assert score.std() == pytest.approx(1.0, abs=0.06)


def test_touch_tells_the_place_despite_an_unknown_bias():
    sensor, still = {"bias": (-0.02, 0.02)}, {"restitution": 0.01, "object_mass": 5.0}
    error, spread, _, touched = estimates(200, 250, 0.1, SelfCalibratingProfile, range_sensor=sensor, scenario=still)
    first, rows = np.argmax(touched, axis=0), np.arange(200)
    assert touched.any(axis=0).all()
    assert np.abs(error[first - 1, rows]).max() > 0.015
    assert np.abs(error[first + 1, rows]).max() < 0.006  # the object moves on by about 2 mm in a period
    assert spread[first + 1, rows].max() < 1.01 * LEAST_SPREAD


@pytest.mark.parametrize("noise", [0.0, 0.5])
@pytest.mark.parametrize(("name", "most"), [("filtered-profile", 0.0101), ("sensed-robust-profile", 0.0126)])
def test_profile_over_biased_readings_does_not_stop_short(name, most, noise):
    rule = load_baseline(name, 2.0)
    for bias in (-most, most):
        task = Task(range_sensor={"share": 0.1, "bias": bias}, force_noise=noise)
        own = task.changed({"range_sensor": rule.task.arguments()["range_sensor"]})  # the filter is not told the bias
        played = ScenarioBatch(5_000_000, 300, task).play(rule.for_task(own))
        assert played.missed.mean() < 0.01


def test_light_touch_that_is_not_felt_costs_little():
    rule = load_baseline("filtered-profile", 2.0)
    tasks = [Task(range_sensor={"share": 0.1}, force_noise=noise) for noise in (0.0, 0.5)]
    costs = [ScenarioBatch(5_000_000, 300, task).play(rule.for_task(task)).loss(2.0).mean() for task in tasks]
    assert costs[1] < 1.02 * costs[0]


def test_filter_begins_anew_with_each_episode():
    task = Task(range_sensor={"noise": 0.01})
    batch, spec, rule = Batch(4, task), ObservationSpec(task), started(FilteredProfile, task)
    batch.begin_seeded(0, {})
    view, state = rule.see(View(batch.observations, spec), None, None)
    for _ in range(3):
        batch.step(np.zeros((4, 2)), np.zeros(4, bool))
        _, state = rule.see(View(batch.observations, spec), state, None)
    batch.begin_seeded(0, {})
    again, _ = rule.see(View(batch.observations, spec), state, np.array([True, True, False, False]))
    assert np.array_equal(again["distance_estimate"][:2], view["distance_estimate"][:2])
    assert (again["spread"][2:] < view["spread"][2:]).all()
