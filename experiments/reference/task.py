"""The environment, computed with the independent solver and written from the specification in `impact_gym.envs.single`.

From `impact_gym` this module imports only task options, constants, observation scales, scenarios and random numbers.
Set OPENBLAS_NUM_THREADS=1: with more threads, small products of matrices make an episode up to 25 times as long.
"""

from collections.abc import Callable, Generator, Mapping, Sequence
from math import cos, inf, log, log1p, pi, sqrt
from types import SimpleNamespace as Record
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.reference.chain import Chain
from experiments.reference.command import Command
from experiments.reference.motion import Motion
from impact_gym.couplings import Bistable
from impact_gym.task import ObservationSpec, Task, evaluation_sets
from impact_gym.task.episodes import first_uniforms
from impact_gym.task.scenario import FIELDS
from impact_gym.task.task import SETTLE_LIMIT

SERVED = (
    "coupling", "tool_mass", "robot", "reaction_delay", "control_period", "alarm", "alarm_threshold", "dissipation",
    "range_noise", "range_bias", "observe_range_noise", "deflection_sensor", "privileged", "velocity_range",
    "acceleration_range", "friction", "reference_velocity", "horizon", "after_alarm",
)  # fmt: skip
RTOL = 1e-10  # relative tolerance in contacts
FLOOR = 1e-12  # m/s, `Motion.floor`, as in the environment
ROUNDING = 1e-9  # s, allowed rounding error of a time
# functions by `Scale.curve`; before scaling, `_observe` applies the function to the value and to both limits
CURVES: dict[str, Callable[[float], float]] = {"linear": float, "log": log, "log1p": log1p}


class Outcome(NamedTuple):
    """Result of an episode; the fields have the same meaning as in the environment's last `info`."""

    object_velocity: float  # m/s, V_p
    approach_time: float  # s
    peak_force: float  # N
    contact_count: int
    missed: bool


def play(controller: Any, scenario: Mapping[str, float], *, options: Mapping[str, Any], time_weight: float) -> Outcome:
    """Play one episode of a scenario: object_mass (kg), contact_stiffness (N/m^1.5), restitution, distance (m).

    The controller has the method `predict` of stable-baselines3. `options` are arguments of the environment.
    `time_weight` (m/s per s) only enters observations. The distance estimate is exact. ValueError: unsupported option.
    """
    return _together(controller, [_episode(task_of(options), scenario, time_weight, scenario["distance"])])[0]


def rescore(
    controller: Any, frozen: str, numbers: Sequence[int], options: Mapping[str, Any], time_weight: float
) -> dict[str, NDArray[Any]]:
    """Play the scenarios `numbers` of a frozen set; return an array (numbers,) for each field of `Outcome`."""
    task, scenarios = task_of(options), evaluation_sets.load(frozen)
    episodes = []
    for k in numbers:
        if not 0 <= k < scenarios.count:
            raise ValueError(f"numbers must be scenarios of the set, 0 to {scenarios.count - 1}, got {k}")
        scenario = {name: float(scenarios.scenario[name][k]) for name in FIELDS}
        uniforms = first_uniforms(scenarios.seed + k, 1)[0]
        normal = sqrt(-2 * log1p(-uniforms[5])) * cos(2 * pi * uniforms[6])  # Box-Muller transform
        estimate = scenario["distance"] + task.range_bias + (task.range_noise or 0.0) * normal
        episodes.append(_episode(task, scenario, time_weight, estimate))
    outcomes = _together(controller, episodes)
    return {name: np.array([getattr(outcome, name) for outcome in outcomes]) for name in Outcome._fields}


def task_of(options: Mapping[str, Any]) -> Task:
    """Return the task with these options; ValueError: the reference does not support an option."""
    other = [name for name in options if name not in SERVED]
    if other:
        raise ValueError(f"the reference does not support the options {other}; it supports {list(SERVED)}")
    task = Task(**options)
    if isinstance(task.reaction_delay, tuple):
        raise ValueError(f"the reference supports a number as reaction_delay, not a range, got {task.reaction_delay}")
    if task.drawn:
        raise ValueError(f"the reference supports fixed numbers, not ranges, got ranges of {list(task.drawn)}")
    if task.friction and (task.robot or isinstance(task.coupling, Bistable) or getattr(task.coupling, "stroke", None)):
        raise ValueError("the reference supports friction only with a rigid robot and a coupling without stops")
    return task


Episode = Generator[NDArray[np.float32], Sequence[float], Outcome]


def _together(controller: Any, episodes: Sequence[Episode]) -> list[Outcome]:
    outcomes: dict[int, Outcome] = {}
    observations = np.array([next(episode) for episode in episodes])
    start, state = np.ones(len(episodes), np.bool_), None
    while len(outcomes) < len(episodes):
        actions, state = controller.predict(observations.copy(), state=state, episode_start=start, deterministic=True)
        for row, episode in enumerate(episodes):
            if row not in outcomes:
                try:
                    observations[row] = episode.send(actions[row])
                except StopIteration as end:
                    outcomes[row] = end.value
        start = np.zeros(len(episodes), np.bool_)
    return [outcomes[row] for row in range(len(episodes))]


