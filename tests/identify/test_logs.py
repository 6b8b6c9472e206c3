"""Files of recorders, units and accelerations; doubts about a fit, just within and beyond a border."""

import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_hits import FORCE, NOISE, SCENE, TIME, log, put, truths
from refusal import refused
from scipy.optimize import brentq
from scipy.stats import chi2, f, norm
from solver_scenes import MOTION, SPRING, scene

import impact_gym as ig
from impact_gym.identification.log import Log, read
from impact_gym.identification.model import Model, free_coordinates
from impact_gym.identification.result import _words, misfits
from impact_gym.support.column_names import SCALES, Column
from impact_gym.support.csv_files import read_columns

STAMPS, PUSHES = np.arange(20) / 51200, 12.0 * np.sin(np.arange(20))  # s, N
GRAVITY = 9.80665  # m/s^2, by definition
EXAMPLES = tomllib.loads(Path(__file__).with_name("recorder_files.toml").read_text("utf-8"))
UNITS = EXAMPLES["units"]


@pytest.mark.parametrize("unit", UNITS)
def test_every_unit_is_read_with_its_factor_to_the_si(unit, tmp_path):
    factors = {name: factor for names, factor in UNITS[unit].items() for name in names.split()}
    path, wanted = tmp_path / "a.csv", {"time": Column("s", "time"), "x": Column(unit, "x")}
    assert set(SCALES[unit]) <= set(factors)
    for name in (*factors, "MN", "Ms", "stone"):  # M is mega
        path.write_text(f"time,x [{name}]\n0,1\n1,-3\n", encoding="utf-8")
        if name in factors:
            x = read_columns(path, wanted, ("time", "x"))[0]["x"]
            assert x == pytest.approx([factors[name], -3.0 * factors[name]], rel=1e-14), name
        else:
            refused(lambda: read_columns(path, wanted, ("time", "x")), "unit must be one of", f"got {name!r}")


def table(head, separator=",", decimal=".", end="", of_time=1.0, of_force=1.0, foot="", encoding="utf-8"):
    values = zip(STAMPS / of_time, PUSHES / of_force, strict=True)
    lines = [f"{time:.9e}{separator}{force:.9e}{end}" for time, force in values]
    return (head + "\n".join(lines).replace(".", decimal) + "\n" + foot).encode(encoding)


FILES = {name: table(**how) for name, how in EXAMPLES["files"].items()}
FILES["Excel on Windows"] = table("time (s),force (N)\n").replace(b"\n", b"\r\n")


@pytest.mark.parametrize("name", FILES)
def test_file_of_a_recorder_is_read_in_seconds_and_newtons(name, tmp_path):
    (path := tmp_path / "log.csv").write_bytes(FILES[name])
    log = read(path, "")
    assert log.time == pytest.approx(STAMPS, rel=1e-8, abs=1e-15)
    assert log.columns["force"] == pytest.approx(PUSHES, rel=1e-8)
    assert log.said.startswith("read 20 samples at 51.2 kHz from ")
    assert ("not used: 'note', 'temp'" in log.said) == (name == "extra columns")


@pytest.mark.parametrize("stamps", EXAMPLES["stamps"])
def test_dates_and_clock_times_become_seconds_since_the_first(stamps, tmp_path):
    (tmp_path / "a.csv").write_text("time;force\n" + "\n".join(f"{stamp};1" for stamp in stamps.split()))
    wanted = {"time": Column("s", "time"), "force": Column("N", "force")}
    columns, said = read_columns(tmp_path / "a.csv", wanted, tuple(wanted))
    assert columns["time"] == pytest.approx(EXAMPLES["stamps"][stamps], rel=1e-12)
    assert "time (s) from 'time' as dates or times" in said


@pytest.mark.parametrize("gap", ["", "nan", "NaN", "NA", "-", "null", '"nan"', " * ", "-1.#IND"])
def test_line_without_a_value_counts_as_a_lost_sample(gap, tmp_path):
    lines = table("time,force\n").decode().splitlines()
    without = [line if k not in (1, 9) else f"{line.split(',')[0]},{gap}" for k, line in enumerate(lines)]
    (tmp_path / "log.csv").write_text("\n".join(without))
    log = read(tmp_path / "log.csv", "")
    assert log.columns["force"] == pytest.approx(np.delete(PUSHES, [0, 8]))
    assert log.said.endswith("lines left out, as they lack a value: 2; 1 sample lost")


