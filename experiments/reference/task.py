"""The whole task once more: the controller is asked, the chain is moved by SciPy's integrators, the object is let go.

Written from the specification in `impact_gym.envs.single`, to check what the environment makes of it. Of `impact_gym`
it takes what is data: the options and constants of the task, the scales of the observation, the frozen scenarios. The
motion is that of `experiments.reference`; sensing, clock and settling are written out anew, the simplest way there is.

With OPENBLAS_NUM_THREADS=1, as the workers of `agents.jobs` have it, an episode takes 10 to 60 ms; without, the threads
of the linear algebra wait for each other over matrices of 7 x 7, and a linear chain takes up to 25 times as long.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping, Sequence
from math import cos, inf, log, log1p, pi, sqrt
from types import SimpleNamespace as Record
from typing import Any, NamedTuple

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from experiments.reference.commanded import Motion
from impact_gym.envs import evaluation_sets
from impact_gym.envs.observation import ENTRIES, OPTIONAL_ENTRIES, Entry
from impact_gym.envs.records import DRAWS
from impact_gym.envs.scenario import FIELDS
from impact_gym.envs.task import AFTER_ALARM, HORIZON, SETTLE_LIMIT, Task

SERVED = (
    "coupling", "tool_mass", "robot", "reaction_delay", "control_period", "alarm", "alarm_threshold", "dissipation",
    "range_noise", "range_bias", "range_told", "deflection_sensor", "privileged", "velocity_range",
    "acceleration_range",
)  # fmt: skip
RTOL = 1e-10  # of contacts
ROUNDING = 1e-9  # s, of the clock
SETTLE_SLICE = 0.05  # s, between two looks at whether all is over


class Outcome(NamedTuple):
    """What an episode came to, as in the environment's final `info`."""

    object_velocity: float  # m/s, V_p
    approach_time: float  # s
    peak_force: float  # N
    contact_count: int
    missed: bool
    seconds: float  # of processor time, without the controller's


def play(
    controller: Any, scenario: Mapping[str, float], *, options: Mapping[str, Any], time_weight: float,
    distance_estimate: float | None = None, rtol: float = RTOL,
) -> Outcome:  # fmt: skip
    """Play one episode of a scenario: object_mass (kg), contact_stiffness (N/m^1.5), restitution, distance (m).

    The controller has `predict` as stable-baselines3 has it, and is shown a batch of one. `options` are of the
    environment, `time_weight` (m/s per s) does nothing but be seen, `distance_estimate` (m) is the distance if None,
    and `rtol` is allowed in a step of a contact.

    Raises:
        ValueError: an option that is not served; names it.
    """
    estimate = scenario["distance"] if distance_estimate is None else distance_estimate
    return _together(controller, [_episode(_task(options), scenario, time_weight, estimate, rtol)])[0]


def rescore(
    controller: Any, frozen: str | evaluation_sets.EvaluationSet, numbers: Sequence[int], options: Mapping[str, Any],
    time_weight: float, rtol: float = RTOL, clamp: bool = True,
) -> dict[str, NDArray[Any]]:  # fmt: skip
    """Play the scenarios `numbers` of a frozen set, all of a step at once, as `agents.evaluate.Stage` does.

    The controller is shown a batch whose row k is scenario numbers[k]. `clamp` False: the contact pulls where it would.
    Returns the fields of `Outcome`, an array each.

    Raises:
        ValueError: an option that is not served, or a scenario that the set does not have.
    """
    task, taken = _task(options), evaluation_sets.load(frozen) if isinstance(frozen, str) else frozen
    episodes = []
    for k in numbers:
        if not 0 <= k < taken.count:
            raise ValueError(f"the set has the scenarios 0 to {taken.count - 1}, not {k}")
        scenario = {name: float(taken.scenario[name][k]) for name in FIELDS}
        uniforms = seeding.np_random(taken.seed + k)[0].random(DRAWS)
        normal = sqrt(-2 * log1p(-uniforms[5])) * cos(2 * pi * uniforms[6])  # Box and Muller
        estimate = scenario["distance"] + task.range_bias + (task.range_noise or 0.0) * normal
        episodes.append(_episode(task, scenario, time_weight, estimate, rtol, clamp))
    outcomes = _together(controller, episodes)
    return {name: np.array([getattr(one, name) for one in outcomes]) for name in Outcome._fields}


