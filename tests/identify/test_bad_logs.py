"""Logs and arguments that cannot be right: one line says what, where, and what is allowed."""

from dataclasses import replace

import numpy as np
import pytest
from blows import MOTION, scene

import impact_gym as ig
from impact_gym.identify.coordinates import free_coordinates
from impact_gym.identify.log import Log, _refuse_clipped, _refuse_other_force, read
from impact_gym.identify.model import IMPOSSIBLE, Model

SCENE = scene(1e4, 0.5)
TIME = np.arange(0.303, 0.343, 1 / 4000)  # s
BLOW = ig.simulate(scene(1e5, 0.5), MOTION, 0.5, trace=True).trace
CLEAN = np.interp(TIME, BLOW.time, BLOW.contact_force)  # N
NOISE = np.random.default_rng(0).normal(size=len(TIME))
FORCE = CLEAN + 0.02 * CLEAN.max() * NOISE
GOOD = {"time": TIME, "force": FORCE}
VELOCITY = 50.0 * FORCE / FORCE.max()
CUT = {name: np.delete(values, slice(50, 71)) for name, values in GOOD.items()}
TWICE = {"time": TIME[0] + np.arange(2 * len(TIME)) / 4000.0, "force": np.tile(FORCE, 2)}


def put(values, place, value):
    values = values.copy()
    values[place] = value
    return values


def identify_refused(match, log, scene=SCENE, error=ValueError, motion=MOTION, **arguments):
    with pytest.raises(error, match=match) as refusal:
        ig.identify(log, scene, motion, **arguments)
    assert "\n" not in str(refusal.value)


BAD_LOGS = {
    "gap": (CUT, r"time must have no gaps, but 0\.0055 s lie between samples 49 and 50"),
    "time stands still": (
        {"time": put(TIME, 30, TIME[20])},
        r"time must increase, but sample 30 is at 0\.308 s after 0\.31025 s",
    ),
    "milliseconds": ({"time": 1e3 * TIME}, "at most 0.05 s between samples, got 0.25 s: is it in ms"),
    "millinewtons": ({"force": 1e6 * FORCE / FORCE.max()}, r"below 100000 N, got .* N: is it in mN\?"),
    "millimetres": ({"object_velocity": VELOCITY}, r"below 10 m/s, got 50 m/s: is it in mm/s\?"),
    "saturated": ({"force": np.minimum(FORCE, 0.6 * FORCE.max())}, "force is saturated: it stays at"),
    "saturated below": ({"force": -np.minimum(FORCE, 0.6 * FORCE.max())}, "force is saturated: it stays at"),
    "kilonewtons": ({"force": FORCE / 1e3}, r"impulse of about .* N s, as .* got .* N s: is it in kN\?"),
    "other sign": ({"force": -FORCE}, r"force must be above 0 N .* N: has it the other sign\?"),
    "complex": ({"force": FORCE + 0j}, r"force must be a sequence of numbers in N, got .*complex128 "),
    "two-dimensional": ({"force": FORCE[:, None]}, r"force must be a sequence of numbers in N, got .*\(161, 1\)"),
    "dead sensor": ({"tool_velocity": 0.0 * FORCE}, "tool_velocity must not be 0 m/s in all 161 samples: leave it out"),
    "no blow": ({"force": NOISE}, "has no blow: nothing in force stands out"),
    "two blows": (TWICE, "has 2 blows, at .* cut it to one"),
    "time is nan": ({"time": put(TIME, 7, np.nan)}, r"time\[7\] must be finite s, got nan"),
    "force is nan": ({"force": put(FORCE, 7, np.nan)}, r"force\[7\] must be finite N, got nan"),
    "text": ({"force": ["x"] * len(TIME)}, r"force\[0\] must be a number in N, got 'x'"),
    "unknown column": ({"Force": FORCE}, "unknown column 'Force'"),
    "other length": ({"force": FORCE[:-1]}, "columns of one length"),
    "few samples": ({"time": TIME[:5], "force": FORCE[:5]}, "8 samples at least"),
}  # fmt: skip