def test_lost_samples_count_for_the_rate(tmp_path):
    lines = table("t [ms],object accel. (g)\n", of_time=1e-3, of_force=GRAVITY).decode().splitlines()
    (tmp_path / "log.csv").write_text("\n".join(lines[:9] + lines[10:]))
    log = read(tmp_path / "log.csv", "")
    assert log.columns["object_acceleration"] == pytest.approx(np.delete(PUSHES, 8))  # m/s^2
    assert log.said.startswith("read 19 samples at 51.2 kHz")
    assert log.said.endswith("1 sample lost")
    rounded = np.round(np.arange(1000) / 51200, 6)  # to 1 us; the median step would give 50 kHz
    for stamps in (rounded, rounded + 0.7 * (np.arange(1000) % 7 == 3) / 51200):
        assert 1.0 / Log("a", stamps, {}).step == pytest.approx(51200.0, rel=1e-4)


@pytest.mark.parametrize("friction", [None, 0.4])
def test_accelerations_are_the_slopes_of_the_velocities(friction):
    """A load cell reads the force and its mass times the tool's acceleration."""
    names, cell = ("tool_acceleration", "object_acceleration"), ig.Sensor(cell=ig.LoadCell(0.03, 2e4, 0.5))
    struck = replace(SCENE, object=replace(SCENE.object, friction=friction))
    blow = ig.simulate(struck, MOTION, 0.5, trace=True).trace
    sensors = dict.fromkeys(names, ig.Sensor()) | {"force": cell}
    model = Model([Log("", TIME, dict.fromkeys(sensors, FORCE))], SCENE, [MOTION], sensors, ())
    inside = np.flatnonzero(blow.contact_force > 0.05 * blow.contact_force.max())[2:-2]
    inside = inside[np.diff(blow.time[inside], prepend=0.0) > 1e-9]
    slopes = {name: np.gradient(getattr(blow, name.replace("acceleration", "velocity"))[inside], blow.time[inside])
              for name in names}  # fmt: skip
    slopes["force"] = blow.contact_force[inside] + 0.03 * slopes["tool_acceleration"]
    for name, slope in slopes.items():
        sensed = model.sensed(struck, blow, name, blow.time)[0][inside]
        assert sensed == pytest.approx(slope, abs=0.02 * np.abs(slope).max())


@pytest.mark.filterwarnings("ignore:object.mass is .* but its guess")
def test_far_guess_or_other_clock_leads_to_the_same_fit():
    """With one number fixed the misfit is not smaller, nor the interval wider."""
    truth = ig.Scene(ig.Tool(0.16), ig.Object(0.31, 0.05), ig.Contact(7.45e9, 0.77), ig.SpringDamper(5.0))
    motion, sensor = ig.Trapezoid(0.0149, 50.0), ig.Sensor(bias="estimated")
    time = ig.simulate(truth, motion, 20.0).contacts[0].start + np.arange(-64, 296) / 51200
    trace = ig.simulate(truth, motion, time[-1], trace=True).trace
    force = np.interp(time, trace.time, trace.contact_force)
    noise = 8e-4 * force.max()
    force += np.random.default_rng(0).normal(0.0, noise, len(time))
    best = ig.identify({"time": time, "force": force}, truth, motion, sensor=sensor)
    start = replace(truth, object=replace(truth.object, mass=1.0), contact=ig.Contact(1e7, 0.5))
    fit = ig.identify({"time": time - 3.36, "force": force}, start, motion, sensor=sensor)
    assert [fit.noise["force"], np.std(fit.residuals[0]["force"])] == pytest.approx([noise, noise], rel=0.1)
    assert fit.estimate == pytest.approx(best.estimate, rel=1e-3)
    assert fit.estimate == pytest.approx(truths(truth), rel=0.03)
    for fixed in fit.estimate:
        free = [other for other in fit.estimate if other != fixed]
        nested = ig.identify({"time": time, "force": force}, fit.scene, motion, free, sensor)
        assert np.std(nested.residuals[0]["force"]) >= np.std(fit.residuals[0]["force"]) * (1.0 - 1e-5)
        for other, (low, high) in nested.interval.items():
            least, most = fit.interval[other]
            assert high / low <= (most / least) ** 1.05


TOUCH = ig.simulate(SCENE, MOTION, 0.4).contacts[0].start
BEFORE = int(np.sum(TIME < TOUCH))
ALARM = 1e-4  # probability of a false warning, see `misfits`
N = len(TIME)


def white():
    """Residuals of mean 0 and standard deviation 1 before the touch, mean square 1 after it."""
    rest = np.random.default_rng(2).normal(size=N)
    before, behind = rest[:BEFORE] - rest[:BEFORE].mean(), rest[BEFORE:]
    return np.concatenate([before / before.std(ddof=1), behind / np.sqrt(np.mean(behind**2))])


def ljung_box(rest):
    y = rest - rest.mean()
    return N * (N + 2) * sum((np.sum(y[k:] * y[:-k]) / np.sum(y * y)) ** 2 / (N - k) for k in range(1, 11))


