"""Unusual logs that are accepted, files of recorders, and a log that begins too late."""

from dataclasses import replace

import numpy as np
import pytest
from quick_log import CLEAN, FLAT, FORCE, NOISE, SCENE, TIME, put
from recorder import MOTION

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
    with pytest.raises(ValueError, match=f"has 2 blows, at {TIME[9]:g}, .* the scene makes no more than 1"):
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
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_file_of_a_recorder_is_read_in_seconds_and_newtons(name, tmp_path):
    content = FILES[name]
    (tmp_path / "log.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    log = read(tmp_path / "log.csv", "")
    assert log.time == pytest.approx(STAMPS, rel=1e-8, abs=1e-15)
    assert log.columns["force"] == pytest.approx(PUSHES, rel=1e-8)
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
        assert (np.abs(model.predicted(np.array([mass, start]))[0]) == IMPOSSIBLE * np.ptp(FORCE)).all() == impossible
        assert model.simulations == (0 if impossible else 1)
