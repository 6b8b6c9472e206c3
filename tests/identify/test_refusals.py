"""Logs and arguments that cannot be right: one line says what, where, and what is allowed; and what is no such case."""

from dataclasses import replace

import numpy as np
import pytest
from recorder import MOTION, SCENE_FILE, scene, write_log

import impact_gym as ig
from impact_gym.identify.__main__ import main
from impact_gym.identify.coordinates import free_coordinates
from impact_gym.identify.log import Log, check, read
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
TWO_COLUMNS = GOOD | {"object_velocity": VELOCITY / 100.0}
SEVEN = ("contact.stiffness", "contact.restitution", "object.mass", "object.distance", "tool.mass",
         "coupling.stiffness", "coupling.damping_ratio")  # fmt: skip
LINES = "\n".join(f"{k / 1000},{'x' if k == 9 else k}" for k in range(20))
FLAT = np.array([5.0, 4.0, 2.5, *[0.5] * 8, 2.5, 4.0, 5.0, 4.5, 4.0])  # beside the bottom 4 resolutions away


def put(values, place, value):
    values = values.copy()
    values[place] = value
    return values


def fit(log=GOOD, scene=SCENE, motion=MOTION, free=("contact.stiffness",), **sensor):
    return lambda folder: ig.identify(log, scene, motion, free, **sensor)


def file(text):
    """A call with a log's file."""
    return lambda folder: ((folder / "log.csv").write_text(text), fit(folder / "log.csv")(folder))


def columns(**changed):
    return fit(GOOD | changed)


def command(old="", new="", *options):
    """A call of the command with a changed scene's file."""

    def call(folder):
        (folder / "my.toml").write_text(SCENE_FILE.replace(old, new))
        write_log(folder / "log.csv", GOOD)
        main([str(folder / "log.csv"), "--scene", str(folder / "my.toml"), *options])

    return call


