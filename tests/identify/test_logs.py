"""Files of recorders, units and accelerations; a log's clock, a far guess or a soft spring changes no fit."""

from dataclasses import replace
from functools import lru_cache
from itertools import product

import numpy as np
import pytest
from recorded_hits import FORCE, MOTION, SCENE, TIME, truths
from refusal import refused

import impact_gym as ig
from impact_gym.csv_files import SCALES, Column, read_columns
from impact_gym.identify.log import Log, read
from impact_gym.identify.model import Model

STAMPS, PUSHES = np.arange(20) / 51200, 12.0 * np.sin(np.arange(20))  # s, N
INCH, FALL, POUND = 0.0254, 9.80665, 0.45359237  # m, m/s^2, kg, by definition
UNITS = {  # for each unit of the SI, the factors of other units to it
    "s": {"s sec secs second seconds S": 1.0, "ms msec msecs millisecond milliseconds": 1e-3, "min minutes": 60.0,
          "us \u00b5s \u03bcs usec microsecond microseconds": 1e-6, "ns nsec nanosecond nanoseconds": 1e-9},
    "N": {"N n newton newtons": 1.0, "mN mn": 1e-3, "kN kn": 1e3, "daN dan": 10.0, "kgf kp": FALL, "lbf": POUND * FALL},
    "m/s": {"m/s ms^-1 m*s^-1 m\u00b7s-1 ms\u207b\u00b9": 1.0, "mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1000.0 / 3600.0,
            "in/s": INCH, "ft/s": 12 * INCH},
    "m/s^2": {"m/s^2 m/s\u00b2 m/s2 m/s/s ms^-2 m.s-2 ms\u207b\u00b2": 1.0, "mm/s^2": 1e-3, "cm/s^2": 1e-2,
              "g gn g0": FALL, "mg": FALL / 1000.0},
}  # fmt: skip


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
    content, path = FILES[name], tmp_path / "log.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    log = read(path, "")
    assert log.time == pytest.approx(STAMPS, rel=1e-8, abs=1e-15)
    assert log.columns["force"] == pytest.approx(PUSHES, rel=1e-8)
    more = [values[0] for key, values in log.columns.items() if key != "force"]
    assert more == pytest.approx([1.5e-3 * FALL, 2.5] * (name == "accelerations"))
    assert log.said.startswith("read 20 samples at 51.2 kHz from ")
    assert ("not used: 'note', 'temp'" in log.said) == (name == "extra columns")
    for wrong in ("nan", '"nan"', "-inf"):  # no sample
        last = "\n".join(f"{k},{wrong if k == 9 else k}" for k in range(12))
        path.write_text("time (ms),force (N)\n" + last)
        refused(lambda: read(path, ""), "force[9] must be finite N")


def test_lost_samples_count_for_the_rate(tmp_path):
    lines = table("t [ms],object accel. (g)\n", of_time=1e-3, of_force=FALL).splitlines()
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


SLOW, PUSHED = ig.Trapezoid(0.0149, 50.0), ig.Trapezoid(0.075, 2.9, ig.Brake())
HITS = {  # tool, object (kg), gap (m), stiffness, restitution, coupling, motion, rate (Hz), samples, before, noise
    "slow": (0.16, 0.31, 0.05, 7.45e9, 0.77, (5.0,), SLOW, 51200, 360, 64, 8e-4),
    "softer": (0.16, 0.6, 0.05, 2.5e9, 0.7, (5.0,), ig.Trapezoid(0.02, 50.0), 51200, 360, 64, 8e-4),
    "rigid": (1.4, 1.37, 0.17, 3.1e7, 0.9, None, ig.Trapezoid(0.6, 20.0), 9e4, 250, 40, 2e-3),
    "spring pushes later": (0.1, 0.35, 0.27, 1.17e5, 0.29, (823.0, 1.12), PUSHED, 11500.0, 1280, 40, 2e-3),
    "nearly free": (0.3, 0.054, 0.02, 2.3e11, 0.84, (0.18, 0.0), ig.Trapezoid(0.02, 50.0), 3.4e5, 106, 40, 2e-3),
    "tool lags": (4.2, 0.52, 0.285, 9e5, 0.5, (30.0, 0.42), ig.Trapezoid(1.55, 42.0), 15000, 400, 100, 2e-3),
    "wall": (0.79, 350.0, 0.1, 1.5e6, 0.23, (135.0, 0.24), ig.Trapezoid(0.45, 20.0), 7e3, 300, 30, 0.015),
    "light wall": (0.14, 350.0, 0.1, 1e7, 0.49, (14.4, 0.25), ig.Trapezoid(0.32, 20.0), 4.5e4, 300, 30, 0.005),
}  # fmt: skip
BIASED = ig.Sensor(bias="estimated")


