"""What the controller sees and what it must not see; sensors with errors; alarms raised by readings; detectors."""

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import ID, ROBOT, Always, encode, steps
from scipy import stats

import impact_gym as ig
from agents.baselines import BlindProfile
from agents.baselines.detector import DETECTOR, DetectorProfile
from agents.evaluate.scenario_batch import ScenarioBatch
from impact_gym.envs.batch import Batch
from impact_gym.task import ObservationSpec, Task
from impact_gym.task.range_sensor import RangeSensor

READING, SPEC = {"alarm": "reading"}, ObservationSpec(Task())
ALARM, SINCE, FORCE = 3, 4, 5
"""Their places in an observation, by the table of the environment's documentation."""


def at_rest(ticks, rows, **options):
    """Observations (ticks, rows, n_obs) of a batch of arms that stand still, out of reach of any object."""
    envs = gym.make_vec(ID, num_envs=rows, **options)
    envs.reset(seed=0)
    still = np.tile(encode(0.0, 20.0), (rows, 1))
    return np.array([envs.step(still)[0] for _ in range(ticks)], float)


def test_observations_before_the_touch_do_not_show_the_object():
    envs = gym.make_vec(ID, num_envs=300, scenario="hard")
    rng, history, touched = np.random.default_rng(0), [envs.reset(seed=0)[0]], np.full(300, np.nan)
    while np.isnan(touched).any():
        action = (0.4 * rng.uniform(-1.0, 1.0, 2) + [0.4, 0.0]).astype(np.float32)
        observations, _, ended, _, infos = envs.step(np.tile(action, (300, 1)))
        touched = np.where(ended & np.isnan(touched), infos.get("approach_time", np.nan), touched)
        history.append(observations)
    differ, ticks, alike = 0, len(history), np.array(history)[:, np.argmax(touched)]
    for row, seen in enumerate(np.array(history).transpose(1, 0, 2)):
        first = min(int(np.ceil(touched[row] / 0.016 + 1.0)), ticks - 1)  # the first one a delay after the touch
        assert np.array_equal(seen[:first], alike[:first])
        differ += not np.array_equal(seen[first], alike[first])
    assert differ > 100


def test_force_readings_are_never_negative_with_a_normal_bias():
    assert not at_rest(5, 2000)[..., FORCE].any()
    noise = SPEC.decode(at_rest(9, 2000, force_noise=0.3), "force")
    assert noise.min() == 0.0
    assert np.mean(noise == 0.0) == pytest.approx(0.5, abs=2.5 / np.sqrt(noise.size))
    assert stats.kstest(noise[noise > 0.0], stats.halfnorm(scale=0.3).cdf).pvalue > 1e-3
    bias = SPEC.decode(at_rest(6, 2000, force_bias=0.3), "force")
    assert np.ptp(bias, axis=0) == pytest.approx(0.0, abs=1e-6)  # constant in an episode
    assert stats.kstest(bias[3][bias[3] > 0.0], stats.halfnorm(scale=0.3).cdf).pvalue > 1e-3


@pytest.mark.parametrize("coupling", [ig.Rigid(), ig.SpringDamper(50.0)], ids=str)
def test_bodies_are_where_the_trace_ends(coupling):
    batch = Batch(1, Task(coupling=coupling, robot=ROBOT), threads=1, trace_points=5000)
    batch.begin_seeded(3, {"distance": 0.05})
    for _ in range(12):
        batch.step(encode([0.7], [15.0]), batch.ended)
        trace, bodies = batch.trace(0), batch.bodies()
        ends = [getattr(trace, f"{body}_position")[-1] for body in ("flange", "tool", "object")]
        assert np.array(bodies[:4])[:, 0] == pytest.approx([trace.time[-1], *ends], abs=1e-12)
        assert bodies.touched == (trace.contact_force.max() > 0.0)
        if coupling != ig.Rigid():
            assert bodies.deflection == pytest.approx(bodies.tool - bodies.flange, abs=1e-12)
            rate = trace.tool_velocity[-1] - trace.flange_velocity[-1]
            assert bodies.deflection_rate == pytest.approx(rate, abs=1e-12)