VALUES = [
    (fit(CUT), "time must have no gaps", "0.0055 s", "samples 49 and 50"),
    (columns(time=put(TIME, 30, TIME[20])), "time must increase", "sample 30 is at 0.308 s after 0.31025 s"),
    (columns(time=1e3 * TIME), "time", "at most 0.05 s", "got 0.25 s", "is it in ms"),
    (columns(force=1e6 * FORCE / FORCE.max()), "force", "below 100000 N, got 1e+06 N", "is it in mN?"),
    (columns(object_velocity=VELOCITY), "object_velocity", "below 10 m/s, got 50 m/s", "is it in mm/s?"),
    (columns(force=np.minimum(FORCE, 0.6 * FORCE.max())), "force is saturated: it stays at", "N from"),
    (columns(force=-np.minimum(FORCE, 0.6 * FORCE.max())), "force is saturated: it stays at -", "N from"),
    (fit({"time": TIME[: len(FLAT)], "force": FLAT}), "force is saturated: it stays at 0.5 N"),
    (columns(force=FORCE / 1e3), "force", "an impulse of about", "N s, as tool", "is it in kN?"),
    (fit(GOOD | {"force": FORCE / 1e3}, replace(SCENE, object=ig.Object(0.25, 0.01))), "0.0333 N s", "have at 0.4 m/s"),
    (columns(force=-FORCE), "force must be above 0 N", "N: has it the other sign?"),
    (columns(tool_velocity=0.0 * FORCE), "tool_velocity must not be 0 m/s in all 161 samples"),
    (columns(force=NOISE), "has no blow", "force"),
    (fit(TWICE), "has 2 blows, at ", " s, ", "cut it to one"),
    (columns(time=put(TIME, 7, np.nan)), "time[7] must be finite s, got nan"),
    (columns(force=put(FORCE, 7, np.nan)), "force[7] must be finite N, got nan"),
    (columns(Force=FORCE), "unknown column 'Force'"),
    (columns(force=FORCE[:-1]), "columns of one length"),
    (columns(time=TIME[:5], force=FORCE[:5]), "8 samples at least"),
    (fit({"force": FORCE}), "log must have a column time"),
    (fit([GOOD, {"force": FORCE}]), "log 2 must have a column time"),
    (fit({"time": TIME}), "at least one of force"),
    (file(""), "log.csv is empty"),
    (file("time,force\n0,1\n0.1\n"), "log.csv, line 3 must have 2 values"),
    (file("time,force,force\n"), "log.csv must name no column twice"),
    (file("time,force\n" + LINES), "log.csv, line 11: force must be a number, got 'x'"),
    (file("time,force\n0,1\n\n0.5,\n"), "log.csv, line 4: force must be a number, got ''"),
    (file('time,"x\ny"\n0,a\n'), "log.csv, line 3: x y must be a number, got 'a'"),
    (lambda folder: fit(folder / "log.csv")(folder), "log.csv is not read as CSV"),
    (fit(free=("contact.stifness",)), "no number 'contact.stifness'; did you mean 'contact.stiffness'"),
    (fit(free=("robot.mass",)), "no number 'robot.mass'"),
    (fit(free=()), "free must name at least one number"),
    (fit(free=("object.mass", "object.mass")), "free", "none twice"),
    (fit(free={"object.mass": (2.0, 1.0)}), "range of object.mass must rise", "2.0 to 1.0"),
    (fit(free={"object.mass": (0.0, 1.0)}), "range of object.mass must be finite and above 0", "got 0.0"),
    (fit(GOOD, scene(coupling=ig.Rigid()), free=("contact.stiffness", "tool.mass")), "does not depend on tool.mass"),
    (fit(GOOD, scene(coupling=ig.SpringDamper(150.0, 0.0)), free=SEVEN), "coupling.damping_ratio is 0 in the scene"),
    (fit({name: values[30:62:4] for name, values in GOOD.items()}, free=SEVEN), "more samples than unknowns",
     "got 8 unknowns with starts and biases, but 8 samples"),
    (fit(motion=[MOTION, MOTION]), "motion", "one for each of 1 logs, got 2"),
    (fit(sensor=ig.Sensor(rate=2000.0)), "Sensor.rate of force is 2000 Hz"),
    (fit(sensor={"tool_velocity": ig.Sensor()}), "no log has a column 'tool_velocity'"),
    (fit(TWO_COLUMNS, sensor=ig.Sensor()), "sensor must say which column it is of, {'force': Sensor"),
    (fit(TWO_COLUMNS, sensor={"object_velocity": ig.Sensor(cell=ig.LoadCell(0.02, 5000.0))}),
     "sensor: object_velocity has a load cell, which a force alone may have"),
    *[(lambda _, name=name: ig.Sensor(**{name: 0.0}), f"Sensor.{name} must be finite and above 0")
      for name in ("rate", "low_pass", "noise")],
    (lambda _: ig.LoadCell(0.0, 1.0), "LoadCell.mass must be finite", "kg"),
    (lambda _: ig.LoadCell(1.0, np.inf), "LoadCell.frequency must be finite", "Hz"),
    (lambda _: ig.LoadCell(1.0, 1.0, 1.0), "LoadCell.damping_ratio must be finite", "at most 0.99"),
    (lambda _: ig.hold_out([GOOD], SCENE, MOTION), "hold-out needs 2 logs or more", "got 1"),
    (lambda _: ig.hold_out([GOOD] * 4, SCENE, [MOTION] * 3), "motion", "one for each of 4 logs, got 3"),
    (lambda _: ig.hold_out(GOOD, SCENE, MOTION), "hold-out needs 2 logs or more", "got 1"),
    (lambda _: ig.hold_out([GOOD, TWO_COLUMNS], SCENE, MOTION), "log 2 has force, object_velocity, but"),
    (lambda _: ig.hold_out([{"time": TIME, "tool_velocity": VELOCITY}] * 2, SCENE, MOTION), "got tool_velocity"),
    (command("[motion]", "[moved]"), "must have a table [motion]"),
    (command("speed = 1.0", "speeed = 1.0"), "motion has no field 'speeed'"),
    (command("speed = 1.0", "speed = [1.0, 0.5]"), "motion.speed", "m/s, or one for each of 1 logs, got [1.0, 0.5]"),
    (command("speed = 1.0", 'speed = ["x"]'), "motion.speed[0] must be a number in m/s, got 'x'"),
    (command("distance = 0.2505", "distance = [0.2, 0.3]"), "environment.scenario.distance must be a number"),
    (command("stiffness = 150.0", "stiffness = [100.0, 200.0]"), "environment.coupling.stiffness must be a number"),
    (command("rate = 4000.0", "rate = 400.0"), "Sensor.rate of force is 400 Hz"),
    (command("title =", "title"), "my.toml is not read as TOML"),
    (command("", "", "--free", "contact.stiffness_exponent"), "contact.stiffness_exponent has no place in a set-up"),
    (command("", "", "--hold-out"), "hold-out needs 2 logs or more", "got 1"),
]  # fmt: skip
TYPES = [
    (fit(7), "log must be a mapping of columns or the path", "got 7"),
    (columns(force=FORCE + 0j), "force must be a sequence of numbers in N", "complex128"),
    (columns(force=FORCE[:, None]), "force must be a sequence of numbers in N", "(161, 1)"),
    (columns(force=["x"] * len(TIME)), "force[0] must be a number in N, got 'x'"),
    (fit(free="object.mass"), "free", "got the text 'object.mass'"),
    (fit(free={"object.mass": 1.0}), "object.mass must be a pair", "got 1.0"),
    (fit(scene=None), "scene must be a Scene", "got None"),
    (fit(motion=1.0), "motion must be a Trapezoid", "got 1.0"),
    (lambda _: ig.hold_out([GOOD] * 2, SCENE, [MOTION, 1.0]), "motion must be a Trapezoid", "got 1.0"),
    (fit(sensor=5), "sensor must be a Sensor", "got 5"),
    (lambda _: ig.Sensor(bias="guess"), "Sensor.bias must be a number", "'guess'"),
    (lambda _: ig.Sensor(cell=5), "Sensor.cell must be a LoadCell or None, got 5"),
]


