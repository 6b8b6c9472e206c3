"""The command `impact-gym identify log.csv --scene my.toml [--hold-out] [--out setup.toml]`."""

import argparse
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from typing import Any

from impact_gym.identification import FREE, Identified, LoadCell, Sensor, identify
from impact_gym.identification.held_out import hold_out
from impact_gym.identification.log import read
from impact_gym.motion import Brake, Trapezoid
from impact_gym.quantities import QUANTITIES, SCENARIO, SET_UP
from impact_gym.scene import Contact, Object, Scene, Tool
from impact_gym.support.command_line import command_line
from impact_gym.support.dotted_paths import record_from
from impact_gym.support.files import parsed, whole_file, write_file
from impact_gym.support.validation import numbers, one_of, shown
from impact_gym.task import Task

DESCRIPTION = (
    "Fit numbers, such as a stiffness, to measured blows. "
    "The command writes a set-up in which the 95 % intervals of these numbers are ranges."
)

FILE = """
the log of a blow: a CSV file with the column time (s) and one or more of these columns: force (N), flange_velocity,
tool_velocity, object_velocity (m/s), tool_acceleration, object_acceleration. Write units in the header, as in "t [ms]",
or in the line below the header. A column without a unit has the unit in this list. An acceleration must have a unit,
such as m/s^2 or g. Several logs share the fitted numbers, but each log has its own start of the motion.

the scene, my.toml: a set-up (see agents/setups) with a table [motion], and tables [sensor.COLUMN] if needed. Give a
guess for each number to fit. For each other number give its value during the measurement, not a range.

    [environment]
    tool_mass = 0.125                                    # kg
    coupling = { type = "SpringDamper", stiffness = 50.0, damping_ratio = 1.0 }
    [environment.scenario]
    object_mass = 0.25                                   # kg
    contact_stiffness = 1e5                              # N/m^1.5
    restitution = 0.5
    distance = 0.25                                      # m, gap between tool and object at the start
    [motion]                                             # of the robot, which starts at rest
    speed = 1.0                                          # m/s; or a list with a speed for each log
    acceleration = 8.0                                   # m/s^2
    brake = { threshold = 1.0, delay = 0.016 }           # N and s; omit this line if the robot does not brake
    [sensor.force]                                       # known properties of the sensor of the column force
    rate = 4000.0                                        # Hz
    low_pass = 1000.0                                    # Hz, cut-off frequency of a first-order filter
    bias = "estimated"                                   # or a number, in the column's unit
    noise = 0.2                                          # standard deviation, in the column's unit
    cell = { mass = 0.02, frequency = 5000.0 }           # only for a load cell: kg and Hz, optional damping_ratio

the output: the set-up without [motion] and [sensor]. If an interval begins at 0 or ends at infinity, the set-up keeps
your guess of this number, and a comment says so.

--hold-out fits every second log and predicts the other logs, then swaps the two halves. It prints the errors of the
object's final velocity V_p, peak force, impulse and duration, and how much blows with the same motion differ. With
--out setup.toml, the measured and predicted values are also written to setup.held-out.csv.
"""

