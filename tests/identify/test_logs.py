"""Unusual logs, files of recorders, and warnings; a log's clock, a far guess or a soft spring changes no fit."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from recorded_hits import CLEAN, FLAT, FORCE, MOTION, NOISE, SCENE, TIME, log, put, scene, truths

import impact_gym as ig
from impact_gym.identify.log import Log, check, read
from impact_gym.identify.model import IMPOSSIBLE, Model, free_coordinates


def test_coarse_or_gently_rounded_readings_are_not_saturated():
    coarse = np.round(CLEAN + 0.002 * CLEAN.max() * NOISE)  # N: several equal values at the top
    assert np.sum(coarse == coarse.max()) >= 3
    bottom = np.where(FLAT == 2.5, 2.0, FLAT)  # only 3 resolutions below its neighbours
    for force in (coarse, bottom):
        check(Log("blow", TIME[: len(force)], {"force": force}), SCENE, MOTION, {"force": ig.Sensor()})


def test_sample_above_six_standard_deviations_is_another_blow():
    noise = CLEAN.max() / 25.0

    def fit(height):
        log = {"time": TIME, "force": put(CLEAN, 9, height * noise)}  # before the touch
        ig.identify(log, SCENE, MOTION, ("contact.stiffness",), ig.Sensor(noise=noise))

    fit(5.5)
    with pytest.raises(ValueError, match=f"has 2 blows, at {TIME[9]:g}, .* the fit has no more than 1"):
        fit(6.5)


STAMPS, PUSHES = np.arange(20) / 51200, 12.0 * np.sin(np.arange(20))  # s, N


def table(head, separator=",", decimal=".", end="", of_time=1.0, of_force=1.0):
    values = zip(STAMPS / of_time, PUSHES / of_force, strict=True)
    lines = [f"{time:.9e}{separator}{force:.9e}{end}" for time, force in values]
    return head + "\n".join(lines).replace(".", decimal) + "\n"


FILES = {
    "units in brackets": table("time (s),force (N)\n"), "other cases": table("Time,Force\n"),
    "as a fraction": table("Zeit/ms,Force/kN\n", of_time=1e-3, of_force=1e3),
    "units behind": table("time_us;Fz\n", ";", ",", "", 1e-6),
    "decimal commas": table("t [s];Kraft [N]\n", ";", ","), "tabs": table("timestamp\tforce\n", "\t"),
    "blanks": table("  time (s)     force (N)\n", "    "), "blanks and commas": table("time force\n", "  ", ","),
    "trailing comma": table("time,force,\n", end=","), "in rows alone": table("time,force\n", end=","),
    "comments": "# one\n% two\n//three\n" + table("time,force\n# four\n") + "# five\n",
    "commented header": table("# time,force\n"), "no header": table(""), "no header, blanks": table("", " "),
    "preamble": table("Recorder 3.2\nRate,51200\nDate: 2024-01-01 12:00\n\ntime,force\n"),
    "second header line": table("Time,Force\n[ms],[mN]\n", ",", ".", "", 1e-3, 1e-3),
    "units as header": table("ms,N\n", of_time=1e-3), "extra columns": table("time,force,note,temp\n", end=",ok,21.5"),
    "quotes": '"time","force"\n"' + table("", '"#"', ",", '"').replace("\n", '\n"').replace("#", ",")[:-1],
    "topic": table("time,wrench.force.z\n"), "Excel on Windows": table("time,force\n").replace("\n", "\r\n"),
    "Latin-1": table("time (\u00b5s);force (N);St\u00f6\u00dfe\n", ";", of_time=1e-6, end=";1").encode("latin-1"),
    "byte order mark": table("time,force\n").encode("utf-8-sig"), "UTF-16": table("time,force\n").encode("utf-16"),
    "old Mac": table("time,force\n").replace("\n", "\r"),
    "accelerations": table("time,force,tool acc (mg),object acc in m/s^2\n", end=",1.5,2.5"),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_file_of_a_recorder_is_read_in_seconds_and_newtons(name, tmp_path):
    content = FILES[name]
    (tmp_path / "log.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    log = read(tmp_path / "log.csv", "")
    assert log.time == pytest.approx(STAMPS, rel=1e-8, abs=1e-15)
    assert log.columns["force"] == pytest.approx(PUSHES, rel=1e-8)
    more = [values[0] for key, values in log.columns.items() if key != "force"]
    assert more == pytest.approx([1.5e-3 * 9.80665, 2.5] * (name == "accelerations"))
    assert log.said.startswith("read 20 samples at 51.2 kHz from ")
    assert ("not used: 'note', 'temp'" in log.said) == (name == "extra columns")


def test_lost_samples_count_for_the_rate(tmp_path):
    lines = table("t [ms],object accel. (g)\n", of_time=1e-3, of_force=9.80665).splitlines()
    (tmp_path / "log.csv").write_text("\n".join(lines[:9] + lines[10:]))
    log = read(tmp_path / "log.csv", "")
    assert log.columns["object_acceleration"] == pytest.approx(np.delete(PUSHES, 8))  # m/s^2
    assert 1.0 / log.step == pytest.approx(51200.0)
    assert log.said.startswith("read 19 samples at 51.2 kHz")
    assert log.said.endswith("1 sample lost")
    rounded = np.round(np.arange(1000) / 51200, 6)  # to 1 us; the median step would give 50 kHz
    late = rounded + 0.7 * (np.arange(1000) % 7 == 3) / 51200
    for stamps in (rounded, late):
        assert 1.0 / Log("a", stamps, {}).step == pytest.approx(51200.0, rel=1e-4)


@pytest.mark.parametrize("friction", [None, 0.4])
def test_accelerations_of_a_log_are_the_slopes_of_the_velocities(friction):
    names = ("tool_acceleration", "object_acceleration")
    struck = replace(SCENE, object=replace(SCENE.object, friction=friction))
    blow = ig.simulate(struck, MOTION, 0.5, trace=True).trace
    log = Log("", TIME, dict.fromkeys(names, FORCE))
    model = Model([log], SCENE, [MOTION], dict.fromkeys(names, ig.Sensor()), ())
    inside = np.flatnonzero(blow.contact_force > 0.05 * blow.contact_force.max())[2:-2]
    inside = inside[np.diff(blow.time[inside], prepend=0.0) > 1e-9]
    for name in names:
        velocity = getattr(blow, name.replace("acceleration", "velocity"))
        slope = np.gradient(velocity[inside], blow.time[inside])
        sensed = model.sensed(struck, blow, name, blow.time)[0][inside]
        assert sensed == pytest.approx(slope, abs=0.02 * np.abs(slope).max())


def test_log_that_would_begin_after_the_blow_is_impossible_and_not_simulated():
    coordinates = free_coordinates(SCENE, ("object.mass",))
    log = read({"time": TIME, "force": FORCE}, "blow")
    model = Model([log], SCENE, [MOTION], {"force": ig.Sensor()}, coordinates)
    latest, mass = TIME[-1] - model.latest(SCENE, 0), coordinates[0].start(SCENE)
    for start, impossible in ((latest - 0.01, True), (latest + 0.01, False)):
        with patch.object(model, "trace", wraps=model.trace) as simulated:
            samples = model.predicted(np.array([mass, start]))[0]
        assert (np.abs(samples) == IMPOSSIBLE * np.ptp(FORCE)).all() == impossible
        assert simulated.call_count == (0 if impossible else 1)


def recorded(truth, motion, rate, before, samples, noise):
    """A log with `samples`, `before` of them before the touch; the noise is relative to the peak."""
    time = ig.simulate(truth, motion, 20.0).contacts[0].start + (np.arange(samples) - before) / rate
    trace = ig.simulate(truth, motion, time[-1], trace=True).trace
    force = np.interp(time, trace.time, trace.contact_force)
    deviation = noise * force.max()
    return {"time": time, "force": force + np.random.default_rng(0).normal(0.0, deviation, samples)}, deviation


def guessed(truth, stiffness, restitution, mass):
    return replace(truth, object=replace(truth.object, mass=mass), contact=ig.Contact(stiffness, restitution))


@pytest.mark.parametrize(("contact", "mass", "speed"), [
    (ig.Contact(7.45e9, 0.77), 0.31, 0.0149), (ig.Contact(2.5e9, 0.7), 0.6, 0.02),
])  # fmt: skip
@pytest.mark.parametrize("later", [0.0, -3.36, 1e3])
def test_clock_of_the_log_does_not_change_the_fit(contact, mass, speed, later):
    """With a clock that differed by seconds the search once ended at 'the object is a wall'."""
    truth = ig.Scene(ig.Tool(0.16), ig.Object(mass, 0.05), contact, ig.SpringDamper(5.0))
    motion = ig.Trapezoid(speed, 50.0)
    blow, noise = recorded(truth, motion, 51200, 64, 360, 8e-4)
    blow["time"] += later
    fit = ig.identify(blow, guessed(truth, 1e7, 0.5, 1.0), motion, sensor=ig.Sensor(bias="estimated"))
    assert fit.estimate == pytest.approx(truths(truth), rel=0.01)
    assert fit.noise["force"] == pytest.approx(noise, rel=0.1)
    assert np.std(fit.residuals[0]["force"]) == pytest.approx(noise, rel=0.1)
    assert fit.warnings == ()


@pytest.mark.parametrize(("truth", "motion", "rate", "samples"), [
    (ig.Scene(ig.Tool(1.4), ig.Object(1.37, 0.17), ig.Contact(3.1e7, 0.9)), ig.Trapezoid(0.6, 20.0), 9e4, 250),
    (ig.Scene(ig.Tool(0.1), ig.Object(0.35, 0.27), ig.Contact(1.17e5, 0.29), ig.SpringDamper(823.0, 1.12)),
     ig.Trapezoid(0.075, 2.9, ig.Brake()), 11500.0, 1280),
    (ig.Scene(ig.Tool(0.3), ig.Object(0.054, 0.02), ig.Contact(2.3e11, 0.84), ig.SpringDamper(0.18, 0.0)),
     ig.Trapezoid(0.02, 50.0), 3.4e5, 106),
], ids=["rigid", "spring that pushes after the blow", "nearly free tool"])  # fmt: skip
@pytest.mark.filterwarnings("ignore:object.mass is .* but its guess")
@pytest.mark.parametrize("guess", [(1e3, 0.99, 100.0), (1e10, 0.1, 0.05), (1e7, 0.5, 1e5)])
def test_far_guess_and_truth_lead_to_the_same_fit(truth, motion, rate, samples, guess):
    """The misfit is not larger, and no force is refused as one in kN."""
    blow, noise = recorded(truth, motion, rate, 40, samples, 0.002)
    fit, best = (ig.identify(blow, start, motion) for start in (guessed(truth, *guess), truth))
    assert fit.noise["force"] <= best.noise["force"] * (1.0 + 1e-3) <= 1.3 * noise
    assert fit.estimate == pytest.approx(best.estimate, rel=1e-3)
    assert fit.estimate == pytest.approx(truths(truth), rel=0.03)


@pytest.mark.parametrize(("tool", "contact", "spring", "speed", "rate", "noise"), [
    (0.79, ig.Contact(1.5e6, 0.23), ig.SpringDamper(135.0, 0.24), 0.45, 7e3, 0.015),
    (0.14, ig.Contact(1e7, 0.49), ig.SpringDamper(14.4, 0.25), 0.32, 4.5e4, 0.005),
])  # fmt: skip
def test_number_fixed_at_its_estimate_fits_no_better_and_widens_no_interval(tool, contact, spring, speed, rate, noise):
    """The object is nearly a wall, so its mass may be at its bound."""
    sensor, motion = ig.Sensor(bias="estimated"), ig.Trapezoid(speed, 20.0)
    truth = ig.Scene(ig.Tool(tool), ig.Object(350.0, 0.1), contact, spring)
    blow, _ = recorded(truth, motion, rate, 30, 300, noise)
    fit = ig.identify(blow, truth, motion, sensor=sensor)
    for fixed in fit.estimate:
        nested = ig.identify(blow, fit.scene, motion, [name for name in fit.estimate if name != fixed], sensor)
        assert np.std(nested.residuals[0]["force"]) >= np.std(fit.residuals[0]["force"]) * (1.0 - 1e-5)
        for name, (low, high) in nested.interval.items():
            least, most = fit.interval[name]
            assert high / low <= (most / least) ** 1.05


@pytest.mark.parametrize(("spoil", "words"), [
    (lambda time, force: force + 5.0, "not tared"),
    (lambda time, force: force + 100.0 * (time - time[0]), "drifts"),
    (lambda time, force: force + 3.0 * np.sin(2.0 * np.pi * 300.0 * time), "not white"),
    (lambda time, force: np.where(np.abs(force) < 0.1 * force.max(), 0.0, force), "a dead band"),
    (lambda time, force: force / 500.0, "object.mass is 0.000"),
    (lambda time, force: np.round(np.minimum(20.0 * force / force.max(), 16.0)), "longer than the fit"),
], ids=["untared", "drift", "hum", "dead band", "wrong unit", "saturated"])  # fmt: skip
def test_misfit_is_a_warning(spoil, words):
    good = log(truth := scene(1e5, 0.4))
    with pytest.warns(UserWarning, match="force|object.mass") as said:
        fit = ig.identify(good | {"force": spoil(good["time"], good["force"])}, truth, MOTION)
    assert [(str(each.message), each.filename) for each in said] == [(text, __file__) for text in fit.warnings]
    assert any(words in text for text in fit.warnings)
    assert "95 %" not in str(fit)


def test_tool_that_lags_on_a_soft_spring_is_fitted():
    truth = ig.Scene(ig.Tool(4.2), ig.Object(0.52, 0.285), ig.Contact(9e5, 0.5), ig.SpringDamper(30.0, 0.42))
    motion = ig.Trapezoid(1.55, 42.0)
    assert ig.simulate(truth, motion, 2.0).contacts[0].start > 2.0 * truth.object.distance / motion.speed
    blow, noise = recorded(truth, motion, 15000, 100, 400, 0.01)
    assert ig.identify(blow, truth, motion).noise["force"] == pytest.approx(noise, rel=0.1)