@lru_cache
def recorded(name):
    """Scene, motion and log of a hit, by our own solver; deviation of the noise; the fit with the truth as guess."""
    m_t, m_p, gap, k_c, e, spring, motion, rate, samples, before, noise = HITS[name]
    coupling = ig.SpringDamper(*spring) if spring else ig.Rigid()
    truth = ig.Scene(ig.Tool(m_t), ig.Object(m_p, gap), ig.Contact(k_c, e), coupling)
    time = ig.simulate(truth, motion, 20.0).contacts[0].start + (np.arange(samples) - before) / rate
    trace = ig.simulate(truth, motion, time[-1], trace=True).trace
    force = np.interp(time, trace.time, trace.contact_force)
    deviation = noise * force.max()
    log = {"time": time, "force": force + np.random.default_rng(0).normal(0.0, deviation, samples)}
    return truth, motion, log, deviation, ig.identify(log, truth, motion, sensor=BIASED)


GUESSES = (1e7, 0.5, 1.0), (1e3, 0.99, 100.0), (1e10, 0.1, 0.05), (1e7, 0.5, 1e5)  # stiffness, restitution, mass
QUICK = {("slow", 0, -3.36), ("softer", 0, 1e3), ("rigid", 1, 0.0), ("spring pushes later", 2, 0.0),
         ("nearly free", 1, 0.0), ("tool lags", 0, 0.0)}  # fmt: skip
ALL = sorted(QUICK | set(product([name for name in HITS if "wall" not in name], range(4), (0.0,))))


@pytest.mark.parametrize(("name", "guess", "later"), [
    pytest.param(*row, marks=() if row in QUICK else pytest.mark.slow) for row in ALL
])  # fmt: skip
@pytest.mark.filterwarnings("ignore:object.mass is .* but its guess")
def test_far_guess_or_other_clock_leads_to_the_same_fit(name, guess, later):
    """The misfit is not larger, and no force is refused as one in kN."""
    truth, motion, log, noise, best = recorded(name)
    *contact, mass = GUESSES[guess]
    start = replace(truth, object=replace(truth.object, mass=mass), contact=ig.Contact(*contact))
    fit = ig.identify(log | {"time": log["time"] + later}, start, motion, sensor=BIASED)
    assert fit.noise["force"] <= best.noise["force"] * (1.0 + 1e-3)
    assert [fit.noise["force"], np.std(fit.residuals[0]["force"])] == pytest.approx([noise, noise], rel=0.1)
    assert fit.estimate == pytest.approx(best.estimate, rel=1e-3)
    assert fit.estimate == pytest.approx(truths(truth), rel=0.03)
    assert not [each for each in fit.warnings if not each.startswith("object.mass is")]


@pytest.mark.parametrize(
    "name", ["slow", *(pytest.param(f"{kind}wall", marks=pytest.mark.slow) for kind in ("", "light "))]
)
def test_fixing_an_estimate_neither_helps_nor_widens(name):
    """At a wall the object's mass may be at its bound."""
    _, motion, log, _, fit = recorded(name)
    for fixed in fit.estimate:
        nested = ig.identify(log, fit.scene, motion, [other for other in fit.estimate if other != fixed], BIASED)
        assert np.std(nested.residuals[0]["force"]) >= np.std(fit.residuals[0]["force"]) * (1.0 - 1e-5)
        for other, (low, high) in nested.interval.items():
            least, most = fit.interval[other]
            assert high / low <= (most / least) ** 1.05
