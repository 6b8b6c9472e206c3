"""Logs and arguments that cannot be right: one line says what, where, and what is allowed."""

import numpy as np
import pytest
from blows import MOTION, log, scene

import impact_gym as ig

SCENE = scene(1e4, 0.8, 1.0)


@pytest.fixture(scope="module")
def good():
    return log(scene(1e5, 0.5))


def changed(recorded, **columns):
    return {name: values.copy() for name, values in recorded.items()} | columns


def without(recorded, first, last):
    return {name: np.delete(values, slice(first, last)) for name, values in recorded.items()}


def put(values, place, value):
    values = values.copy()
    values[place] = value
    return values


def refused(match, recorded, **arguments):
    with pytest.raises(ValueError, match=match) as caught:
        ig.identify(recorded, SCENE, MOTION, **arguments)
    assert "\n" not in str(caught.value)


def test_gaps_in_time(good):
    refused(r"time must have no gaps, but 0\.0055 s lie between samples 49 and 50", without(good, 50, 71))


def test_time_that_does_not_increase(good):
    refused("time must increase, but sample 30 is at", changed(good, time=put(good["time"], 30, good["time"][29])))


def test_time_in_milliseconds(good):
    refused("at most 0.05 s between samples, got 0.25 s: is it in ms", changed(good, time=good["time"] * 1e3))


def test_time_off_the_sensors_rate(good):
    refused("Sensor.rate of force is 2000 Hz", good, sensor=ig.Sensor(rate=2000.0))


def test_a_force_of_a_million_newtons_gets_a_question(good):
    refused(r"below 100000 N, got .* N: is it in mN\?", changed(good, force=1e6 * good["force"] / good["force"].max()))


def test_a_velocity_in_millimetres_per_second_gets_a_question():
    recorded = log(scene(1e5, 0.5), columns=("object_velocity",))
    refused(
        r"below 10 m/s, got .*: is it in mm/s\?", changed(recorded, object_velocity=1e3 * recorded["object_velocity"])
    )


@pytest.mark.parametrize("side", [1, -1])
def test_saturation(good, side):
    top = 0.6 * good["force"].max()
    clipped = np.minimum(good["force"], top) if side > 0 else -np.minimum(good["force"], top)
    refused("force is saturated: it stays at", changed(good, force=clipped))


def test_a_coarse_but_unclipped_sensor_is_not_taken_for_a_saturated_one():
    recorded = log(scene(1e5, 0.5), noise=0.002)
    coarse = np.round(recorded["force"])  # N: several equal values at the top
    assert np.sum(coarse == coarse.max()) >= 3
    ig.identify(changed(recorded, force=coarse), SCENE, MOTION)


def test_no_blow(good):
    noise = np.random.default_rng(0).normal(size=len(good["time"]))
    refused("has no blow: nothing in force stands out", changed(good, force=noise))


def test_two_blows(good):
    length = len(good["time"])
    time = good["time"][0] + np.arange(2 * length) / 4000.0
    refused("has 2 blows, at .* cut it to one", {"time": time, "force": np.tile(good["force"], 2)})


def test_a_free_number_that_the_log_does_not_depend_on():
    rigid = scene(1e4, 0.5, coupling=ig.Rigid())
    with pytest.raises(ValueError, match=r"log does not depend on tool\.mass"):
        ig.identify(log(rigid), rigid, MOTION, free=("contact.stiffness", "tool.mass"))


@pytest.mark.parametrize(
    ("free", "match"),
    [
        (("contact.stifness",), "no number 'contact.stifness'; did you mean 'contact.stiffness'"),
        (("robot.mass",), "no number 'robot.mass'"),
        ((), "at least one number"),
        (("object.mass", "object.mass"), "none twice"),
        ("object.mass", "got the text 'object.mass'"),
        ({"object.mass": (2.0, 1.0)}, "range of object.mass must rise"),
        ({"object.mass": (0.0, 1.0)}, "range of object.mass must be finite and above 0"),
        ({"object.mass": 1.0}, "must be a pair"),
    ],
)
def test_free_numbers_that_are_none(good, free, match):
    refused(match, good, free=free)


@pytest.mark.parametrize("name", ["time", "force"])
def test_what_is_no_number(good, name):
    refused(f"{name} must be finite numbers, got nan at sample 7", changed(good, **{name: put(good[name], 7, np.nan)}))


def test_columns_that_are_missing_unknown_or_of_other_lengths(good):
    refused("must have a column time", {"force": good["force"]})
    refused("at least one of force", {"time": good["time"]})
    refused("unknown column 'Force'", {"time": good["time"], "Force": good["force"]})
    refused("columns of one length", changed(good, force=good["force"][:-1]))
    refused("8 samples at least", {name: values[:5] for name, values in good.items()})


def test_files_that_are_no_logs(tmp_path):
    path = tmp_path / "log.csv"
    for text, match in (
        ("", "is empty"),
        ("time,force\n0,1\n0.1\n", "sample 1 must have 2 values"),
        ("time,force,force\n", "no column twice"),
        ("time,force\n" + "\n".join(f"{k / 1000},{'x' if k == 9 else k}" for k in range(20)), "got x at sample 9"),
    ):
        path.write_text(text)
        refused(match, path)
    refused("is not read as CSV", tmp_path / "none.csv")


def test_arguments_of_other_kinds(good):
    refused("mapping of columns or the path", 7)
    with pytest.raises(TypeError, match="scene must be a Scene"):
        ig.identify(good, None, MOTION)
    with pytest.raises(TypeError, match="motion must be a Trapezoid"):
        ig.identify(good, SCENE, 1.0)
    with pytest.raises(ValueError, match="one for each of 1 logs, got 2"):
        ig.identify(good, SCENE, [MOTION, MOTION])


def test_sensors_that_are_none(good):
    refused("no log has a column 'tool_velocity'", good, sensor={"tool_velocity": ig.Sensor()})
    two = good | {"object_velocity": good["force"] / 100.0}
    refused("sensor must say which column it is of", two, sensor=ig.Sensor())
    for field in ("rate", "low_pass", "noise"):
        with pytest.raises(ValueError, match=f"Sensor.{field} must be finite and above 0"):
            ig.Sensor(**{field: 0.0})
    with pytest.raises(ValueError, match=r"Sensor\.bias must be a number"):
        ig.Sensor(bias="guess")


def test_numbers_without_a_scale_need_a_range():
    undamped = scene(1e5, 0.5, coupling=ig.SpringDamper(150.0, 0.0))
    with pytest.raises(ValueError, match=r"coupling\.damping_ratio is 0 in the scene"):
        ig.identify(log(undamped), undamped, MOTION, free=("coupling.damping_ratio",))