def _task(options: Mapping[str, Any]) -> Task:
    """Return the options with their defaults."""
    other = [name for name in options if name not in SERVED]
    if other:
        raise ValueError(f"the reference does not serve the options {other}; it serves {list(SERVED)}")
    task = Task(**options)
    if task.delays[0] != task.delays[1]:
        raise ValueError(f"the reference serves one reaction_delay, not a range of them, got {task.delays}")
    if task.drawn:
        raise ValueError(f"the reference serves numbers, not ranges of them, got ranges of {list(task.drawn)}")
    return task


Episode = Generator[NDArray[np.float32], Sequence[float], Outcome]


def _together(controller: Any, episodes: Sequence[Episode]) -> list[Outcome]:
    """Play episodes side by side, one call of the controller for a step of all."""
    seconds = np.zeros(len(episodes))
    outcomes: list[Outcome | None] = [None] * len(episodes)
    observations = np.array([next(episode) for episode in episodes])
    start, state = np.ones(len(episodes), np.bool_), None
    while None in outcomes:
        actions, state = controller.predict(observations.copy(), state=state, episode_start=start, deterministic=True)
        for row, episode in enumerate(episodes):
            if outcomes[row] is None:
                begun = time.process_time()
                try:
                    observations[row] = episode.send(actions[row])
                except StopIteration as end:
                    outcomes[row] = end.value
                seconds[row] += time.process_time() - begun
        start = np.zeros(len(episodes), np.bool_)
    return [one._replace(seconds=float(s)) for one, s in zip(outcomes, seconds, strict=True) if one is not None]


def _episode(
    task: Task, scenario: Mapping[str, float], weight: float, estimate: float, rtol: float, clamp: bool = True
) -> Episode:
    """Yield each observation, take the action for it; return how it ended."""
    motion = _at_rest(task, scenario, rtol, clamp)
    delay, now = task.delays[0], 0.0
    sensed = {0.0: (0.0, 0.0, 0.0)}  # force, its peak and the deflection, by the time
    by_reading, raised, heard_until = task.alarm == "reading", inf, 0.0
    while True:
        received = {at: one for at, one in sensed.items() if at <= max(now - delay, 0.0) + ROUNDING}
        reading = list(received.values())[-1]
        if by_reading:
            raised = inf if now > raised + AFTER_ALARM - ROUNDING else raised
            above = any(force > task.alarm_threshold for at, (force, _, _) in received.items() if at > heard_until)
            raised, heard_until = min(raised, now if above else inf), max(received)
        elif motion.command.detection_time is not None:
            raised = motion.command.detection_time + delay
        flange = motion.command.at(motion.t)[:2]
        action = yield _observe(task, scenario, weight, estimate, now, raised, reading, flange)
        velocity, acceleration = (
            round(low + (min(max(float(one), -1.0), 1.0) + 1) / 2 * (high - low), 6)
            for one, (low, high) in zip(action, (task.velocity_range, task.acceleration_range), strict=True)
        )
        motion.command.steer(motion.t, velocity, acceleration)
        while True:
            detected = motion.command.detection_time
            alarm = inf if detected is None else detected + delay
            times = _observation_times(task.control_period, alarm, by_reading)
            due = min(at for at in times if at > now + ROUNDING)
            if motion.t > due - ROUNDING:
                break
            motion.advance(min(at for at in (due, *(at - delay for at in times)) if at > motion.t + ROUNDING))
            if not by_reading:
                sensed[motion.t] = max(motion.force, 0.0), motion.peak_force, motion.deflection
            elif any(abs(at - delay - motion.t) < ROUNDING for at in times):
                sensed[motion.t] = max(motion.unread_force, motion.force, 0.0), motion.peak_force, motion.deflection
                motion.unread_force = 0.0
        now = due
        if due == times[-1]:
            break
    missed = motion.contacts == 0
    if not missed:
        _settle(motion, task.acceleration_range[1])
    approach_time = min(motion.first_contact, HORIZON)
    return Outcome(motion.object_velocity, approach_time, motion.peak_force, motion.contacts, missed, 0.0)


