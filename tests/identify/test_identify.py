"""Numbers identified from logs of the independent solver, what a log cannot determine, and blows not fitted."""

import csv
import math
import re
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_hits import SCENE_FILE, blow, log, truths
from scipy.linalg import expm
from scipy.stats import binomtest
from solver_scenes import MOTION, SPRING, log_uniform, scene

import impact_gym as ig
from agents import load_setup
from impact_gym.identification.__main__ import main, set_up
from impact_gym.identification.held_out import HeldOut, Prediction
from impact_gym.identification.search import scatter

TRUTH, SLOW = scene(1e5, 0.5, SPRING), replace(MOTION, speed=0.5)
BOTH = ("force", "object_velocity")


def guess(coupling=SPRING, robot=None):
    return scene(1e4, 0.8, coupling, robot, m_p=1.0)


def assert_near(fit, of):
    for name, truth in truths(of).items():
        low, high = fit.interval[name]
        assert low < fit.estimate[name] < high
        assert abs(fit.estimate[name] - truth) <= high - low


def log_width(fit):
    return math.log(np.divide(*reversed(fit.interval["contact.stiffness"])))


@pytest.mark.parametrize(("truth", "recorded", "sensor"), [
    (scene(1e6, 0.5), {}, None),
    (scene(3e4, 0.7, SPRING, ig.Robot(5.225, 1.5e5, 53.75), m_p=0.1), {"columns": BOTH}, None),
    (TRUTH, {"columns": ("object_velocity",)}, None),
    (TRUTH, {"low_pass": 300.0, "bias": 2.0}, ig.Sensor(4000.0, 300.0, "estimated")),
], ids=["rigid", "robot, two columns", "velocity alone", "filter and bias"])  # fmt: skip
def test_identify_finds_the_numbers_behind_a_log(truth, recorded, sensor):
    given = log(truth, **recorded)
    columns = [name for name in given if name != "time"]
    fit = ig.identify(given, guess(truth.coupling, truth.robot), MOTION, sensor=sensor)
    assert_near(fit, truth)
    assert (fit.indistinguishable, fit.warnings) == ((), ())
    assert fit.start[0] == pytest.approx(1.0, abs=1e-3)
    assert fit.bias[0] == pytest.approx(dict.fromkeys(columns, recorded.get("bias", 0.0)), abs=0.3)
    if sensor is None and "force" in columns:
        trace = ig.simulate(fit.scene, MOTION, 0.4, trace=True).trace
        fitted = np.interp(given["time"] - fit.start[0], trace.time, trace.contact_force)
        assert fit.residuals[0]["force"] == pytest.approx(given["force"] - fitted, abs=1e-2 * fitted.max())
    for number, *starts in zip(fit.fit.model.free, *scatter(fit.fit.model), strict=False):
        low, high = map(number.coordinate, number.searched)  # a start in each part of the range
        assert len({*range(40)} & {math.floor(40 * (u - low) / (high - low)) for u in starts}) > 30
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
        few = sensor.senses(time[[0, -1]], start + rate * time[[0, -1]], at[::33])[0]  # the cell swings between them
        np.testing.assert_allclose(few, (states @ reads)[::33], rtol=0.0, atol=3e-5)


