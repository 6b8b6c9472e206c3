"""Check, before a training, whether the task of a set-up is possible."""

import math
from collections.abc import Iterator, Sequence
from itertools import product

from impact_gym.quantities import EPISODE, QUANTITIES, SCENARIO, SET_UP
from impact_gym.support.validation import unit_text
from impact_gym.task import ObservationSpec, Task
from impact_gym.task.reach import needed_speed, usual_horizon
from impact_gym.task.task import MOUNT_IDS

OVERSHOOT = 2.0
"""Largest ratio of a compliant robot's acceleration to the commanded acceleration, if the robot is an undamped spring
and the command jumps once. Several jumps at the robot's natural frequency can cause a larger ratio."""
SENSIBLE = 0.25  # share of the top speed at which a slow but sensible controller should still reach all objects
FAR = 5.0  # a number that leaves its range in an observation by a larger factor may have a wrong unit


def doubts(task: Task, weights: Sequence[float] = ()) -> list[str]:
    """Return a sentence for each problem found, also with the time weights (m/s per s) of an evaluation.

    Raises:
        ValueError: the front stop cannot hold the tool.
    """
    (near, _), (least, most) = task.scenario.distance, task.acceleration_range
    first_reading = task.longest("reaction_delay") + task.control_period
    sentences, given = [], task.by_path() | task.ranges
    scenario = (row for row in SCENARIO if row.id != "distance")
    for row in (QUANTITIES["velocity"], QUANTITIES["time_since_alarm"], *scenario, *EPISODE, *SET_UP):
        name, (start, end, *_), unit = row.scale.ends or row.id, row.scale, unit_text(row.unit)
        low, high = (0.0, 0.0) if given.get(name) is None else row.interval(given[name])
        if max(-low, high) > FAR * max(-start, end) or 0.0 < high < start / FAR:
            value = f"{low:g} to {high:g}" if low < high else f"{low:g}"
            sentences.append(f"{name} is {value} {unit}, expected is {start:g} to {end:g} {unit}: is the unit right?")
    sentences += [*_doubts_of_way(task), *_doubts_of_lag(task), *_doubts_of_costs(task, weights)]
    if near <= 0.5 * most * first_reading**2:
        sentences.append(
            f"the nearest objects stand {1e3 * near:.3g} mm ahead: the tool can get there before the first reading"
            f" arrives, {1e3 * first_reading:g} ms after the start"
        )
    if 0.0 < task.coupling.holding_force < math.inf:
        # largest accelerations (m/s^2) at which the front stop holds the tool
        holds = [corner.coupling.holding_force / corner.tool_mass for corner in corners(task)]
        if max(holds) < least:
            raise ValueError(
                f"environment.coupling must hold the tool at {least:g} m/s^2, the arm's lowest acceleration, but its "
                f"front stop holds at most {max(holds):.3g} m/s^2"
            )
        if min(holds) < most * (1.0 if task.robot is None else OVERSHOOT):
            swings = f", and a compliant robot can overshoot to {OVERSHOOT:g} times this and more" if task.robot else ""
            sentences.append(
                f"the front stop holds the tool up to {min(holds):.3g} m/s^2, the arm reaches {most:g} m/s^2{swings}: "
                f"above {min(holds):.3g} m/s^2 the mechanism leaves the stop before a touch"
            )
    return sentences


def _doubts_of_way(task: Task) -> Iterator[str]:
    """Yield problems of the way to the farthest object, in time and in space."""
    far, top, most = task.scenario.distance[1], task.velocity_range[1], task.acceleration_range[1]
    scales = {entry.id: entry.scale.high for entry in ObservationSpec(task).entries}
    where = {"position": "a flange position", "distance_estimate": "an estimated distance", "range": "a range reading"}
    for name, what in where.items():
        if far > scales.get(name, far):
            yield f"objects stand up to {far:g} m ahead, but the observation ends at {what} of {scales[name]:g} m"
    if task.operator is None and SENSIBLE * top < needed_speed(far, most, task.horizon) <= top:
        usual = usual_horizon(far, top)
        longer = f"; the default horizon is {usual:g} s" if usual > task.horizon else ""
        yield f"{least_speed(task)}, more than a quarter of its top speed: a slower controller misses objects{longer}"
    if (stop := top / most) > 2.0 * task.after_alarm:
        left = top - most * task.after_alarm
        yield (
            f"from {top:g} m/s the arm needs {stop:.2g} s to stop, but a controller acts for only {task.after_alarm:g}"
            f" s after the alarm (after_alarm): at {left:.2g} m/s or more, the arm then brakes without a controller"
        )
    if (way := 0.5 * top * stop) > far:
        yield f"from {top:g} m/s the arm stops in {100 * way:.3g} cm, but no object stands beyond {100 * far:.3g} cm"