def _episode(task: Task, scenario: Mapping[str, float], weight: float, estimate: float) -> Episode:
    motion = _at_rest(task, scenario)
    command, delay, now = motion.command, task.reaction_delay, 0.0
    sensed = {0.0: (0.0, 0.0, 0.0)}  # by time (s): force (N), peak force (N), deflection (m)
    by_reading, raised, heard_until = task.alarm == "reading", inf, 0.0
    spec = ObservationSpec(task)
    while True:
        received = {at: reading for at, reading in sensed.items() if at <= max(now - delay, 0.0) + ROUNDING}
        if by_reading:
            raised = inf if now > raised + task.after_alarm - ROUNDING else raised
            above = any(force > task.alarm_threshold for at, (force, _, _) in received.items() if at > heard_until)
            raised, heard_until = min(raised, now if above else inf), max(received)
        elif command.detection_time is not None:
            raised = command.detection_time + delay
        flange = command.at(motion.t)[:2]
        reading = list(received.values())[-1]
        action = yield _observe(spec, task, scenario, weight, estimate, now, raised, reading, flange)
        velocity, acceleration = (
            round(low + (min(max(float(share), -1.0), 1.0) + 1) / 2 * (high - low), 6)
            for share, (low, high) in zip(action, (task.velocity_range, task.acceleration_range), strict=True)
        )
        command.steer(motion.t, velocity, acceleration)
        while True:
            detected = command.detection_time
            alarm = inf if detected is None else detected + delay
            times = _observation_times(task, alarm, by_reading)
            due = min(at for at in times if at > now + ROUNDING)
            if motion.t > due - ROUNDING:
                break
            motion.advance(min(at for at in (due, *(at - delay for at in times)) if at > motion.t + ROUNDING))
            deflection = -float(motion.state[2])
            if not by_reading:
                sensed[motion.t] = max(motion.force, 0.0), motion.peak_force, deflection
            elif any(abs(at - delay - motion.t) < ROUNDING for at in times):
                sensed[motion.t] = max(motion.unread_force, motion.force, 0.0), motion.peak_force, deflection
                motion.unread_force = 0.0
        now = due
        if due == times[-1]:
            break
    missed, end = not motion.onsets, motion.t + SETTLE_LIMIT
    command.steer(motion.t, 0.0, task.acceleration_range[1])
    while motion.t < end and not missed:
        motion.advance(end)
    approach_time = task.horizon if missed else min(motion.onsets[0][0], task.horizon)
    kept = motion.top_speed if motion.chain.friction else motion.object_velocity
    return Outcome(kept, approach_time, motion.peak_force, len(motion.onsets), missed)


def _at_rest(task: Task, scenario: Mapping[str, float]) -> Motion:
    law = {"restitution": scenario["restitution"], "dissipation": task.dissipation}
    law["reference_velocity"] = task.reference_velocity
    scene = Record(
        tool=Record(mass=task.tool_mass),
        object=Record(mass=scenario["object_mass"], friction=task.friction),
        contact=Record(stiffness=scenario["contact_stiffness"], **law),
        coupling=task.coupling,
        robot=task.robot,
    )
    chain = Chain(scene, Command(threshold=task.alarm_threshold))
    return Motion(chain, scenario["distance"], RTOL, floor=FLOOR)


def _observation_times(task: Task, alarm: float, by_reading: bool) -> list[float]:
    """Return times (s) of observations and of the episode's end. Unless `by_reading`, periods restart at the alarm."""
    end, period = task.horizon if alarm == inf else alarm + task.after_alarm, task.control_period
    start = 0.0 if alarm == inf or by_reading else alarm
    before = [] if start == 0.0 else [k * period for k in range(1, 1 + int((alarm - ROUNDING) / period))] + [alarm]
    return before + [start + k * period for k in range(1, 1 + int((end - ROUNDING - start) / period))] + [end]


def _observe(
    spec: ObservationSpec, task: Task, scenario: Mapping[str, float], weight: float, estimate: float, now: float,
    alarm: float, reading: tuple[float, float, float], flange: Sequence[float],
) -> NDArray[np.float32]:  # fmt: skip
    heard = now > alarm - ROUNDING
    x, v = flange
    force, peak, deflection = reading
    values = {
        "position": x, "velocity": v, "time": now, "alarm": float(heard),
        "time_since_alarm": now - alarm if heard else 0.0, "force": force, "force_peak": peak, "time_weight": weight,
        "distance_estimate": estimate - x, "range_noise": task.range_noise, "deflection": deflection,
        **scenario, "distance": scenario["distance"] - x, "reaction_delay": task.reaction_delay,
    }  # fmt: skip
    scaled = []
    for entry in spec.entries:
        scale = entry.scale
        value, low, high = map(CURVES[scale.curve], (values[entry.id], scale.low, scale.high))
        place = scale.scaled_low + (1.0 - scale.scaled_low) * ((value - low) / (high - low))
        scaled.append(min(1.0, max(scale.scaled_low, place)))
    return np.array(scaled, np.float32)