def test_identify_estimates_noise_or_uses_known_noise():
    """Twice the noise and a quarter of the logs double the interval, and leave the correlation."""
    assert ig.identify(log(TRUTH, noise=1e-5), guess(), MOTION).estimate == pytest.approx(truths(TRUTH), rel=1e-3)
    noise = 0.02 * log(TRUTH, noise=0.0)["force"].max()
    known, twice = (ig.identify(log(TRUTH), guess(), MOTION, sensor=ig.Sensor(noise=n)) for n in (noise, 2 * noise))
    alone = ig.identify(log(TRUTH), guess(), MOTION)
    assert [alone.noise["force"], np.std(known.residuals[0]["force"])] == pytest.approx([noise, noise], rel=0.2)
    assert log_width(twice) == pytest.approx(2 * log_width(known), rel=0.25)  # the misfit is no parabola
    four = ig.identify([log(TRUTH, seed=seed) for seed in range(4)], guess(), MOTION)
    assert_near(four, TRUTH)
    assert log_width(alone) / log_width(four) == pytest.approx(2.0, rel=0.25)
    assert np.allclose(alone.correlation, four.correlation, atol=0.1)
    assert f"correlation of contact.stiffness and object.mass: {alone.correlation[0, 2]:.2f}" in str(alone)
    force = log(TRUTH, after=0.012)  # until the brake
    both = force | {"flange_velocity": np.ones_like(force["time"])}  # without noise
    with_speed, without = (ig.identify(each, guess(), MOTION).estimate for each in (both, force))
    assert with_speed == pytest.approx(without, rel=1e-3)


@pytest.mark.parametrize(("rate", "estimated", "grown"), [(4000.0, False, 3.841), (550.0, True, 4.965)])
def test_interval_ends_where_the_misfit_grew_by_the_quantile(rate, estimated, grown):
    """By tables, 95 %: chi-squared with one degree of freedom, F with 1 and 10: 12 samples less start and stiffness."""
    recorded = log(TRUTH, rate=rate, noise=0.1, after=0.012)
    noise = 0.1 * log(TRUTH, noise=0.0)["force"].max()
    sensor = ig.Sensor(noise=None if estimated else noise)
    fit = ig.identify(recorded, scene(1e4, 0.5, SPRING), MOTION, ("contact.stiffness",), sensor)

    def misfit(stiffness):  # over a fine grid of start times
        trace = ig.simulate(scene(stiffness, 0.5, SPRING), MOTION, 0.4, trace=True).trace
        starts = fit.start[0] + np.linspace(-1e-3, 1e-3, 1001)
        fitted = np.interp(recorded["time"] - starts[:, None], trace.time, trace.contact_force)
        return np.min(np.sum((fitted - recorded["force"]) ** 2, axis=1))

    least = misfit(fit.estimate["contact.stiffness"])
    square = least / 10 if estimated else noise**2
    low, high = fit.interval["contact.stiffness"]
    assert low < fit.estimate["contact.stiffness"] < high
    assert [(misfit(end) - least) / square for end in (low, high)] == pytest.approx([grown, grown], rel=0.1)


def test_indistinguishable_names_an_object_too_heavy_to_weigh():
    fit = ig.identify(log(scene(1e5, 0.5, SPRING, m_p=50.0), after=0.012), guess(), MOTION)
    low, high = fit.interval["object.mass"]
    assert 1.0 < low < 50.0 < high == math.inf
    assert f"the log does not determine object.mass: any value above {low:.3g} kg fits equally well" in str(fit)


@pytest.mark.slow
def test_95_percent_intervals_contain_the_truth_that_often():
    """Random scenes and sensors; every fit has the same guess."""
    held = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        chain = ig.SpringDamper(log_uniform(rng, 40.0, 300.0), rng.uniform(0.3, 1.5)), ig.Robot(5.0, 2e5, 50.0)
        truth = scene(log_uniform(rng, 1e4, 1e6), rng.uniform(0.15, 0.9), *chain, m_p=log_uniform(rng, 0.05, 0.4))
        motion, rate = replace(MOTION, speed=rng.uniform(0.3, 1.2)), log_uniform(rng, 1e3, 8e3)
        low_pass = log_uniform(rng, 200.0, 2000.0) if rng.random() < 2 / 3 else None
        noise, bias = log_uniform(rng, 0.01, 0.1), rng.normal(0.0, 0.5)
        columns = BOTH[: rng.integers(1, 3)]
        sensor = dict.fromkeys(columns, ig.Sensor(rate, low_pass, "estimated"))
        recorded = log(truth, rate, noise, low_pass, bias, columns, seed, motion=motion)
        fit = ig.identify(recorded, scene(1e5, 0.5, *chain), motion, sensor=sensor)
        held.append([low <= truths(truth)[name] <= high for name, (low, high) in fit.interval.items()])
    for hits in np.sum(held, axis=0):
        assert binomtest(int(hits), 40, 0.95).pvalue > 0.003  # 33 to 40 of 40


