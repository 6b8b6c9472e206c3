"""The environment plays the physics of `simulate` and of the independent solver; its sensors have errors."""

import json
from itertools import product, repeat
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import reference_task as slow
from episode_runs import ID, PAPERS_SPRING, ROBOT, SLOW, Given, by_path, encode, play, played, steps
from scipy import stats
from solver_scenes import scene

import impact_gym as ig
from agents.baselines import PaperTrapezoid
from agents.baselines.detector import DETECTOR, DetectorProfile
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.setups import load_setup
from impact_gym.envs.batch import Batch
from impact_gym.task import ObservationSpec, Task, evaluation_sets
from impact_gym.task.range_sensor import RangeSensor

COUPLINGS = [PAPERS_SPRING, ig.SpringDamper(150.0, 0.2), ig.Rigid(), ig.Bistable()]
PERIODS_AND_DELAYS = [(0.016, 0.016), (0.004, 0.016), (0.011, 0.016), (0.016, 0.0), (0.016, 0.005), (0.011, 0.040)]


@pytest.mark.parametrize("options", [
    *({"coupling": coupling, "control_period": period, "reaction_delay": delay}
      for coupling, (period, delay) in product(COUPLINGS, PERIODS_AND_DELAYS)),
    *({"coupling": coupling, "friction": friction} for coupling, friction in product(COUPLINGS, (0.1, 0.5))),
    {"alarm_threshold": 0.2}, {"dissipation": "exact", "scenario": "hard"}, {"dissipation": "fixed"},
    {"coupling": ig.SpringDamper(150.0, stroke=0.018)},
    {"velocity_range": (-1.0, 2.0), "acceleration_range": (0.5, 20.0), "alarm_threshold": 5.0},
], ids=str)  # fmt: skip
def test_papers_rule_played_in_the_environment_equals_simulate(options):
    coupling, friction = options.get("coupling", PAPERS_SPRING), options.get("friction")
    # a bistable tool's flight has no closed form and multiplies errors near the alignment
    rtol, flight_error = (1e-11, 1e-11) if isinstance(coupling, ig.Bistable) or friction else (1e-8, 1e-12)
    task = Task(rtol=rtol, **options)
    episodes = ScenarioBatch(31, 12 if friction else 60, task).play(PaperTrapezoid().for_task(task))
    brake = ig.Brake(options.get("alarm_threshold", 1.0), options.get("reaction_delay", 0.016), 8.0)
    struck = scene(coupling=coupling, friction=friction, dissipation=options.get("dissipation", "hu-guo"))
    outcomes = ig.sweep(struck, ig.Trapezoid(1.0, 8.0, brake), by_path(episodes.scenario), duration=5.0, rtol=rtol)
    velocity = outcomes.peak_object_velocity if friction else outcomes.object_velocity
    assert episodes.object_velocity == pytest.approx(velocity, rel=0, abs=1e-9)
    assert episodes.approach_time == pytest.approx(outcomes.first_contact, rel=0, abs=flight_error)
    assert episodes.peak_force == pytest.approx(outcomes.peak_force, rel=1e-8)
    if friction:
        assert episodes.slide == pytest.approx(outcomes.slide, rel=1e-7)
        assert episodes.slide.max() > 0.01
        late = episodes.rest_time - outcomes.rest_time
        assert np.min(late) > -1.5e-3  # in an episode, rest is detected at control steps, after it each ms
        assert np.percentile(late, 90) < 1.5e-3
        assert np.max(late) < 2.0 * task.control_period
    else:
        assert np.array_equal(episodes.contact_count, outcomes.contact_count)


@pytest.mark.parametrize(("options", "count"), [
    ({}, 75), ({"control_period": 0.011, "missed_cost": 3.5}, 110), ({"horizon": 0.4}, 25),
    ({"horizon": 2.4, "missed_cost": 3.5, "time_weight": 0.7}, 150),
], ids=str)  # fmt: skip
def test_object_never_reached_is_missed_after_the_horizon(options, count):
    horizon, cost, weight = options.get("horizon", 1.2), options.get("missed_cost", 2.0), options.get("time_weight", 2)
    observations, rewards, info = play(gym.make(ID, **options), Given(repeat(encode(-0.5, 20.0))), seed=1)
    assert (info["approach_time"], info["missed"], info["peak_force"], len(rewards)) == (horizon, True, 0.0, count)
    assert (info["time_weight"], info["reward_terms"]["missed"]) == (weight, -cost)
    longest = {0.4: 0.55, 1.2: 1.5, 2.4: 3.0}[horizon]  # the observation's scale, s
    assert observations[-1, 2] == pytest.approx(2.0 * horizon / longest - 1.0, rel=0, abs=1.3e-7)