def _at_rest(task: Task, scenario: Mapping[str, float], rtol: float, clamp: bool = True) -> Motion:
    """Return the chain as an episode finds it."""
    law = {"restitution": scenario["restitution"], "dissipation": task.dissipation, "clamp": clamp}
    scene = Record(
        tool=Record(mass=task.tool_mass),
        object=Record(mass=scenario["object_mass"], distance=scenario["distance"]),
        contact=Record(stiffness=scenario["contact_stiffness"], **law),
        coupling=task.coupling,
        robot=task.robot,
    )
    return Motion(scene, task.alarm_threshold, rtol)


def _settle(motion: Motion, deceleration: float) -> None:
    """Brake the flange to rest, and wait until no contact is left or to come."""
    end = motion.t + SETTLE_LIMIT
    motion.command.steer(motion.t, 0.0, deceleration)
    while motion.t < end and not motion.over():
        motion.advance(min(end, motion.t + SETTLE_SLICE))


def _observation_times(period: float, alarm: float, by_reading: bool) -> list[float]:
    """When the controller is asked, and when the episode ends, s: the clock starts anew at an alarm of its own."""
    end = HORIZON if alarm == inf else alarm + AFTER_ALARM
    start = 0.0 if alarm == inf or by_reading else alarm
    before = [] if start == 0.0 else [k * period for k in range(1, 1 + int((alarm - ROUNDING) / period))] + [alarm]
    return before + [start + k * period for k in range(1, 1 + int((end - ROUNDING - start) / period))] + [end]


def _observe(
    task: Task, scenario: Mapping[str, float], weight: float, estimate: float, now: float, alarm: float,
    reading: tuple[float, float, float], flange: Sequence[float],
) -> NDArray[np.float32]:  # fmt: skip
    """Return the observation, each number scaled as its entry says."""
    heard = now > alarm - ROUNDING
    x, v = flange
    force, peak, deflection = reading
    values = [x, v, now, float(heard), now - alarm if heard else 0.0, force, peak, weight]
    scenario_values = [scenario[name] for name in FIELDS]
    scenario_values[-1] -= x
    shown = {
        "range_noise": [estimate - x] if task.range_noise is not None else [],
        "range_told": [task.range_noise] if task.range_told else [],
        "deflection_sensor": [deflection] if task.deflection_sensor else [],
        "privileged": [*scenario_values, task.delays[0]] if task.privileged else [],
    }
    velocity = ENTRIES[1]._replace(low=task.velocity_range[0], high=task.velocity_range[1])
    entries = [ENTRIES[0], velocity, *ENTRIES[2:], *(entry for entry in OPTIONAL_ENTRIES if shown[entry.argument])]
    values += [value for group in shown.values() for value in group]
    return np.array([_scaled(entry, value) for entry, value in zip(entries, values, strict=True)], np.float32)


def _scaled(entry: Entry, value: float) -> float:
    """Map the range of an entry onto that of its number, by logarithms where it says so."""
    low, high = entry.low, entry.high
    if entry.unit.endswith("as log"):
        value, low, high = log(value), log(low), log(high)
    elif entry.unit.endswith("as log(1 + F)"):
        value, low, high = log1p(value), log1p(low), log1p(high)
    scaled = entry.scaled_low + (1 - entry.scaled_low) * (value - low) / (high - low)
    return min(max(scaled, entry.scaled_low), 1.0)
