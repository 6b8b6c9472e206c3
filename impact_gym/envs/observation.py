"""What the controller sees: one table that the kernel scales by and the documentation is made from."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from impact_gym.envs.setting import HOLDER_NUMBERS, NUMBERS, markdown, places
from impact_gym.envs.task import AFTER_ALARM, VELOCITY_RANGE, Task
from impact_gym.kernels import ENTRY, EPISODE, LINEAR, LOGARITHM, LOGARITHM_OF_ONE_MORE


class Entry(NamedTuple):
    """One number of the observation."""

    sensor: str  # what it shows, a field of the kernels' `Sensors` or a number of the set-up
    name: str
    unit: str
    low: float  # physical value that becomes `scaled_low`
    high: float  # physical value that becomes 1
    scaled_low: float
    curve: int = LINEAR
    argument: str = ""  # of the environment that adds it
    shaped_by: tuple[str, ...] = ()  # arguments that change it

    def record(self) -> tuple[Any, ...]:
        """Return the fields of the kernels' `Entry`."""
        bend = _CURVES[self.curve]
        gain = (1.0 - self.scaled_low) / (bend(self.high) - bend(self.low))
        return place_of(self.sensor), self.curve, bend(self.low), self.scaled_low, gain


def place_of(sensor: str) -> int:
    """Return where a sensor, or a number of the set-up, stands in an episode, counted in numbers."""
    return _PLACES[f"drawn.setting.{sensor}" if sensor in NUMBERS else f"sensors.{sensor}"]


_CURVES: dict[int, Callable[[float], float]] = {LINEAR: float, LOGARITHM: math.log, LOGARITHM_OF_ONE_MORE: math.log1p}
_PLACES = places(EPISODE)
_DELAY = ("reaction_delay",)
_SENSED = ("reaction_delay", "force_noise", "force_bias", "alarm")
_ALARM = ("reaction_delay", "alarm")
_FORCE = "N, as log(1 + F)"

ENTRIES = (
    Entry("position", "flange position", "m", -0.25, 0.75, -1.0),
    Entry("velocity", "flange velocity", "m/s", *VELOCITY_RANGE, -1.0, shaped_by=("velocity_range",)),
    Entry("time", "time", "s", 0.0, 1.5, -1.0),  # an episode lasts 1.35 s and a reaction delay at the most
    Entry("alarm", "alarm", "-", 0.0, 1.0, 0.0, shaped_by=_ALARM),
    Entry("time_since_alarm", "time since the alarm", "s", 0.0, AFTER_ALARM, 0.0, shaped_by=_ALARM),
    Entry("force", "contact force as sensed a delay ago", _FORCE, 0.0, 1000.0, 0.0, LOGARITHM_OF_ONE_MORE, "", _SENSED),
    Entry("peak", "its maximum so far, likewise", _FORCE, 0.0, 1000.0, 0.0, LOGARITHM_OF_ONE_MORE, "", _SENSED),
    Entry("time_weight", "time weight", "m/s per s, as log", 2 / 16, 2 * 16, -1.0, LOGARITHM, "", ("time_weight",)),
)
OPTIONAL_ENTRIES = (
    Entry("distance_estimate", "distance estimate minus flange position", "m", -0.5, 0.5, -1.0, LINEAR, "range_noise"),
    Entry(
        "range_noise", "standard deviation of the distance estimate", "m", 0.0, 0.05, 0.0, LINEAR, "range_told"
    ),
    Entry(
        "deflection", "tool minus flange from rest, as sensed a delay ago",
        "m", -0.05, 0.05, -1.0, LINEAR, "deflection_sensor", _DELAY,
    ),
    Entry("object_mass", "object mass", "kg, as log", 0.01, 10.0, -1.0, LOGARITHM, "privileged"),
    Entry("contact_stiffness", "contact stiffness", "N/m^1.5, as log", 1e3, 1e8, -1.0, LOGARITHM, "privileged"),
    Entry("restitution", "restitution", "-", 0.0, 1.0, 0.0, LINEAR, "privileged"),
    Entry("distance", "distance minus flange position", "m", -0.5, 0.5, -1.0, LINEAR, "privileged"),
    Entry("reaction_delay", "reaction delay", "s", 0.0, 0.1, 0.0, LINEAR, "privileged"),
)  # fmt: skip
"""What an argument adds, in this order, behind the rest; `privileged` first adds what episodes draw of the set-up and
`holder_told` does not tell."""
TOUCH = Entry(
    "time_since_touch", "time since a switch told of the touch", "s", 0.0, AFTER_ALARM, 0.0, argument="privileged"
)
"""Before these, where there is no such switch but readings raise the alarm."""