@pytest.mark.parametrize(("options", "horizon"), [
    ({}, 1.2), (SLOW, 3.8), ({"velocity_range": (-0.3, 0.5), "scenario": {"distance": (0.2, 0.8)}}, 8.0),
    ({"scenario": {"distance": 0.36}}, 1.2), ({"scenario": {"distance": 0.361}}, 1.3), ({"scenario": "hard"}, 1.2),
    ({"velocity_range": (-0.1, 2e-5), "scenario": {"distance": 0.01}}, 1000.0),
], ids=str)  # fmt: skip
def test_horizon_is_the_way_at_a_fifth_of_the_top_speed(options, horizon):
    """Rounded up to 0.1 s, from 1.2 to 1000 s. Time is observed beyond it, and a quarter of the top speed is enough."""
    task = Task(**options)
    assert Task(horizon=None, **options) == task
    assert (task.horizon, ObservationSpec(task).scale("time").high) == (horizon, max(1.25 * horizon, horizon + 0.15))
    if horizon < 10.0:
        far, (speed, acceleration) = task.scenario.distance[1], (0.25 * task.velocity_range[1], 5.0)
        env, action = gym.make(ID, **options), task.action.encode(speed, acceleration)
        info = play(env, Given(repeat(action)), seed=0, scenario={"distance": far}).info
        assert info["approach_time"] == pytest.approx(far / speed + 0.5 * speed / acceleration, rel=1e-3)


@pytest.mark.parametrize("options", [SLOW, {"velocity_range": (0.0, 1.0), "scenario": {"distance": 0.2}}], ids=str)
def test_horizon_stays_in_changed_tasks_and_in_files(options):
    """It stays also in a file's task without the scenario. A file of an earlier version means 1.2 s."""
    task, far = Task(**options), {"scenario": {"distance": (0.6, 0.96)}}
    assert task.changed(far) == Task(**options | far, horizon=task.horizon)
    assert task.changed(far | {"horizon": None}) == Task(**options | far)
    arguments = task.arguments()
    assert Task(**arguments) == Task.of_file(arguments) == task
    assert Task(**arguments | {"scenario": "train"}).horizon == task.horizon
    assert Task.of_file(options).horizon == 1.2


@pytest.mark.parametrize("limits", [{"force_limit": 10.0}, {"velocity_limit": 0.2}], ids=str)
def test_cost_is_1_in_the_last_step_of_an_episode_above_a_limit(limits):
    """Both `force_limit` and `velocity_limit` are off by default, see `play` in `episode_runs`."""
    env, ends, ((name, limit),) = gym.make(ID, **limits), [], limits.items()
    for seed, velocity in product(range(8), (-0.5, 0.3, 1.5)):
        _, *before, end = (step[-1] for step in steps(env, Given(repeat(encode(velocity, 20.0))), seed))
        assert [info["cost"] for info in before] == [0] * len(before)
        assert end["cost"] == (end["peak_force" if name == "force_limit" else "object_velocity"] > limit)
        ends.append(end["cost"])
    assert {*ends} == {0, 1}


@pytest.mark.parametrize("options", [{}, {"velocity_range": (-1.0, 0.5), "acceleration_range": (0.5, 10.0)}], ids=str)
def test_action_is_decoded_to_the_numbers_that_are_encoded(options):
    spec, action = Task(**options).action, np.random.default_rng(0).uniform(-1.2, 1.2, (200, 2))
    decoded = spec.decode(action)
    assert spec.encode(*decoded.T) == pytest.approx(np.clip(action, -1.0, 1.0), abs=2e-6)
    assert decoded == pytest.approx(np.round(decoded, 6), rel=1e-12)


RIPPLING = json.loads((Path(__file__).parents[1] / "helpers" / "rippling_scenes.json").read_text("utf-8"))
"""Draws and actions of two episodes of `ranged-robust`: the force of a contact falls to 0 twice in one step."""


