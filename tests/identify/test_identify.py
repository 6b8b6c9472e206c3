"""Numbers identified from logs of the independent solver, their intervals, and what a log cannot determine."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from recorded_hits import MOTION, SPRING, log, scene, truths
from scipy.linalg import expm
from scipy.stats import binomtest
from solver_scenes import log_uniform

import impact_gym as ig
from impact_gym.identify.fit import BEYOND, Fit, intervals
from impact_gym.identify.model import free_coordinates

TRUTH = scene(1e5, 0.5)


def guess(coupling=SPRING, robot=None):
    return scene(1e4, 0.8, 1.0, coupling, robot)


@lru_cache
def identified(seed=0):
    """The fit of a log of force alone, 4 kHz and 2 % of noise."""
    return ig.identify(log(TRUTH, seed=seed), guess(), MOTION)


def assert_near(fit, of):
    """Each estimate is within two half widths of its 95 % interval from the truth."""
    for name, truth in truths(of).items():
        low, high = fit.interval[name]
        assert low < fit.estimate[name] < high
        assert abs(fit.estimate[name] - truth) <= high - low


def log_width(fit, name="contact.stiffness"):
    low, high = fit.interval[name]
    return math.log(high / low)


@pytest.mark.parametrize(("truth", "recorded", "sensor"), [
    (scene(1e6, 0.5, coupling=ig.Rigid()), {}, None),
    (scene(2e5, 0.3), {}, None),
    (scene(3e4, 0.7, 0.1, robot=ig.Robot(5.225, 1.5e5, 53.75)), {"columns": ("force", "object_velocity")}, None),
    (TRUTH, {"columns": ("object_velocity",)}, None),
    (TRUTH, {"low_pass": 300.0, "bias": 2.0}, ig.Sensor(4000.0, 300.0, "estimated")),
], ids=["rigid", "spring", "robot, two columns", "velocity alone", "filter and bias"])  # fmt: skip
def test_identify_finds_the_numbers_behind_a_log(truth, recorded, sensor):
    given = log(truth, **recorded)
    columns = [name for name in given if name != "time"]
    fit = ig.identify(given, guess(truth.coupling, truth.robot), MOTION, sensor=sensor)
    assert_near(fit, truth)
    assert (fit.indistinguishable, fit.warnings) == ((), ())
    assert fit.scene.contact.stiffness == fit.estimate["contact.stiffness"]
    assert fit.start[0] == pytest.approx(1.0, abs=1e-3)
    assert fit.bias[0] == pytest.approx(dict.fromkeys(columns, recorded.get("bias", 0.0)), abs=0.3)
    trace = ig.simulate(fit.scene, MOTION, 0.4, trace=True).trace
    for name, values in {"force": trace.contact_force, "object_velocity": trace.object_velocity}.items():
        if name in columns and sensor is None:
            fitted = np.interp(given["time"] - fit.start[0], trace.time, values)
            assert fit.residuals[0][name] == pytest.approx(given[name] - fitted, abs=1e-2 * fitted.max())
    labels = [axes.get_ylabel() for axes in fit.plot().axes]
    assert labels[1::2] == ["residual over noise"] * len(columns)
    assert labels[::2] == [f"{name} ({'N' if name == 'force' else 'm/s'})" for name in columns]


@pytest.mark.parametrize("low_pass", [None, 100.0])
@pytest.mark.parametrize("damping_ratio", [None, 0.0, 0.05, 0.7])
def test_sensor_responds_to_a_step_and_a_ramp_by_its_equations(damping_ratio, low_pass):
    """The matrix exponential of p'' = w^2 (F - p) - 2 z w p', y' = g (R - y), F' = a, with R = p + 2 z p' / w."""
    w, z, g = 2.0 * np.pi * 700.0, damping_ratio or 0.0, 2.0 * np.pi * (low_pass or 0.0)
    cell = None if damping_ratio is None else ig.LoadCell(0.02, 700.0, z)
    sensor, time, at = ig.Sensor(low_pass=low_pass, cell=cell), np.linspace(0.0, 0.01, 41), np.linspace(0.0, 0.01, 67)
    element = np.array([0, 0, 0, 1, 0] if cell is None else [1, 2 * z / w, 0, 0, 0])  # R of (p, p', y, F, a)
    rates = np.array([[0, 1, 0, 0, 0], [-w * w, -2 * z * w, 0, w * w, 0], g * (element - np.eye(5)[2]), np.eye(5)[4],
                      np.zeros(5)])  # fmt: skip
    reads = np.eye(5)[2] if low_pass else element
    for start, rate in ((1.0, 0.0), (0.0, 300.0)):
        states = np.array([expm(rates * t) @ [0.0, 0.0, 0.0, start, rate] for t in at])
        value, slope = sensor.senses(time, start + rate * time, at)
        np.testing.assert_allclose(value, states @ reads, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(slope, states @ rates.T @ reads, rtol=0.0, atol=1e-6 * w)


def test_identify_estimates_noise_or_uses_known_noise():
    assert ig.identify(log(TRUTH, noise=1e-5), guess(), MOTION).estimate == pytest.approx(truths(TRUTH), rel=1e-3)
    clear = log(TRUTH, noise=1e-5, after=0.012)  # the flange does not brake yet
    clear["flange_velocity"] = np.ones_like(clear["time"])
    steady = ig.identify(clear, scene(1e4, 0.5), MOTION, ("contact.stiffness",))
    assert steady.estimate == pytest.approx({"contact.stiffness": 1e5}, rel=1e-3)
    assert steady.noise["flange_velocity"] < 1e-6
    noise = 0.02 * log(TRUTH, noise=0.0)["force"].max()
    known, twice = (ig.identify(log(TRUTH), guess(), MOTION, sensor=ig.Sensor(noise=n)) for n in (noise, 2 * noise))
    assert [identified().noise["force"], np.std(known.residuals[0]["force"])] == pytest.approx([noise, noise], rel=0.2)
    assert log_width(twice) == pytest.approx(2 * log_width(known), rel=0.25)  # the misfit is no parabola
    four = ig.identify([log(TRUTH, seed=seed) for seed in range(4)], guess(), MOTION)
    assert_near(four, TRUTH)
    assert log_width(identified()) / log_width(four) == pytest.approx(2.0, rel=0.25)
    assert len(four.start) == len(four.residuals) == 4


def test_identify_fits_other_numbers_of_the_scene():
    recorded = log(TRUTH, columns=("force", "object_velocity"), after=0.06)
    start, free = scene(1e4, 0.5, coupling=ig.SpringDamper(300.0)), ("contact.stiffness", "coupling.stiffness")
    fit = ig.identify(recorded, start, MOTION, free)
    low, high = fit.interval["coupling.stiffness"]
    assert low < 150.0 < high < 2 * low


@pytest.mark.parametrize(("rate", "estimated", "grown"), [(4000.0, False, 3.841), (550.0, True, 4.965)])
def test_interval_ends_where_the_misfit_grew_by_the_quantile(rate, estimated, grown):
    """By tables, 95 %: chi-squared with one degree of freedom, F with 1 and 10: 12 samples less start and stiffness."""
    recorded = log(TRUTH, rate=rate, noise=0.1, after=0.012)
    noise = 0.1 * log(TRUTH, noise=0.0)["force"].max()
    sensor = ig.Sensor(noise=None if estimated else noise)
    fit = ig.identify(recorded, scene(1e4, 0.5), MOTION, ("contact.stiffness",), sensor)

    def misfit(stiffness):  # over a fine grid of start times
        trace = ig.simulate(scene(stiffness, 0.5), MOTION, 0.4, trace=True).trace
        starts = fit.start[0] + np.linspace(-1e-3, 1e-3, 1001)
        fitted = np.interp(recorded["time"] - starts[:, None], trace.time, trace.contact_force)
        return np.min(np.sum((fitted - recorded["force"]) ** 2, axis=1))

    least = misfit(fit.estimate["contact.stiffness"])
    square = least / 10 if estimated else noise**2
    low, high = fit.interval["contact.stiffness"]
    assert low < fit.estimate["contact.stiffness"] < high
    assert [(misfit(end) - least) / square for end in (low, high)] == pytest.approx([grown, grown], rel=0.1)


class Misfit:
    """A stand-in for `Model`: x = (ln(object.mass), v), with the misfit `profile(x[0])` at the best v, x[0]."""

    size = samples = 2

    def __init__(self, profile):
        self.profile, self.tried = profile, set()
        self.free, self.sensors = free_coordinates(TRUTH, ("object.mass",)), {"force": ig.Sensor(noise=1.0)}

    def residuals(self, x):
        self.tried.add(x[0])
        return np.array([math.sqrt(self.profile(x[0])), x[1] - x[0]])

    def jacobian(self, x, skip):
        return np.array([[math.nan, 0.0], [-1.0, 1.0]])


@pytest.mark.parametrize("well", [0.0, 0.4])
def test_interval_contains_an_equal_minimum_behind_a_ridge(well):
    model = Misfit(lambda u: min((u / 0.1) ** 2, ((u - well) / 0.1) ** 2 + 2.0 * (well > 0.0)))
    covariance = 0.1**2 * np.array([[1.0, 1.0], [1.0, 2.0]])
    fit = Fit(model, np.zeros(2), 0.0, covariance, covariance, [])
    _, ((low, high),) = intervals(fit)
    assert intervals(replace(fit, model=Misfit(lambda u: min((u / 0.1) ** 2, 3.0))))[1] == [(None, None)]
    assert low < 0.0 <= well < high
    assert [model.profile(low), model.profile(high)] == pytest.approx([3.841, 3.841], rel=0.04)  # twice END_TOLERANCE
    assert well or len(model.tried) == 2 * (1 + len(BEYOND))  # a parabola ends where its curvature says


def test_indistinguishable_names_an_object_too_heavy_to_weigh():
    fit = ig.identify(log(scene(1e5, 0.5, 50.0), after=0.012), guess(), MOTION)
    low, high = fit.interval["object.mass"]
    assert 1.0 < low < 50.0 < high == math.inf
    assert f"the log does not determine object.mass: any value above {low:.3g} kg fits equally well" in str(fit)


def test_indistinguishable_names_what_a_long_filter_mixes():
    recorded = log(scene(1e7, 0.5, coupling=ig.Rigid()), low_pass=5.0, noise=0.1, after=0.012, seed=1)
    free = ("contact.restitution", "object.mass")
    fit = ig.identify(recorded, scene(1e7, 0.8, 1.0, ig.Rigid()), MOTION, free, ig.Sensor(low_pass=5.0))
    low, high = fit.interval["contact.restitution"]
    assert 0.0 < low < 0.5 < high == 1.0
    assert fit.correlation[0, 1] < -0.95
    restitution, pair = fit.indistinguishable
    assert restitution.endswith(f"contact.restitution: any value above {low:.3g} fits equally well")
    assert "contact.restitution and object.mass: a larger contact.restitution with a smaller object.mass" in pair


def test_correlation_hardly_depends_on_the_noise():
    fits = identified(0), identified(1)
    assert len({*fits, *(fit.fit for fit in fits)}) == 4  # objects with arrays are compared by identity
    assert np.allclose(fits[0].correlation, fits[1].correlation, atol=0.1)
    assert np.allclose(np.diag(fits[0].correlation), 1.0)
    assert f"correlation of contact.stiffness and object.mass: {fits[0].correlation[0, 2]:.2f}" in str(fits[0])


@pytest.mark.slow
def test_95_percent_intervals_contain_the_truth_that_often():
    """Random scenes, recorded by random sensors with partly known properties; every fit has the same guess."""
    held = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        spring = ig.SpringDamper(log_uniform(rng, 40.0, 300.0), rng.uniform(0.3, 1.5))
        robot = ig.Robot(rng.uniform(3.5, 7.0), log_uniform(rng, 1e5, 1e6), rng.uniform(30.0, 80.0))
        chain = ig.Rigid() if seed % 4 == 2 else spring, robot if seed % 4 == 3 else None
        truth = scene(log_uniform(rng, 1e4, 1e6), rng.uniform(0.15, 0.9), log_uniform(rng, 0.05, 0.4), *chain)
        motion = replace(MOTION, speed=rng.uniform(0.3, 1.2))
        columns = ("force", "object_velocity")[: rng.integers(1, 3)]
        low_pass = log_uniform(rng, 200.0, 2000.0) if rng.random() < 2 / 3 else None
        logged = {"rate": log_uniform(rng, 1e3, 8e3), "low_pass": low_pass, "columns": columns, "motion": motion}
        noise, bias, known = log_uniform(rng, 0.01, 0.1), rng.choice([0.0, rng.normal(0.0, 0.5)]), rng.random() < 0.5
        noises = {name: noise * values.max() for name, values in log(truth, noise=0.0, **logged).items()}
        offset = "estimated" if bias else 0.0
        given = noises if known else dict.fromkeys(columns)
        sensor = {name: ig.Sensor(logged["rate"], low_pass, offset, given[name]) for name in columns}
        recorded = log(truth, noise=noise, bias=bias, seed=seed, **logged)
        fit = ig.identify(recorded, scene(1e5, 0.5, 0.25, *chain), motion, sensor=sensor)
        held.append([low <= truths(truth)[name] <= high for name, (low, high) in fit.interval.items()])
    for hits in np.sum(held, axis=0):
        assert binomtest(int(hits), 40, 0.95).pvalue > 0.003  # 33 to 40 of 40