def documentation() -> str:
    """Return the table of all entries as Markdown."""
    rows = [("Num", "Observation", "Unit", "from", "to", "Scaled to", "Argument")]
    for place, entry in enumerate((*ENTRIES, *OPTIONAL_ENTRIES)):
        number = "then" if entry.argument else str(place)
        scaled = f"[{entry.scaled_low:g}, 1]"
        added = [f"only with `{entry.argument}`"] if entry.argument else []
        shaped = [", ".join(f"`{name}`" for name in entry.shaped_by)] if entry.shaped_by else []
        arguments = "; ".join(added + shaped)
        rows.append((number, entry.name, entry.unit, f"{entry.low:g}", f"{entry.high:g}", scaled, arguments))
        if entry.sensor == "deflection":
            rows.append(("then", "force and deflection, 1, 2, 3 before", "", "", "", "", "only with `past_readings`"))
            rows.append(
                ("then", "what is drawn of tool, coupling, robot", "", "", "", "[-1, 1]", "only with `holder_told`")
            )
    return markdown(rows)


def entries(task: Task) -> tuple[Entry, ...]:
    """Return what the options of `task` let the controller see."""
    low, high = task.velocity_range
    seen = [one._replace(low=low, high=high) if one.sensor == "velocity" else one for one in ENTRIES]
    asked_for = {name: getattr(task, name) for name in ("range_told", "deflection_sensor", "privileged")}
    asked_for["range_noise"] = task.range_noise is not None  # 0 is an estimate without an error
    added = [entry for entry in OPTIONAL_ENTRIES if asked_for[entry.argument]]
    behind = sum(entry.argument != "privileged" for entry in added)
    read = [entry for entry in (*seen, *added) if entry.sensor in ("force", "deflection")]
    past = [past_entry(entry, before) for before in range(1, task.past_readings + 1) for entry in read]
    told = [drawn_entry(name, task.drawn[name], "holder_told") for name in told_names(task)]
    hidden = task.drawn.keys() - told_names(task) if task.privileged else ()
    drawn = [drawn_entry(name, pair, "privileged") for name, pair in task.drawn.items() if name in hidden]
    touch = [TOUCH] if task.privileged and task.alarm == "reading" else []
    return (*seen, *added[:behind], *past, *told, *touch, *drawn, *added[behind:])


def told_names(task: Task) -> list[str]:
    """Return the names of what episodes draw of the tool and what holds it, where the controller is told."""
    return [name for name in task.drawn if task.holder_told and name in HOLDER_NUMBERS]


def sensor_fields(task: Task) -> dict[str, str]:
    """Return what a controller may know by name, and which sensor of an `Entry` it is; past readings it had before."""
    fields = {name: name for name in ("time", "position", "velocity", "alarm", "time_since_alarm", "force")}
    fields["force_peak"] = "peak"
    fields |= {"distance_estimate": "distance_estimate"} if task.range_noise is not None else {}
    fields |= {"range_noise": "range_noise"} if task.range_told else {}
    fields |= {"deflection": "deflection"} if task.deflection_sensor else {}
    return fields | {name.replace(".", "_"): name for name in told_names(task)}


def past_entry(entry: Entry, before: int) -> Entry:
    """Return what shows a reading of the same sensor so many readings `before` the last one."""
    name = f"{entry.name}, {before} before"
    return entry._replace(sensor=f"{entry.sensor}_{before}", name=name, argument="past_readings")


def drawn_entry(name: str, pair: tuple[float, float], argument: str) -> Entry:
    """Return what shows a number of the set-up that is drawn from a range, from its low end to its high one."""
    number = NUMBERS[name]
    shown, curve = (f"{number.unit}, as log", LOGARITHM) if number.log_uniform(pair[0]) else (number.unit, LINEAR)
    return Entry(name, name, shown, *pair, -1.0, curve, argument)


def scales(task: Task) -> NDArray[Any]:
    """Return the entries of `task` as the kernels read them (n,), ENTRY."""
    return np.array([entry.record() for entry in entries(task)], ENTRY)


def space(task: Task) -> spaces.Space[Any]:
    """Return the observation space of one environment."""
    low = np.array([entry.scaled_low for entry in entries(task)], np.float32)
    return spaces.Box(low, np.ones_like(low), dtype=np.float32)