@pytest.mark.parametrize(("frozen", "options", "velocity_error"), [
    *(("validation", {"alarm": alarm, "control_period": period, "reaction_delay": delay}, 1e-8)
      for alarm in ("force", "reading")
      for period, delay in ((0.016, 0.016), (0.011, 0.0), (0.016, 0.04), (0.004, 0.016), (0.008, 0.005), (0.15, 0.04))),
    ("validation", {"coupling": ig.Bistable(), "deflection_sensor": True, "range_noise": 0.0}, 1e-7),
    ("validation", {"range_noise": 0.02, "range_bias": -0.01, "observe_range_noise": True, "alarm": "reading"}, 1e-7),
    ("validation", {"reaction_delay": 0.0, "alarm_threshold": 5.0, "dissipation": "exact", "tool_mass": 0.2}, 1e-7),
    ("hard", {"coupling": ig.SpringDamper(150.0, 0.1), "reaction_delay": 0.005}, 1e-7),
    ("hard", dict(load_setup("bistable-blind").environment), 1e-7),
    ("validation", {"robot": ROBOT, "deflection_sensor": True}, 1e-7),
    ("validation", {"velocity_range": (-0.1, 1.0), "acceleration_range": (0.5, 8.0), "privileged": True}, 1e-7),
    ("validation", {"robot": ROBOT, "coupling": ig.Rigid()}, 1e-7),
    ("validation", {"friction": 0.3, "after_alarm": 0.2, "horizon": 1.0}, 1e-8),
    ("validation", {"friction": 0.8, "dissipation": "fixed", "reference_velocity": 0.5, "coupling": ig.Rigid()}, 1e-8),
], ids=str)  # fmt: skip
def test_random_actions_give_what_the_reference_gives(frozen, options, velocity_error):
    rows = 2
    actions = np.random.default_rng(3).uniform([-0.8, -1.0], [1.2, 1.0], (1000, rows, 2)).astype(np.float32)
    controller, task, scenarios = Given(actions), Task(**options), evaluation_sets.load(frozen)
    ours = ScenarioBatch.of(frozen, rows, task, time_weight=[1.0]).play(controller)
    seen = np.array(controller.seen)
    assert seen.dtype == np.float32
    for row in range(rows):
        scenario = {name: float(column[row]) for name, column in scenarios.scenario.items()}
        theirs = slow.play(task, scenario, actions[:, row], scenarios.seed + row)
        assert ours.contact_count[row] == theirs.contact_count
        assert ours.object_velocity[row] == pytest.approx(theirs.object_velocity, rel=0, abs=velocity_error)
        assert ours.approach_time[row] == pytest.approx(theirs.approach_time, rel=0, abs=1e-9)
        assert ours.peak_force[row] == pytest.approx(theirs.peak_force, rel=1e-6)
        count = len(theirs.observations)
        assert 0.24 / task.control_period < count <= len(seen)
        assert seen[:count, row] == pytest.approx(theirs.observations, rel=0, abs=1.3e-7)  # bits of a float32


@pytest.mark.parametrize("episode", RIPPLING, ids=["once", "twice"])
def test_contact_whose_force_is_0_twice_in_a_step_ends(episode):
    setup, drawn = load_setup("ranged-robust").environment, episode["drew"]
    env, actions = gym.make(ID, **setup, rtol=1e-5), np.array(episode["actions"], np.float32)
    _, rewards, info = play(env, Given(actions), 0, record=drawn)
    assert (len(rewards), info["status"]) == (len(actions), "ok")
    task = Task(**setup).at(drawn)
    fixed = {name: getattr(task, name) for name in ("tool_mass", "coupling", "robot", "alarm", "alarm_threshold")}
    fixed["reaction_delay"] = drawn["reaction_delay"]
    expected = slow.play(Task(**fixed), drawn, actions)
    assert info["object_velocity"] == pytest.approx(expected.object_velocity, abs=1e-6)
    assert info["contact_count"] == expected.contact_count


