"""What the controller sees: one table that the kernel fills and the documentation is made from."""

import math
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from impact_gym.envs.rows import Episode
from impact_gym.envs.task import AFTER_ALARM, VELOCITY_RANGE, TaskConstants
from impact_gym.kernel import inner_kernel
from impact_gym.solver.state import Array, Chain

POSITION_RANGE = (-0.25, 0.75)  # m
TIME_RANGE = (0.0, 1.5)  # s; an episode lasts 1.35 s and a reaction delay at the most
FORCE_SCALE = 1000.0  # N
WEIGHT_CENTRE, WEIGHT_SPAN = 2.0, 16.0  # m/s per s: 2 / 16 ... 2 * 16
RANGE_SCALE = 0.5  # m
DEFLECTION_SCALE = 0.05  # m
MASS_RANGE = (0.01, 10.0)  # kg
STIFFNESS_RANGE = (1e3, 1e8)  # N/m^1.5
DELAY_SCALE = 0.1  # s


class Entry(NamedTuple):
    """One number of the observation."""

    name: str
    unit: str
    low: float  # physical value that becomes `scaled_low`
    high: float  # physical value that becomes 1
    scaled_low: float
    argument: str = ""  # of the environment that adds it
    shaped_by: tuple[str, ...] = ()  # arguments that change it


_SENSED = ("reaction_delay", "force_noise", "force_bias")

ENTRIES = (
    Entry("flange position", "m", *POSITION_RANGE, -1.0),
    Entry("flange velocity", "m/s", *VELOCITY_RANGE, -1.0),
    Entry("time", "s", *TIME_RANGE, -1.0),
    Entry("alarm", "-", 0.0, 1.0, 0.0, shaped_by=("reaction_delay",)),
    Entry("time since the alarm", "s", 0.0, AFTER_ALARM, 0.0, shaped_by=("reaction_delay",)),
    Entry("contact force as sensed a delay ago", "N, as log(1 + F)", 0.0, FORCE_SCALE, 0.0, shaped_by=_SENSED),
    Entry("its maximum so far, likewise", "N, as log(1 + F)", 0.0, FORCE_SCALE, 0.0, shaped_by=_SENSED),
    Entry(
        "time weight",
        "m/s per s, as log", WEIGHT_CENTRE / WEIGHT_SPAN, WEIGHT_CENTRE * WEIGHT_SPAN, -1.0,
        shaped_by=("time_weight",),
    ),
)  # fmt: skip
OPTIONAL_ENTRIES = (
    Entry("distance estimate minus flange position", "m", -RANGE_SCALE, RANGE_SCALE, -1.0, "range_noise"),
    Entry(
        "tool minus flange from rest, as sensed a delay ago",
        "m", -DEFLECTION_SCALE, DEFLECTION_SCALE, -1.0, "deflection_sensor", ("reaction_delay",),
    ),
    Entry("object mass", "kg, as log", *MASS_RANGE, -1.0, "privileged"),
    Entry("contact stiffness", "N/m^1.5, as log", *STIFFNESS_RANGE, -1.0, "privileged"),
    Entry("restitution", "-", 0.0, 1.0, 0.0, "privileged"),
    Entry("distance minus flange position", "m", -RANGE_SCALE, RANGE_SCALE, -1.0, "privileged"),
    Entry("reaction delay", "s", 0.0, DELAY_SCALE, 0.0, "privileged"),
)  # fmt: skip
"""What an argument adds, in this order, behind the rest."""


def documentation() -> str:
    """Return the table of all entries as Markdown."""
    rows = [("Num", "Observation", "Unit", "from", "to", "Scaled to", "Argument")]
    rows += [
        (
            "then" if entry.argument else str(place),
            entry.name,
            entry.unit,
            f"{entry.low:g}",
            f"{entry.high:g}",
            f"[{entry.scaled_low:g}, 1]",
            _arguments(entry),
        )
        for place, entry in enumerate((*ENTRIES, *OPTIONAL_ENTRIES))
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["| " + " | ".join(map(str.ljust, row, widths)) + " |" for row in rows]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join("    " + line for line in lines)


def _arguments(entry: Entry) -> str:
    """Say which arguments add or change an entry."""
    added = f"only with `{entry.argument}`" if entry.argument else ""
    shaped = ", ".join(f"`{name}`" for name in entry.shaped_by)
    return "; ".join(part for part in (added, shaped) if part)


def entries(task: TaskConstants) -> tuple[Entry, ...]:
    """Return what the options of `task` let the controller see."""
    asked_for = {
        "range_noise": task.range_noise >= 0,
        "deflection_sensor": task.deflection_sensor,
        "privileged": task.privileged,
    }
    return ENTRIES + tuple(entry for entry in OPTIONAL_ENTRIES if asked_for[entry.argument])


def length(task: TaskConstants) -> int:
    """Return how many numbers that is."""
    return len(entries(task))


def space(task: TaskConstants) -> spaces.Space[Any]:
    """Return the observation space of one environment."""
    low = np.array([entry.scaled_low for entry in entries(task)], np.float32)
    return spaces.Box(low, np.ones_like(low), dtype=np.float32)


@inner_kernel
def affine(value: float, low: float, high: float) -> float:
    """Map [low, high] to [-1, 1], what is outside to the nearer end."""
    return min(1.0, max(-1.0, 2.0 * (value - low) / (high - low) - 1.0))


@inner_kernel
def force_reading(force: float) -> float:
    """Map 0 ... 1000 N to 0 ... 1 on a log scale."""
    return min(1.0, math.log1p(force) / math.log1p(FORCE_SCALE))


@inner_kernel
def observe(task: TaskConstants, chain: Chain, episode: Episode, out: Array) -> None:
    """Write the observation at the present time into `out`, in the order of ENTRIES."""
    alarm = chain.time >= episode.alarm
    out[0] = affine(chain.flange_position, POSITION_RANGE[0], POSITION_RANGE[1])
    out[1] = affine(chain.flange_velocity, VELOCITY_RANGE[0], VELOCITY_RANGE[1])
    out[2] = affine(chain.time, TIME_RANGE[0], TIME_RANGE[1])
    out[3] = 1.0 if alarm else 0.0
    out[4] = min(1.0, (chain.time - episode.alarm) / AFTER_ALARM) if alarm else 0.0
    out[5] = force_reading(episode.sensed_force)
    out[6] = force_reading(episode.sensed_peak)
    out[7] = affine(math.log(episode.time_weight / WEIGHT_CENTRE) / math.log(WEIGHT_SPAN), -1.0, 1.0)
    place = 8
    if task.range_noise >= 0.0:
        out[place] = affine((episode.distance_estimate - chain.flange_position) / RANGE_SCALE, -1.0, 1.0)
        place += 1
    if task.deflection_sensor == 1:
        out[place] = affine(episode.sensed_deflection, -DEFLECTION_SCALE, DEFLECTION_SCALE)
        place += 1
    if task.privileged == 1:
        out[place] = affine(math.log(episode.object_mass), math.log(MASS_RANGE[0]), math.log(MASS_RANGE[1]))
        stiffness = math.log(episode.contact_stiffness)
        out[place + 1] = affine(stiffness, math.log(STIFFNESS_RANGE[0]), math.log(STIFFNESS_RANGE[1]))
        out[place + 2] = episode.restitution
        out[place + 3] = affine((episode.distance - chain.flange_position) / RANGE_SCALE, -1.0, 1.0)
        out[place + 4] = min(1.0, episode.reaction_delay / DELAY_SCALE)