def doubts(rest, *, values=None, known=False, bias=0.0, mass=0.0, first=0, name="force"):
    """Warnings of a fit with these residuals (noise 1 N), and `mass`, ln(mass / guess) with a deviation of 0.5."""
    number, *_ = numbers = free_coordinates(SCENE, ("object.mass",))
    model = SimpleNamespace(
        free=numbers, scene=SCENE, scene_at=lambda x: SCENE, residuals=lambda x: -rest[first:], motions=[MOTION],
        logs=[Log("log", TIME[first:], {name: (rest if values is None else values)[first:]})], noise={name: 1.0},
        slots={(0, name): slice(0, N - first)}, sensors={name: ig.Sensor(noise=1.0 if known else None, bias=bias)},
    )  # fmt: skip
    x = np.array([number.start(SCENE) + mass, 0.0])
    return " ".join(misfits(SimpleNamespace(model=model, x=x, deviations=np.array([0.5]))))


BEHIND = np.arange(N) >= BEFORE
HUM = np.sin(0.4 * np.arange(N)) * BEHIND
MEAN = norm.isf(ALARM / 2) / np.sqrt(BEFORE)
RATIO = f.isf(ALARM, N - BEFORE, BEFORE - 1)
LOUD = chi2.isf(ALARM, N) / np.sum(white() ** 2)
HUMS = brentq(lambda a: ljung_box(white() + a * HUM) - chi2.isf(ALARM, 10), 0.0, 3.0)
FAR = np.log(100.0) + 1.0
WARNINGS = {  # value at the border, warnings at a value, words
    "mean": (MEAN, lambda x: doubts(white() - x * ~BEHIND), "has a mean of -"),
    "ratio": (RATIO, lambda x: doubts(white() * np.where(BEHIND, x**0.5, 1.0)), f"{RATIO**0.5:.2g}"),
    "noise": (LOUD, lambda x: doubts(white() * x**0.5, known=True), f"{LOUD**0.5:.2g}"),
    "hum": (HUMS, lambda x: doubts(white() + x * HUM), "not white noise"),
    "far above": (FAR, lambda x: doubts(white(), mass=x), "object.mass is "),
    "far below": (FAR, lambda x: doubts(white(), mass=-x), "object.mass is "),
}  # fmt: skip


@pytest.mark.parametrize("name", WARNINGS)
def test_fit_is_doubted_just_beyond_a_border(name):
    """By the quantiles of normal, F and chi-squared distributions."""
    border, call, words = WARNINGS[name]
    assert call(0.999 * border) == ""
    assert words in call(1.001 * border)


def test_doubts_need_enough_samples_noise_and_a_known_bias():
    untared = white() + 9.0 * ~BEHIND
    assert "not tared" in doubts(untared, first=BEFORE - 8)
    others = {"first": BEFORE - 7}, {"bias": "estimated"}, {"name": "tool_velocity"}, {"name": "flange_velocity"}
    assert "not tared" not in " ".join(doubts(untared, **other) for other in others)
    assert "dead band" in doubts(white() * BEHIND)
    assert "dead band" not in doubts(put(white() * BEHIND, 3, 0.01))
    for flat in (2, 3):  # samples at the extreme
        there = np.s_[40 : 40 + flat]
        top, rest = put(NOISE, there, 9.0), put(white(), there, [-0.4, -0.5, -0.4][:flat])
        assert ("saturated" in doubts(rest, values=top)) == (flat == 3)


@pytest.mark.parametrize(("name", "most"), [("object.mass", 0.8), ("contact.restitution", 0.7)])
def test_wide_interval_and_correlation_are_said_at_a_border(name, most):
    """Twice the lower end, or 0.3 more for the restitution; a correlation of 0.95."""
    for high, correlation, count in ((most * 0.999, 0.99, 0), (most * 1.001, 0.949, 1), (most * 1.001, -0.951, 2)):
        ends, matrix = {name: (0.4, high), "tool.mass": (0.1, 0.11)}, np.array([[1.0, correlation], [correlation, 1.0]])
        said = [*_words(SCENE, ends, matrix)]
        assert len(said) == count
        assert not said or said[0].startswith(f"the log hardly determines {name}: it lies between 0.4 and {high:.3g}")
    assert f"a larger {name} with a larger tool.mass" in [*_words(SCENE, ends, np.abs(matrix))][1]
    (open_end,) = _words(SCENE, {"contact.restitution": (0.4, 1.0)}, np.eye(1))
    assert open_end.endswith("contact.restitution: any value above 0.4 fits equally well")


def test_misfit_is_a_warning_and_no_interval_is_claimed():
    good = log(truth := scene(1e5, 0.4, SPRING))
    hum = 3.0 * np.sin(2.0 * np.pi * 300.0 * good["time"])
    with pytest.warns(UserWarning, match="force.* not white") as said:
        fit = ig.identify(good | {"force": good["force"] + hum}, truth, MOTION, ("object.mass",))
    assert [(str(each.message), each.filename) for each in said] == [(text, __file__) for text in fit.warnings]
    assert "95 %" not in str(fit)