@pytest.mark.parametrize("coupling", [{"type": "Rigid"}, {"type": "SpringDamper", "stiffness": 50.0}])
@pytest.mark.parametrize("delay", [0.0, 0.021, 0.05, 0.084])
def test_exact_range_sensor_reads_the_gap_of_the_trace_late(delay, coupling):
    period, sensor = 0.021, RangeSensor(delay=delay)  # sums of this period are rounded down
    env = gym.make(ID, range_sensor=sensor, coupling=coupling, control_period=period, record_trace=True).unwrapped
    episode = steps(env, Given(repeat(encode(0.8, 10.0))), 3)
    seen = [[env.sensors()[name] for name in ("time", "range", "range_age")] for _ in episode]
    (time, gap, age), trace = np.array(seen).T, env.trace()
    late = -(-np.round(delay / period, 9) // 1) * period  # whole periods
    arrived = time >= late - 1e-9
    assert np.isinf([gap[~arrived], age[~arrived]]).all()
    before = arrived & (time < env.episode_info()["approach_time"])  # then steps are whole periods
    assert age[before] == pytest.approx(late, abs=1e-9)
    true = np.interp(time - age, trace.time, trace.object_position - trace.tool_position)
    assert gap[arrived] == pytest.approx(np.maximum(true[arrived], 0.0), abs=2e-6)
    assert before.sum() > 10


def readings(ticks, *names, **task):
    """Sensor values (names, ticks, 3000) 0.3 m before a flange at rest, each step after the first."""
    batch = Batch(3000, Task(scenario={"distance": 0.3}, **task))
    seen = [[batch.sensors()[name] for name in names] for _ in played(batch, encode(0.0, 20.0), ticks)]
    return np.array(seen).transpose(1, 0, 2)


def test_range_sensor_has_the_given_noise_bias_and_dropouts():
    noise, share, bias, dropout = 0.004, 0.02, 0.015, 0.3
    gap, age = readings(20, "range", "range_age", range_sensor=RangeSensor(noise, share, bias, dropout))
    fresh, spread = gap[age == 0.0], noise + share * 0.3
    assert stats.kstest(fresh[::7], stats.norm(0.3 + bias, spread).cdf).pvalue > 1e-3
    assert np.mean(age > 0.0) == pytest.approx(dropout, abs=2.5 / np.sqrt(age.size))
    assert age[1:] == pytest.approx(np.where(age[1:] > 0.0, age[:-1] + 0.016, 0.0), abs=1e-9)
    assert (gap[1:] == gap[:-1])[age[1:] > 0.0].all()  # a lost reading leaves the last one
    assert readings(3, "range", range_sensor=RangeSensor(noise=1.0)).min() == 0.0  # never negative


def test_noise_of_successive_range_readings_is_correlated():
    noise, rho, count = 0.004, 0.8, 12
    (gap,) = readings(count, "range", range_sensor=RangeSensor(noise, correlation=rho))
    error = (gap - 0.3) / noise  # (ticks, rows), stationary from the first reading on
    assert np.abs(error.mean(axis=1)).max() < 4.5 / np.sqrt(error.shape[1])
    assert np.abs(error.std(axis=1) - 1.0).max() < 4.5 / np.sqrt(2.0 * error.shape[1])
    expected = rho ** np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    assert np.corrcoef(error) == pytest.approx(expected, abs=4.5 / np.sqrt(error.shape[1]))


def test_range_sensor_has_the_drawn_scale_and_bias():
    (gap,) = readings(2, "range", range_sensor={"scale": (-0.2, 0.1)})
    assert np.array_equal(gap[0], gap[1])  # constant in an episode
    assert stats.kstest(gap[0] / 0.3, stats.uniform(0.8, 0.3).cdf).pvalue > 1e-3
    (gap,) = readings(1, "range", range_sensor={"scale": 0.1, "bias": (-0.02, 0.0)})
    assert stats.kstest(gap[0] - 0.33, stats.uniform(-0.02, 0.02).cdf).pvalue > 1e-3


def test_range_sensor_rounds_and_loses_what_is_out_of_range():
    noisy = RangeSensor(0.004, resolution=0.002), RangeSensor(0.004)
    rounded, exact = (readings(3, "range", range_sensor=each)[0] for each in noisy)
    assert rounded == pytest.approx(0.002 * np.round(exact / 0.002), abs=1e-12)
    for ends, lost in (((0.2, 0.299), True), ((0.301, 0.4), True), ((0.299, 0.301), False)):
        (age,) = readings(3, "range_age", range_sensor=RangeSensor(bias=0.05, nearest=ends[0], farthest=ends[1]))
        assert (np.isinf(age) if lost else age == 0.0).all()  # the true gap of 0.3 m counts, not the reading
    (age,) = readings(1, "range_age", range_sensor={"farthest": (0.28, 0.32)})
    assert np.isfinite(age).mean() == pytest.approx(0.5, abs=2.0 / np.sqrt(age.size))


@pytest.mark.parametrize("name", ig.sensors.PRESETS)
def test_sold_sensor_is_meant_by_its_name(name):
    own, preset = Task(range_sensor=name), getattr(ig.sensors, name)
    assert own == Task(range_sensor=preset) == Task(**own.arguments())
    assert own.drawn == {f"range_sensor.{each}": value for each, value in preset.items() if isinstance(value, tuple)}
    widest = load_setup("sensed-robust").task.ranges  # they hold all sensors
    for each, value in preset.items():
        low, high = widest[f"range_sensor.{each}"]
        assert low <= np.min(value) <= np.max(value) <= high


@pytest.mark.parametrize(("threshold", "sigma"), [(1.0, 0.5), (2.0, 2.0), (4.0, 5.0)])
def test_false_alarms_are_as_frequent_as_noise_above_threshold(threshold, sigma):
    rows, ticks, last, again, period = 3000, 40, 7, 0, 0.021  # an alarm lasts `last` steps; their sums are rounded down
    task = {"alarm": "reading", "alarm_threshold": threshold, "force_noise": sigma, "control_period": period}
    alarm, since, force = readings(ticks, "alarm", "time_since_alarm", "force", after_alarm=last * period, **task)
    assert force.min() == 0.0  # never negative
    share, first = stats.norm.sf(threshold / sigma), alarm[:last].mean(axis=1)
    expected = 1.0 - (1.0 - share) ** np.arange(1, last + 1)
    assert (np.abs(first - expected) < 4.0 * np.sqrt(expected * (1.0 - expected) / rows)).all()
    raised, over = np.full(rows, np.inf), np.zeros(rows, bool)
    for tick in range(ticks):
        ends = tick - raised >= last
        raised[ends], over = np.inf, over | ends
        begins = np.isinf(raised) & (force[tick] > threshold)
        raised[begins], again = tick, again + np.sum(begins & over)
        on = np.isfinite(raised)
        assert np.array_equal(alarm[tick], on)
        assert since[tick, on] == pytest.approx(period * (tick - raised[on]), abs=1e-6)
    assert again > 100


def test_detector_has_the_delay_and_false_alarms_of_pages_rule():
    rng = np.random.default_rng(0)
    own = dict.fromkeys((each.name for each in DETECTOR), 0.0) | {"allowance": 0.5, "detection": 5.0}
    rule = DetectorProfile([own.get(each.name, each.start) for each in DetectorProfile.PARAMETERS])
    rule = rule.for_task(Task(**DetectorProfile.NEEDS, force_noise=1.0))
    before, rows = 200, 1000
    seen, state, first = np.zeros((rows, len(rule.spec)), np.float32), None, np.full(rows, np.inf)
    for step in range(before + 60):  # after `before` steps the force is 1 N, one standard deviation, larger
        seen[:, rule.spec.index("force")] = rule.spec.encode("force", 20.0 + rng.normal(size=rows) + (step >= before))
        seen[:, rule.spec.index("time")] = rule.spec.encode("time", np.full(rows, 1e-3 * step))
        _, state = rule.predict(seen, state, np.zeros(rows, bool))
        first = np.where(np.isfinite(state[0]), np.minimum(first, step), first)
    going, ended = (rule.predict(seen, state, np.arange(rows) < count)[1][0] for count in (0, 500))
    assert np.isinf(ended[:500]).all()  # what it saw in an earlier episode is forgotten
    assert np.array_equal(ended[500:], going[500:])
    assert np.isfinite(going[:500]).mean() > 0.8
    assert 0.65 < (first >= before).mean() < 0.9  # one false alarm in 930 readings, exp(-200/930)
    assert (first[first >= before] - before + 1).mean() == pytest.approx(10.4, rel=0.1)
    # D. C. Montgomery, Introduction to Statistical Quality Control, table 9.3: k = 1/2, h = 5