def _doubts_of_lag(task: Task) -> Iterator[str]:
    """Yield problems of a tool that lags farther behind than is plausible, or observed, at full acceleration."""
    behind, far, most = max(map(lag, corners(task))), task.scenario.distance[1], task.acceleration_range[1]
    stroke, observed = (QUANTITIES[name].scale.high for name in ("coupling.stroke", "deflection"))
    lagging = f"the tool lags {1e3 * behind:.0f} mm behind at {most:g} m/s^2"
    usual = {stroke: "of a usual stroke", far: "from the start to the farthest object"}
    if longest := max((length for length in usual if behind > length), default=0.0):
        than = f"more than the {1e3 * longest:g} mm {usual[longest]}"
        yield f"{lagging}, {than}: are mass, stiffness and acceleration right?"
    if task.deflection_sensor and behind > observed * (1.0 + 1e-9):
        yield f"{lagging}, but the observation ends at a displacement of {1e3 * observed:g} mm"


def _doubts_of_costs(task: Task, weights: Sequence[float]) -> Iterator[str]:
    """Yield problems of costs that leave a controller no choice: to move or not, or how fast."""
    (near, far), top = task.scenario.distance, task.velocity_range[1]
    if task.missed_cost < (slow := SENSIBLE * hardest_hit(task)):
        yield (
            f"missed_cost is {task.missed_cost:g} m/s, but V_p can be {slow:.2g} m/s after a touch at a quarter of the"
            " top speed: the best controller may be one that touches no object"
        )
    # V_p is at most twice the speed v, and d / v is the time to d: above this weight, more speed always costs less
    if weights and min(weights) > (highest := 4.0 * top**2 / (near + far)):
        yield (
            f"all time weights are above {highest:.2g} m/s per s, where the top speed of {top:g} m/s costs least: "
            "no controller will approach slowly; evaluate smaller weights"
        )


def least_speed(task: Task) -> str:
    """Return in words the speed that an arm needs to reach the farthest object within an episode."""
    far = task.scenario.distance[1]
    speed = needed_speed(far, task.acceleration_range[1], task.horizon)
    needs = f"needs at least {speed:.2g} m/s to" if speed <= task.velocity_range[1] else "cannot reach"
    return f"within the horizon of {task.horizon:g} s the arm {needs} {100 * far:.3g} cm"


def hardest_hit(task: Task) -> float:
    """Return V_p (m/s) after one impact on the lightest object at top speed, with the momentum of the tool.

    With a rigid coupling the robot moves with the tool; a rigid robot has infinite mass.
    """
    mass, light = task.longest("tool_mass"), task.scenario.object_mass[0]
    if task.coupling.fixed:
        mass = math.inf if task.robot is None else mass + task.longest("robot.mass")
    return (1.0 + task.scenario.restitution[1]) * task.velocity_range[1] / (1.0 + light / mass)


def lag(task: Task) -> float:
    """Return the tool's steady lag (m) behind the commanded motion at full acceleration."""
    acceleration = task.acceleration_range[1]
    arm = (task.robot.mass + task.tool_mass) / task.robot.stiffness if task.robot else 0.0
    return float(task.coupling.lag(task.tool_mass, acceleration) + acceleration * arm)


def corners(task: Task) -> Iterator[Task]:
    """Yield a task for each combination of the lowest and highest numbers of tool, coupling and robot."""
    names = [name for name in task.drawn if name in MOUNT_IDS]
    middles = {name: QUANTITIES[name].middle(*pair) for name, pair in task.drawn.items()}
    for ends in product(*(task.drawn[name] for name in names)):
        yield task.at(middles | dict(zip(names, ends, strict=True)))