@pytest.fixture
def identify(tmp_path):
    """Run the command on logs, with other lines of the scene's file."""

    def run(*options, logs=(), **lines):
        logs = logs or [log(TRUTH)]
        for k, columns in enumerate(logs):
            rows = np.column_stack([*columns.values()])
            np.savetxt(tmp_path / f"{k}.csv", rows, delimiter=",", header=",".join(columns), comments="")
        scene_file = [lines.get(line.partition(" ")[0], line) for line in SCENE_FILE.splitlines()]
        (tmp_path / "my.toml").write_text("\n".join(scene_file))
        paths = [str(tmp_path / f"{k}.csv") for k in range(len(logs))]
        main([*paths, "--scene", str(tmp_path / "my.toml"), *map(str, options)])

    return run


def test_intervals_become_ranges_of_the_set_up(identify, tmp_path):
    out = tmp_path / "setup.toml"
    identify("--out", out, "--plot", tmp_path / "a.png")
    setup = load_setup(out)
    scenario = setup.environment["scenario"]
    for name, truth in (("contact_stiffness", 1e5), ("restitution", 0.5), ("object_mass", 0.25)):
        low, high = scenario[name]
        assert 0.8 * truth < low < high < 1.25 * truth
    assert (setup.title, scenario["distance"]) == ("Our arm", 0.2505)
    assert (tmp_path / "a.png").stat().st_size > 0


@pytest.mark.parametrize("interval", [(-0.05, -0.0), (-math.inf, -0.01), (0.0, 0.05), (0.01, math.inf)])
def test_number_without_a_limit_on_one_side_keeps_its_value(interval):
    content = {"environment": {"coupling": {"rear_stop": 0.03}, "scenario": {}}}
    lines = set_up(content, SimpleNamespace(interval={"coupling.rear_stop": interval}), "")
    assert tomllib.loads("\n".join(lines)) == content


def test_other_numbers_are_fitted_and_the_doubts_printed(identify, tmp_path, capsys):
    """The tool has 2.002 m/s where it touches: sqrt(2 * 8 m/s^2 * 0.2505 m)."""
    speeds, free = (2.001, 2.003), ("contact.stiffness", "coupling.stiffness", "object.mass")
    logs = [log(TRUTH, columns=BOTH, motion=replace(MOTION, speed=speed), after=0.06) for speed in speeds]
    softer = "coupling = { type = 'SpringDamper', stiffness = 300.0, damping_ratio = 1.0 }"
    known = {"tool_mass": "", "speed": f"speed = {[*speeds]}", "restitution": "restitution = 0.5"}
    identify("--free", *free, logs=logs, coupling=softer, **known)
    (tmp_path / "printed.toml").write_text(printed := capsys.readouterr().out)
    assert "# default tool_mass used: 0.125 kg\n# motion.speed = 2.003 m/s is not reached in 0.2505 m" in printed
    assert printed.count("is not reached") == 1
    low, high = load_setup(tmp_path / "printed.toml").environment["coupling"]["stiffness"]
    assert low < 150.0 < high < 2 * low