@pytest.mark.parametrize(("changed", "match"), BAD_LOGS.values(), ids=BAD_LOGS)
def test_identify_refuses_a_bad_log(changed, match):
    identify_refused(match, GOOD | changed, free=("contact.stiffness",))


def test_identify_takes_no_coarse_sensor_for_a_saturated_one():
    coarse = np.round(CLEAN + 0.002 * CLEAN.max() * NOISE)  # N: several equal values at the top
    assert np.sum(coarse == coarse.max()) >= 3
    ig.identify(GOOD | {"force": coarse}, SCENE, MOTION, free=("contact.stiffness",))


def test_identify_takes_a_sample_for_another_blow_from_six_standard_deviations():
    noise = CLEAN.max() / 25.0
    for height in (5.5, 6.5):
        arguments = {"free": ("contact.stiffness",), "sensor": ig.Sensor(noise=noise)}
        recorded = GOOD | {"force": put(CLEAN, 9, height * noise)}  # before the touch
        if height < 6.0:
            ig.identify(recorded, SCENE, MOTION, **arguments)
        else:
            identify_refused(f"has 2 blows, at {TIME[9]:g}, .* the scene makes no more than 1", recorded, **arguments)


def test_identify_refuses_what_is_no_log():
    identify_refused("^log must have a column time", {"force": FORCE})
    identify_refused("^log 2 must have a column time", [GOOD, {"force": FORCE}])
    identify_refused("at least one of force", {"time": TIME})
    identify_refused("mapping of columns or the path", 7, error=TypeError)


@pytest.mark.parametrize(("text", "match"), [
    ("", "is empty"),
    ("time,force\n0,1\n0.1\n", "line 3 must have 2 values"),
    ("time,force,force\n", "no column twice"),
    ("time,force\n" + "\n".join(f"{k / 1000},{'x' if k == 9 else k}" for k in range(20)), "line 11: .* must be .*'x'"),
    (None, "is not read as CSV"),
])  # fmt: skip
def test_identify_refuses_a_file_that_is_no_log(tmp_path, text, match):
    if text is not None:
        (tmp_path / "log.csv").write_text(text)
    identify_refused(match, tmp_path / "log.csv")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_identify_reads_a_file_with_the_byte_order_mark_of_excel_and_shows_the_line_of_a_blank_cell(encoding, tmp_path):
    good = "\r\n".join(["time,force", *(f"{time},{force}" for time, force in zip(TIME, FORCE, strict=True))])
    (tmp_path / "log.csv").write_text(good, encoding)
    assert np.array_equal(read(tmp_path / "log.csv", "").columns["force"], FORCE)
    (tmp_path / "log.csv").write_text(f"{good}\r\n\r\n0.5,\r\n", encoding)
    identify_refused(rf"log.csv, line {len(TIME) + 3}: force must be a number, got ''", tmp_path / "log.csv")


@pytest.mark.parametrize(("free", "match"), [
    (("contact.stifness",), "no number 'contact.stifness'; did you mean 'contact.stiffness'"),
    (("robot.mass",), "no number 'robot.mass'"),
    ((), "at least one number"),
    (("object.mass", "object.mass"), "none twice"),
    ("object.mass", "got the text 'object.mass'"),
    ({"object.mass": (2.0, 1.0)}, "range of object.mass must rise"),
    ({"object.mass": (0.0, 1.0)}, "range of object.mass must be finite and above 0"),
    ({"object.mass": 1.0}, "must be a pair"),
])  # fmt: skip
def test_identify_refuses_free_numbers(free, match):
    identify_refused(match, GOOD, free=free)


def test_identify_refuses_numbers_that_the_log_or_the_scene_says_nothing_of():
    rigid, undamped = (scene(1e4, 0.5, coupling=coupling) for coupling in (ig.Rigid(), ig.SpringDamper(150.0, 0.0)))
    identify_refused(r"log does not depend on tool\.mass", GOOD, rigid, free=("contact.stiffness", "tool.mass"))
    identify_refused(r"coupling\.damping_ratio is 0 in the scene", GOOD, undamped, free=("coupling.damping_ratio",))