@pytest.mark.parametrize(
    ("error", "call", "words"),
    [((ValueError, SystemExit), call, words) for call, *words in VALUES]
    + [(TypeError, call, words) for call, *words in TYPES],
    ids=[words[0] for _, *words in VALUES + TYPES],
)
def test_refusal_names_the_field_the_value_and_the_unit_in_one_line(error, call, words, tmp_path):
    with pytest.raises(error) as refusal:
        call(tmp_path)
    says = str(refusal.value)
    assert [word for word in words if word not in says] == []
    assert "\n" not in says
    assert isinstance(refusal.value, ValueError) or says.startswith("impact-gym identify: ")


def test_coarse_or_gently_rounded_sensor_is_not_taken_for_a_saturated_one():
    coarse = np.round(CLEAN + 0.002 * CLEAN.max() * NOISE)  # N: several equal values at the top
    assert np.sum(coarse == coarse.max()) >= 3
    bottom = np.where(FLAT == 2.5, 2.0, FLAT)  # beside it 3 resolutions away, no more
    for force in (coarse, bottom):
        check(Log("blow", TIME[: len(force)], {"force": force}), SCENE, MOTION, {"force": ig.Sensor()})


def test_sample_is_taken_for_another_blow_from_six_standard_deviations():
    noise = CLEAN.max() / 25.0
    near, far = (
        fit(GOOD | {"force": put(CLEAN, 9, height * noise)}, sensor=ig.Sensor(noise=noise))  # before the touch
        for height in (5.5, 6.5)
    )
    near(None)
    with pytest.raises(ValueError, match=f"has 2 blows, at {TIME[9]:g}, .* the scene makes no more than 1"):
        far(None)


def test_file_with_the_byte_order_mark_of_excel_is_read(tmp_path):
    for encoding in ("utf-8", "utf-8-sig"):
        lines = "\r\n".join(["time,force", *(f"{time},{force}" for time, force in zip(TIME, FORCE, strict=True))])
        (tmp_path / "log.csv").write_text(lines, encoding)
        assert np.array_equal(read(tmp_path / "log.csv", "").columns["force"], FORCE)


def test_start_so_early_that_the_log_ends_when_the_blow_is_over_is_impossible_and_not_simulated():
    coordinates = free_coordinates(SCENE, ("object.mass",))
    model = Model.of([read(GOOD, "blow")], SCENE, [MOTION], {"force": ig.Sensor()}, coordinates)
    latest, mass = TIME[-1] - model.latest(SCENE, 0), coordinates[0].start(SCENE)
    for start, impossible in ((latest - 0.01, True), (latest + 0.01, False)):
        assert (np.abs(model.predicted(np.array([mass, start]))[0]) == IMPOSSIBLE * np.ptp(FORCE)).all() == impossible
        assert model.simulations == (0 if impossible else 1)