@pytest.mark.parametrize("coupling", [{"type": "Rigid"}, {"type": "SpringDamper", "stiffness": 50.0}])
@pytest.mark.parametrize("delay", [0.0, 0.021, 0.05, 0.084])
def test_exact_range_sensor_reads_the_gap_of_the_trace_late(delay, coupling):
    period, sensor = 0.021, RangeSensor(delay=delay)  # sums of this period are rounded down
    env = gym.make(ID, range_sensor=sensor, coupling=coupling, control_period=period, record_trace=True).unwrapped
    seen = [[env.sensors()[name] for name in ("time", "range", "range_age")] for _ in steps(env, Always(0.8, 10.0), 3)]
    (time, gap, age), trace = np.array(seen).T, env.trace()
    late = -(-np.round(delay / period, 9) // 1) * period  # whole periods
    arrived = time >= late - 1e-9
    assert np.isinf([gap[~arrived], age[~arrived]]).all()
    before = arrived & (time < env.episode_info()["approach_time"])  # then steps are whole periods
    assert age[before] == pytest.approx(late, abs=1e-9)
    true = np.interp(time - age, trace.time, trace.object_position - trace.tool_position)
    assert gap[arrived] == pytest.approx(np.maximum(true[arrived], 0.0), abs=2e-6)
    assert before.sum() > 10


def readings(ticks, **sensor):
    """Range and age (ticks, 3000) 0.3 m before a flange at rest, each step after the first."""
    batch, seen = Batch(3000, Task(scenario={"distance": 0.3}, range_sensor=sensor)), []
    batch.begin_seeded(0, {})
    for _ in range(ticks):
        batch.step(np.tile(encode(0.0, 20.0), (3000, 1)), batch.ended)
        seen.append([batch.sensors()[name] for name in ("range", "range_age")])
    return np.array(seen).transpose(1, 0, 2)


def test_range_sensor_has_the_given_noise_bias_and_dropouts():
    noise, share, bias, dropout = 0.004, 0.02, 0.015, 0.3
    gap, age = readings(20, noise=noise, share=share, bias=bias, dropout=dropout)
    fresh, spread = gap[age == 0.0], noise + share * 0.3
    assert stats.kstest(fresh[::7], stats.norm(0.3 + bias, spread).cdf).pvalue > 1e-3
    assert fresh.mean() == pytest.approx(0.3 + bias, abs=5.0 * spread / np.sqrt(fresh.size))
    assert np.mean(age > 0.0) == pytest.approx(dropout, abs=2.5 / np.sqrt(age.size))
    assert age[1:] == pytest.approx(np.where(age[1:] > 0.0, age[:-1] + 0.016, 0.0), abs=1e-9)
    assert (gap[1:] == gap[:-1])[age[1:] > 0.0].all()  # a lost reading leaves the last one
    gap, _ = readings(5, bias=(-0.05, 0.05))  # constant in an episode
    assert np.ptp(gap, axis=0) == pytest.approx(0.0, abs=1e-12)
    assert stats.kstest(gap[0] - 0.3, stats.uniform(-0.05, 0.1).cdf).pvalue > 1e-3
    assert readings(3, noise=1.0)[0].min() == 0.0  # never negative


@pytest.mark.parametrize(("threshold", "sigma"), [(1.0, 0.5), (2.0, 2.0), (4.0, 5.0)])
def test_false_alarms_are_as_frequent_as_noise_above_threshold(threshold, sigma):
    rows, ticks, last, again, period = 1500, 40, 7, 0, 0.021  # an alarm lasts `last` steps; their sums are rounded down
    options = {"alarm_threshold": threshold, "control_period": period, "after_alarm": last * period, **READING}
    seen = at_rest(ticks, rows, force_noise=sigma, **options)
    share, first = stats.norm.sf(threshold / sigma), seen[:last, :, ALARM].mean(axis=1)
    expected = 1.0 - (1.0 - share) ** np.arange(1, last + 1)
    assert (np.abs(first - expected) < 4.0 * np.sqrt(expected * (1.0 - expected) / rows)).all()
    on, values, since = seen[:, :, ALARM] > 0.5, SPEC.decode(seen, "force"), last * period * seen[:, :, SINCE]
    raised, over = np.full(rows, np.inf), np.zeros(rows, bool)
    for tick in range(ticks):
        ends = tick - raised >= last
        raised[ends], over = np.inf, over | ends
        begins = np.isinf(raised) & (values[tick] > threshold)
        raised[begins], again = tick, again + np.sum(begins & over)
        assert np.array_equal(on[tick], np.isfinite(raised))
        assert since[tick, on[tick]] == pytest.approx(period * (tick - raised[on[tick]]), abs=1e-6)
    assert again > 100


def test_false_alarm_ends_no_episode():
    tasks = [Task(force_noise=noise, **READING) for noise in (0.0, 5.0)]
    quiet, noisy = (ScenarioBatch(4, 100, task).play(Always(0.7, 20.0)) for task in tasks)
    assert quiet.object_velocity == pytest.approx(noisy.object_velocity, rel=1e-7, abs=1e-9)
    assert quiet.approach_time == pytest.approx(noisy.approach_time, rel=1e-7, abs=1e-9)


def detector(*numbers, **environment):
    """A profile with these numbers of the detector."""
    own = dict(zip((each.name for each in DETECTOR), numbers, strict=True))
    rule = DetectorProfile([own.get(each.name, each.start) for each in DetectorProfile.PARAMETERS])
    return rule.for_task(Task(**{**DetectorProfile.NEEDS, **environment}))


def test_detector_has_the_delay_and_false_alarms_of_pages_rule():
    rule, rng = detector(0.5, 0.0, 5.0, 0.0, 0.0, 0.0, force_noise=1.0), np.random.default_rng(0)
    before, rows = 200, 1000
    seen, state, first = np.zeros((rows, len(rule.spec)), np.float32), None, np.full(rows, np.inf)
    for step in range(before + 60):  # after `before` steps the force is 1 N, one standard deviation, larger
        seen[:, rule.spec.index("force")] = rule.spec.encode("force", 20.0 + rng.normal(size=rows) + (step >= before))
        seen[:, rule.spec.index("time")] = rule.spec.encode("time", np.full(rows, 1e-3 * step))
        _, state = rule.predict(seen, state, np.zeros(rows, bool))
        first = np.where(np.isfinite(state[0]), np.minimum(first, step), first)
    assert 0.65 < (first >= before).mean() < 0.9  # one false alarm in 930 readings, exp(-200/930)
    assert (first[first >= before] - before + 1).mean() == pytest.approx(10.4, rel=0.1)
    # D. C. Montgomery, Introduction to Statistical Quality Control, table 9.3: k = 1/2, h = 5


def test_detector_reports_a_kick_and_not_the_tools_oscillation():
    rule, steps = detector(0.0, 0.0, 1.0, 0.0, 1000.0, 0.8), np.arange(20)
    swing = (0.01 + 0.02 * steps) * 0.8**steps  # of a free, critically damped tool
    for kick, touched in ((0.0, False), (-0.005, True)):  # m
        state, seen = None, np.zeros((1, len(rule.spec)), np.float32)
        for step in range(2, 20):
            for name, back in (("deflection", 0), ("deflection_1", 1), ("deflection_2", 2)):
                value = swing[step - back] + kick * (step - back >= 10)
                seen[:, rule.spec.index(name)] = rule.spec.encode(name, np.array([value]))
            _, state = rule.predict(seen, state, np.zeros(1, bool))
        assert np.isfinite(state[0]).all() == touched


def test_detector_is_an_exact_alarm_and_survives_false_ones():
    # it reports a touch if one reading exceeds the mean of the earlier ones by `threshold`, N

    def played(threshold, **environment):
        environment |= {**READING, "deflection_sensor": True, "past_readings": 2}
        trusting = BlindProfile([parameter.start for parameter in BlindProfile.PARAMETERS])
        judging = detector(threshold - 0.01, 0.0, 0.01, 0.0, 0.0, 0.0) if threshold else trusting
        stage = ScenarioBatch.of("validation", 200, Task(**environment))
        return stage.play(judging.for_task(Task(**{**DetectorProfile.NEEDS, **environment})))

    trusting, judging, deaf = (played(each, alarm_threshold=3.0).object_velocity for each in (None, 3.0, 20.0))
    assert np.mean(trusting == judging) > 0.98  # readings below 3 N are in the mean
    assert (deaf > 1.1 * trusting).mean() > 0.3
    missed = [played(threshold, force_noise=3.0).missed.sum() for threshold in (None, 1.0, 8.0, 20.0)]
    assert min(missed[:2]) > 100  # these thresholds are within the noise
    assert missed[2:] == [0, 0]


def test_detector_forgets_the_last_episode():
    rule = detector(0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    quiet, hit = (np.zeros((2, len(rule.spec)), np.float32) for _ in range(2))
    hit[:, rule.spec.index("force")] = 1.0  # 1 kN
    state = rule.predict(hit, rule.predict(quiet)[1])[1]
    assert np.isfinite(state[0]).all()
    _, state = rule.predict(quiet, state, np.array([True, False]))
    assert np.isfinite(state[0]).tolist() == [False, True]
    assert np.isfinite(rule.predict(quiet, state)[1][0]).tolist() == [False, True]