def test_identify_refuses_as_many_unknowns_as_samples():
    eight = {name: values[30:62:4] for name, values in GOOD.items()}
    numbers = ("contact.stiffness", "contact.restitution", "object.mass", "object.distance", "tool.mass")
    match = "more samples than unknowns, got 8 unknowns with starts and biases, but 8 samples"
    identify_refused(match, eight, free=(*numbers, "coupling.stiffness", "coupling.damping_ratio"))


def test_identify_refuses_arguments_of_other_kinds():
    identify_refused("scene must be a Scene", GOOD, None, error=TypeError)
    identify_refused("motion must be a Trapezoid", GOOD, motion=1.0, error=TypeError)
    identify_refused("one for each of 1 logs, got 2", GOOD, motion=[MOTION, MOTION])


def test_identify_refuses_sensors():
    identify_refused("Sensor.rate of force is 2000 Hz", GOOD, sensor=ig.Sensor(rate=2000.0))
    identify_refused("no log has a column 'tool_velocity'", GOOD, sensor={"tool_velocity": ig.Sensor()})
    two = GOOD | {"object_velocity": VELOCITY / 100.0}
    identify_refused(r"sensor must say which column it is of, \{'force': Sensor", two, sensor=ig.Sensor())
    for field in ("rate", "low_pass", "noise"):
        with pytest.raises(ValueError, match=f"Sensor.{field} must be finite and above 0"):
            ig.Sensor(**{field: 0.0})
    with pytest.raises(ValueError, match=r"Sensor\.bias must be a number"):
        ig.Sensor(bias="guess")
    held = {"object_velocity": ig.Sensor(cell=ig.LoadCell(0.02, 5000.0))}
    identify_refused("sensor: object_velocity has a load cell, which a force alone may have", two, sensor=held)
    for numbers, name in (((0.0, 1.0), "mass"), ((1.0, np.inf), "frequency"), ((1.0, 1.0, 1.0), "damping_ratio")):
        with pytest.raises(ValueError, match=rf"LoadCell\.{name} must be finite"):
            ig.LoadCell(*numbers)
    with pytest.raises(TypeError, match=r"Sensor\.cell must be a LoadCell or None, got 5"):
        ig.Sensor(cell=5)


def test_impulse_that_is_usual_is_that_of_tool_and_object_at_the_speed_of_the_approach():
    near, weak = replace(SCENE, object=ig.Object(0.25, 0.01)), Log("blow", TIME, {"force": FORCE / 1e3})
    with pytest.raises(ValueError, match=r"an impulse of about 0\.0333 N s, .* have at 0\.4 m/s"):  # 0.4 / (8 + 4)
        _refuse_other_force(weak, near, MOTION, ig.Sensor())


def test_flat_bottom_within_the_resolution_is_not_saturation():
    values = np.array([5.0, 4.0, 2.0, *[0.5] * 8, 2.0, 4.0, 5.0, 4.5, 4.0])  # next to it 3 resolutions away, no more
    _refuse_clipped(Log("blow", TIME[: len(values)], {"force": values}), "force")
    values[2] = values[11] = 2.5
    with pytest.raises(ValueError, match=r"force is saturated: it stays at 0\.5 N"):
        _refuse_clipped(Log("blow", TIME[: len(values)], {"force": values}), "force")


def test_start_so_early_that_the_log_ends_when_the_blow_is_over_is_impossible():
    coordinates = free_coordinates(SCENE, ("object.mass",))
    model = Model.of([read(GOOD, "blow")], SCENE, [MOTION], {"force": ig.Sensor()}, coordinates)
    latest = model.latest(SCENE, 0)  # s, of the motion
    x = np.zeros(model.size)
    x[0] = coordinates[0].start(SCENE)
    for start, impossible in ((TIME[-1] - latest - 0.01, True), (TIME[-1] - latest + 0.01, False)):
        x[1] = start
        assert (np.abs(model.predicted(x)[0]) == IMPOSSIBLE * np.ptp(FORCE)).all() == impossible
