"""`python -m impact_gym.identify log.csv --scene my.toml [--out setup.toml]`: from a measured blow to a set-up."""

import argparse
import json
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from impact_gym.envs.task import Task
from impact_gym.files import whole_file
from impact_gym.identify import FREE, Identified, Sensor, identify
from impact_gym.motion import Brake, Trapezoid
from impact_gym.scene import Contact, Object, Scene, Tool

DESCRIPTION = """Fit numbers of a scene to a measured blow and write their 95 % intervals as the ranges of a set-up."""

FILE = """
the log: a CSV file whose first line names its columns, time (s) and any of force (N), flange_velocity, tool_velocity,
object_velocity (m/s). Several logs share the free numbers; each has its own start.

the scene, my.toml: a set-up (see agents/setups) and two tables more. Of a number that is fitted it has a guess, of any
other one what it was when the blow was measured: no range.

    [environment]
    tool_mass = 0.125                                    # kg
    coupling = { type = "SpringDamper", stiffness = 50.0, damping_ratio = 1.0 }
    [environment.scenario]
    object_mass = 0.25                                   # kg
    contact_stiffness = 1e5                              # N/m^1.5
    restitution = 0.5
    distance = 0.25                                      # m, between the faces at rest
    [motion]                                             # of the robot, from rest
    speed = 1.0                                          # m/s
    acceleration = 8.0                                   # m/s^2
    brake = { threshold = 1.0, delay = 0.016 }           # N, s; leave it out if it does not brake
    [sensor.force]                                       # what is known of a column, all of it optional
    rate = 4000.0                                        # Hz
    low_pass = 1000.0                                    # Hz, first order
    bias = "estimated"                                   # or a number, in the column's unit
    noise = 0.2                                          # standard deviation

what is written: the set-up with the intervals as ranges, without the two tables, fit for agents.load_setup. A number to
which the log sets no limit on one side stays as it was, and a comment says so.
"""

PLACES = {
    "object.mass": ("scenario", "object_mass"),
    "object.distance": ("scenario", "distance"),
    "contact.stiffness": ("scenario", "contact_stiffness"),
    "contact.restitution": ("scenario", "restitution"),
    "tool.mass": ("tool_mass",),
}
"""Where in `[environment]` a number of a scene stands; those of coupling and robot under their own names."""

MEASURED = ("motion", "sensor")


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line, fit, write."""
    parser = argparse.ArgumentParser(
        prog="python -m impact_gym.identify", description=DESCRIPTION, epilog=FILE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("logs", nargs="+", metavar="log.csv", help="measured blows with the same scene")
    parser.add_argument("--scene", type=Path, required=True, help="what is known, a TOML file, see below")
    parser.add_argument("--free", nargs="+", default=list(FREE), help=f"numbers to fit, default: {' '.join(FREE)}")
    parser.add_argument("--out", type=Path, help="file for the set-up; without it, it is printed")
    parser.add_argument("--plot", type=Path, help="file for a picture of fit and residuals, needs Matplotlib")
    options = parser.parse_args(arguments)
    try:
        content = _read(options.scene)
        scene, motion, sensors = described(content, options.free)
        found = identify(options.logs, scene, motion, options.free, sensors or None)
        text = "\n".join(set_up(content, found)) + "\n"
        print(found if options.out else text)
        if options.out:
            with whole_file(options.out) as file:
                file.write(text.encode())
        if options.plot:
            found.plot().savefig(options.plot)
    except (ImportError, OSError, RuntimeError, ValueError) as error:
        sys.exit(f"impact_gym.identify: {error}")


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text())
    except OSError as error:
        raise ValueError(f"{path} is not read: {error.strerror}") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ValueError(f"{path} is not read as TOML: {error}") from error


def described(content: Mapping[str, Any], free: Sequence[str]) -> tuple[Scene, Trapezoid, dict[str, Sensor]]:
    """Return scene, motion and sensors that the tables of a file describe.

    Raises:
        ValueError: a table is missing, or has something unknown, or a range where a number is needed.
    """
    for name in ("environment", "motion"):
        if not isinstance(content.get(name), Mapping):
            raise ValueError(f"the scene's file must have a table [{name}], got {content.get(name)!r}")
    for name in free:
        if name not in PLACES and not name.startswith(("coupling.", "robot.")):
            raise ValueError(f"free: {name} has no place in a set-up; have {', '.join(PLACES)}, coupling.*, robot.*")
    task = Task(**content["environment"])
    given = content["environment"].get("scenario", {})
    for name, place in PLACES.items():
        known = given.get(place[-1]) if isinstance(given, Mapping) else None
        if place[0] == "scenario" and name not in free and not isinstance(known, (int, float)):
            raise ValueError(f"environment.scenario.{place[-1]} must be a number, as it was measured, got {known!r}")
    for name in task.drawn:
        fitted = "tool.mass" if name == "tool_mass" else name
        if name.startswith(("tool_mass", "coupling.", "robot.")) and fitted not in free:
            raise ValueError(
                f"environment.{name} must be a number, as it was measured, got the range {task.drawn[name]}"
            )
    mass, stiffness, restitution, distance = ((low * high) ** 0.5 for low, high in task.ranges.pairs())
    contact = Contact(stiffness, restitution, task.dissipation)  # type: ignore[arg-type]
    scene = Scene(Tool(task.tool_mass), Object(mass, distance), contact, task.coupling, task.robot)
    moved = dict(content["motion"])
    try:
        if "brake" in moved:
            moved["brake"] = Brake(**moved["brake"])
        return scene, Trapezoid(**moved), {name: Sensor(**one) for name, one in content.get("sensor", {}).items()}
    except TypeError as error:
        raise ValueError(f"motion or sensor: {error}") from error


def set_up(content: Mapping[str, Any], found: Identified) -> Iterator[str]:
    """Yield the lines of the set-up: the file's tables with the intervals as ranges, what the log says as comments."""
    yield from (f"# {line}" for line in str(found).splitlines())
    environment = {name: dict(one) if isinstance(one, Mapping) else one for name, one in content["environment"].items()}
    if not isinstance(environment.get("scenario", {}), Mapping):
        environment["scenario"] = {}
    for name, (low, high) in found.interval.items():
        place = PLACES.get(name, tuple(name.split(".")))
        table = environment.setdefault(place[0], {}) if len(place) > 1 else environment
        if abs(low) > 0.0 and abs(high) < float("inf"):
            table[place[-1]] = [low, high]
        else:
            yield f"# {name} is not this log's: it stays {table.get(place[-1], 'as set-ups have it')}"
    kept = {name: one for name, one in content.items() if name not in MEASURED}
    yield from _lines(kept | {"environment": environment}, "")


def _lines(table: Mapping[str, Any], prefix: str) -> Iterator[str]:
    """Yield a table as TOML: its own values first, records on one line, then the tables in it."""
    inner = {name: one for name, one in table.items() if isinstance(one, Mapping) and "type" not in one}
    for name, one in table.items():
        if name not in inner:
            yield f"{_key(name)} = {_value(one)}"
    for name, one in inner.items():
        yield f"\n[{prefix}{_key(name)}]"
        yield from _lines(one, f"{prefix}{_key(name)}.")


def _key(name: str) -> str:
    return name if name.replace("_", "").replace("-", "").isalnum() else json.dumps(name)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(name)} = {_value(one)}" for name, one in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value) if isinstance(value, (str, bool)) else repr(value)


if __name__ == "__main__":
    main()
