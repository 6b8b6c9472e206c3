"""Convert a `Task` for the compiled program."""

import math
from typing import Any

import numpy as np

from impact_gym.kernels import TASK
from impact_gym.pack import LOCAL_SHARE, pack_mount
from impact_gym.quantities import QUANTITIES, SET_UP
from impact_gym.task.task import MOUNT_IDS, PLACES, SETTLE_LIMIT, Task
from impact_gym.teleop.channels import WAYS


def pack_task(task: Task, first_draw: int, table_at: int) -> tuple[Any, list[tuple[Any, ...]], Any]:
    """Return a record (1,) of type TASK, a tuple (the fields of `kernels.DRAW`) for each draw, and the tables (n,).

    `first_draw`: index of the task's first draw among the draws of all tasks. `table_at`: index of the first
    number of the task's tables among the numbers of all tables.
    """
    mount, no_table = pack_mount(task.tool_mass, task.coupling, task.robot)
    record = np.zeros(1, TASK)
    record["mount"] = mount
    numbers = record["numbers"]
    numbers["coupling"], numbers["robot"] = record["mount"]["coupling"], record["mount"]["robot"]
    tables = [no_table, *(task.link.pack(record, table_at + len(no_table)) if task.link else ())]
    for part in ("range_sensor", "operator", *WAYS):
        for name in numbers[part].dtype.names or ():
            numbers[part][name] = getattr(getattr(task, part), name, None) or 0.0
    if task.robot is None:
        for name in numbers["robot"].dtype.names or ():
            numbers["robot"][name] = math.inf  # a rigid robot
    for row in SET_UP:
        if "." not in row.id:
            numbers[row.id] = getattr(task, row.id) or 0.0
    draws = []
    for name, (low, high) in task.ranges.items():
        law: Any = QUANTITIES[name].draw
        source = -1 - law.place if law.own_stream else law.place  # see `Draw` in `records.pxi`
        draws.append((PLACES[name], source, QUANTITIES[name].by_ratio(low), low, high))
    same = ("control_period", "horizon", "after_alarm", "missed_cost", "force_weight")
    values = {name: getattr(task, name) for name in same} | {
        "full_deceleration": task.acceleration_range[1], "settle_limit": SETTLE_LIMIT,
        "reference_velocity": task.reference_velocity or 0.0, "velocity": task.velocity_range,
        "action_size": len(task.action), "actions": task.action.pack(),
        "first_draw": first_draw, "last_draw": first_draw + len(draws),
        "mount_drawn": not task.drawn.keys().isdisjoint(MOUNT_IDS),
        "range_sensor": task.range_sensor is not None, "alarm_by_reading": task.alarm == "reading",
        "tolerance": LOCAL_SHARE * task.rtol, "exact": task.dissipation != "hu-guo",
        "max_steps": task.max_episode_steps or 0,
    }  # fmt: skip
    for name, value in values.items():
        record[name] = value
    return record, draws, np.concatenate(tables)