SET_UP_PATHS = {row.path: f"scenario.{row.id}" for row in SCENARIO} | {row.path: row.id for row in SET_UP if row.path}
"""For each dotted path in a scene, except the equal paths in coupling and robot, the path in `[environment]`."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="impact-gym identify", description=DESCRIPTION, epilog=FILE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("logs", nargs="+", metavar="log.csv", help="logs of blows, all measured with the same scene")
    parser.add_argument("--scene", type=Path, required=True, help="TOML file with known numbers and guesses, see below")
    parser.add_argument("--free", nargs="+", default=list(FREE), help=f"numbers to fit, default: {' '.join(FREE)}")
    parser.add_argument("--hold-out", action="store_true", help="also test predictions, see below")
    parser.add_argument("--out", type=Path, help="file for the set-up; default: print the set-up")
    parser.add_argument("--plot", type=Path, help="file for a figure of the fit and its residuals; needs Matplotlib")
    options = parser.parse_args(arguments)
    with command_line("identify"):
        if find_spec("tomli_w") is None:
            raise RuntimeError("writing a set-up needs tomli-w: pip install tomli-w")
        content = parsed(options.scene, "TOML", tomllib.loads)
        scene, motions, sensors = parse(content, options.free, len(options.logs))
        logs = [read(name, name) for name in options.logs]
        known = logs, scene, motions, options.free, sensors or None
        held_out = hold_out(*known) if options.hold_out else None
        result = identify(*known)
        used = {"tool_mass": f"{scene.tool.mass:g} kg", "coupling": scene.coupling}
        notes = [f"default {key} used: {used[key]}" for key in used if key not in content["environment"]]
        for speed in {m.speed: m for m in motions if m.speed**2 > 2.0 * m.acceleration * scene.object.distance}:
            notes.append(f"motion.speed = {speed:g} m/s is not reached in {scene.object.distance:g} m: is it in mm/s?")
        said = "\n".join([*(log.said for log in logs), *notes, str(result), *([str(held_out)] if held_out else [])])
        text = "\n".join(set_up(content, result, said))
        print(said if options.out else text)
        if options.out:
            write_file(options.out, text)
            if held_out:
                write_file(options.out.with_suffix(".held-out.csv"), held_out.csv())
        if options.plot:
            with whole_file(options.plot) as file:
                result.plot().savefig(file, format=options.plot.suffix[1:] or None)


def parse(
    content: Mapping[str, Any], free: Sequence[str], count: int = 1
) -> tuple[Scene, list[Trapezoid], dict[str, Sensor]]:
    """Return the scene, the motion of each of `count` logs, and the sensors, from the tables of the scene's file."""
    for name in ("environment", "motion"):
        if not isinstance(content.get(name), Mapping):
            raise ValueError(f"the scene's file must have a table [{name}], got {shown(content.get(name))}")
    for name in free:
        if name not in SET_UP_PATHS and not name.startswith(("coupling.", "robot.")):
            raise ValueError(f"free: {name} cannot be fitted; use {', '.join(SET_UP_PATHS)}, coupling.*, robot.*")
    task = Task.of("environment", content["environment"])
    paths = {written.removeprefix("scenario."): path for path, written in SET_UP_PATHS.items()}
    for name, (low, high) in task.ranges.items():
        path = paths.get(name, name)
        if low < high and path not in free and (path in SET_UP_PATHS or path.startswith(("coupling.", "robot."))):
            written = f"environment.{SET_UP_PATHS.get(path, path)}"
            raise ValueError(f"{written} must be a number, not a range, got {low:g} to {high:g}")
    middles = (QUANTITIES[name].middle(*ends) for name, ends in task.scenario.by_id().items())
    mass, stiffness, restitution, distance = middles
    contact = Contact(stiffness, restitution, task.dissipation)
    scene = Scene(Tool(task.tool_mass), Object(mass, distance, task.friction), contact, task.coupling, task.robot)
    motion, sensors = content["motion"], content.get("sensor", {})
    one_of("sensor", sensors, Mapping)
    listed = isinstance(speeds := motion.get("speed"), list)
    tables = [{**motion, "speed": v} for v in numbers("motion.speed", speeds, "m/s")] if listed else [motion] * count
    if len(tables) != count:
        raise ValueError(f"motion.speed must be a number in m/s, or one for each of {count} logs, got {shown(speeds)}")
    motions = [_record("motion", table, Trapezoid, brake=Brake) for table in tables]
    return scene, motions, {name: _record(f"sensor.{name}", sensors[name], Sensor, cell=LoadCell) for name in sensors}


def _record(name: str, table: Any, kind: type[Any], **inner: type[Any]) -> Any:
    """Return an object of the class `kind` with the fields in a table; `inner`: classes for fields that are tables."""
    one_of(name, table, Mapping)
    parts = {key: _record(f"{name}.{key}", table[key], inner[key]) for key in inner if key in table}
    return record_from(name, {"type": kind.__name__, **table, **parts}, (kind,))


def set_up(content: Mapping[str, Any], result: Identified, said: str) -> Iterator[str]:
    """Yield the lines of the set-up: `said` as comments, then the file's tables, with bounded intervals as ranges."""
    import tomli_w  # installed with the extra `train`

    yield from (f"# {line}" for line in said.splitlines())
    written = deepcopy({name: table for name, table in content.items() if name not in ("motion", "sensor")})
    environment = written["environment"]
    if not isinstance(environment.get("scenario", {}), Mapping):
        environment["scenario"] = {}
    for name, (low, high) in result.interval.items():
        *tables, key = SET_UP_PATHS.get(name, name).split(".")
        table = environment.setdefault(tables[0], {}) if tables else environment
        if low and high and isfinite(high - low):
            table[key] = [low, high]
        else:
            yield f"# the interval of {name} begins at 0 or ends at infinity; value kept: {table.get(key, 'default')}"
    yield tomli_w.dumps(written)


if __name__ == "__main__":
    main()