def test_held_out_errors_are_relative_to_the_measured_values():
    rows = [("a", "impulse", 2.0, 2.2, 1.9), ("b", "impulse", -4.0, -3.0, math.nan), ("c", "duration", 0.0, 1.0, 1.0)]
    held = HeldOut(tuple(Prediction(*row) for row in rows))
    assert held.errors("impulse")[0] == pytest.approx([0.1, 0.25])
    assert [held.errors("impulse")[1][0], held.errors("duration")[0][0]] == pytest.approx([0.05, math.inf])
    *rows, summary = str(replace(held, predictions=held.predictions[:2])).splitlines()[1:]
    assert rows == ["a: impulse 2 N s, predicted 2.2, +10.0 %", "b: impulse -4 N s, predicted -3, -25.0 %"]
    assert re.findall(r"[\d.]+ %", summary) == ["17.5 %", "24.2 %", "5.0 %"]  # median, 0.1 + 0.95 * 0.15, equal blows


@pytest.mark.filterwarnings("default")
def test_hold_out_writes_predictions_beside_the_set_up(identify, tmp_path, capsys):
    logs = [log(TRUTH, motion=motion, seed=seed) for seed, motion in enumerate((MOTION, SLOW, MOTION, SLOW))]
    identify("--free", "contact.restitution", "--hold-out", "--out", tmp_path / "a.toml", logs=logs,
             speed="speed = [1.0, 0.5, 1.0, 0.5]")  # fmt: skip
    (printed, warned), text = capsys.readouterr(), (tmp_path / "a.toml").read_text()
    assert (
        f"impact-gym identify: warning: {tmp_path / '0.csv'}, force" in warned
    )  # it has another stiffness and mass than the file
    comments = text.partition("\ntitle")[0]
    assert comments == "\n".join(f"# {line}" for line in printed.splitlines())
    rows = list(csv.DictReader((tmp_path / "a.held-out.csv").read_text().splitlines()))
    assert [row["log"] for row in rows] == [str(tmp_path / f"{k}.csv") for k in range(4) for _ in range(3)]
    assert {row["equal blows"] for row in rows} == {"nan"}  # the halves have one speed each
    for row in rows:
        off = 100.0 * (float(row["predicted"]) / float(row["measured"]) - 1.0)
        assert re.search(rf"{row['log']}: {row['quantity']} .*, {re.escape(f'{off:+.1f}')} %\n", printed)


def test_slow_blows_are_predicted_from_fast_ones_and_reverse():
    """Compared with the independent solver without noise."""
    motions = [MOTION, SLOW]
    logs = [log(TRUTH, noise=0.01, columns=BOTH, seed=k, motion=each) for k, each in enumerate(motions)]
    for each in ig.hold_out(logs, TRUTH, motions).predictions:
        true = blow(TRUTH, motions[int(each.log.removeprefix("log ")) - 1], 0.03)
        widths = np.ptp(true.time[true.force > 0.5 * true.force.max()])
        last = true.object_velocity[true.time > true.time[0] + 0.02].mean()  # the last quarter of a log of 40 ms
        exact = {"object_velocity": last, "peak_force": true.force.max(), "duration": widths,
                 "impulse": 0.25 * true.object_velocity[-1]}  # fmt: skip
        assert each.predicted == pytest.approx(exact[each.quantity], rel=0.02)
        assert each.measured == pytest.approx(exact[each.quantity], rel=0.05)
        assert np.isnan(each.equal)


def test_equal_blows_are_the_median_of_the_fitted_half():
    logs = [log(scene(1e5, e, SPRING), noise=1e-4, columns=("object_velocity",)) for e in (0.3, 0.5, 0.6, 0.7, 0.4)]
    with pytest.warns(UserWarning, match="object_velocity"):  # one restitution is fitted to several
        found = ig.hold_out(logs, TRUTH, MOTION, free=("contact.restitution",))
    ends = [np.mean(each["object_velocity"][-40:]) for each in logs]  # the last quarter of 160
    assert [each.measured for each in found.predictions] == pytest.approx(ends)
    equal = [np.median(ends[1 - k % 2 :: 2]) for k in range(5)]
    assert [each.equal for each in found.predictions] == pytest.approx(equal)
    assert [each.predicted for each in found.predictions] == pytest.approx(equal, rel=0.03)  # e is near the middle one
