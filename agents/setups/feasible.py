"""Checks before an hour of training whether a set-up's task can be done."""

from collections.abc import Iterator
from itertools import product

import numpy as np

from impact_gym.scene import Bistable
from impact_gym.task import QUANTITIES, ObservationSpec, Task
from impact_gym.task.task import MOUNT_IDS

OVERSHOOT = 2.0
"""Largest acceleration of a compliant robot's flange over the one asked for: a step on a spring without damping, from
rest. Steps in time with the robot's own swing get to more."""


def warnings(task: Task) -> list[str]:
    """Return a sentence for each problem of some episodes, except those that a `Task` warns of itself.

    Raises:
        ValueError: a problem is in all episodes; names the field.
    """
    (near, far), most = task.scenario.distance, task.acceleration_range[1]
    seen, heard = ObservationSpec(task).scale("position").high, task.longest("reaction_delay") + task.control_period
    ahead, from_on = f"objects stand up to {far:g} m ahead, but", f"objects stand from {1e3 * near:.3g} mm on, where"
    first_reading = f"the first reading arrives, {1e3 * heard:g} ms after the start"
    sentences = {
        f"{ahead} the observation ends at a flange position of {seen:g} m": far > seen,
        f"{from_on} the tool can be before {first_reading}": near <= 0.5 * most * heard**2,
    }
    return [sentence for sentence, holds in sentences.items() if holds] + _off_its_stop(task)


def _off_its_stop(task: Task) -> list[str]:
    """Return a sentence if a bistable mechanism can leave its front stop without a touch."""
    least, most = task.acceleration_range
    holds = [held(corner) for corner in corners(task)]
    if max(holds) < least:
        raise ValueError(
            f"environment.coupling must hold the tool at {least:g} m/s^2, the least that the arm makes; its front stop "
            f"holds {max(holds):.3g} m/s^2 at the most"
        )
    if min(holds) >= most * (1.0 if task.robot is None else OVERSHOOT):
        return []
    swings = "" if task.robot is None else f", and a compliant robot swings to {OVERSHOOT:g} times that and more"
    return [
        f"the front stop holds the tool up to {min(holds):.3g} m/s^2, the arm can make {most:g}{swings}: above that "
        "the mechanism leaves its stop without a touch"
    ]


def held(task: Task) -> float:
    """Return the acceleration up to which the front stop of a bistable mechanism keeps its slider, m/s^2; else inf."""
    if not isinstance(task.coupling, Bistable):
        return np.inf
    return task.coupling.holding_force / task.tool_mass


def corners(task: Task) -> Iterator[Task]:
    """Yield the task at each corner of the ranges of tool, coupling and robot."""
    names = [name for name in task.drawn if name in MOUNT_IDS]
    middles = {name: QUANTITIES[name].middle(*pair) for name, pair in task.drawn.items()}
    for ends in product(*(task.drawn[name] for name in names)):
        yield task.at(middles | dict(zip(names, ends, strict=True)))
