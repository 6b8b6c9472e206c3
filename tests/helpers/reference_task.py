"""The environment, computed with the independent solver and written from the specification in `impact_gym.envs.single`.

From `impact_gym` this module imports only scene, task, constants, observation scales and random numbers. It has no
operator, no range sensor, no noise of the force and no ranges of the set-up; friction only with a rigid robot and a
coupling without stops. Set OPENBLAS_NUM_THREADS=1: more threads make small products of matrices up to 25 times as slow.
"""

from math import cos, inf, log1p, pi, sqrt
from typing import NamedTuple

import numpy as np

import impact_gym as ig
from experiments.reference.chain import Chain
from experiments.reference.command import Command
from experiments.reference.motion import Motion
from impact_gym.task import ObservationSpec
from impact_gym.task.episodes import first_uniforms
from impact_gym.task.task import SETTLE_LIMIT

RTOL = 1e-10  # relative tolerance in contacts
FLOOR = 1e-12  # m/s, `Motion.floor`, as in the environment
ROUNDING = 1e-9  # s, allowed rounding error of a time


class Outcome(NamedTuple):
    """Result of an episode; the numbers have the same meaning as in the environment's last `info`."""

    observations: np.ndarray  # (steps, n_obs), without the last one
    object_velocity: float  # m/s, V_p
    approach_time: float  # s
    peak_force: float  # N
    contact_count: int


def play(task, scenario, actions, seed=None):
    """Play actions, each two numbers from -1 to 1, until the episode ends.

    `scenario`: object_mass (kg), contact_stiffness (N/m^1.5), restitution, distance (m). The time weight is 1. `seed`
    of the estimated distance; None: the estimate is exact.
    """
    tool, target = ig.Tool(task.tool_mass), ig.Object(scenario["object_mass"], scenario["distance"], task.friction)
    law = {"dissipation": task.dissipation, "reference_velocity": task.reference_velocity}
    contact = ig.Contact(scenario["contact_stiffness"], scenario["restitution"], **law)
    command = Command(threshold=task.alarm_threshold)
    chain = Chain(ig.Scene(tool, target, contact, task.coupling, task.robot), command)
    motion = Motion(chain, scenario["distance"], RTOL, floor=FLOOR)
    delay, now, estimate = float(task.reaction_delay), 0.0, scenario["distance"]
    if seed is not None:
        uniforms = first_uniforms(seed, 1)[0]
        normal = sqrt(-2 * log1p(-uniforms[5])) * cos(2 * pi * uniforms[6])  # Box-Muller transform
        estimate += task.range_bias + (task.range_noise or 0.0) * normal
    sensed = {0.0: (0.0, 0.0, 0.0)}  # by time (s): force (N), peak force (N), deflection (m)
    by_reading, raised, heard_until = task.alarm == "reading", inf, 0.0
    spec, observations = ObservationSpec(task), []
    for action in actions:
        received = {at: reading for at, reading in sensed.items() if at <= max(now - delay, 0.0) + ROUNDING}
        if by_reading:
            raised = inf if now > raised + task.after_alarm - ROUNDING else raised
            above = any(force > task.alarm_threshold for at, (force, _, _) in received.items() if at > heard_until)
            raised, heard_until = min(raised, now if above else inf), max(received)
        elif command.detection_time is not None:
            raised = command.detection_time + delay
        x, v, *_ = command.at(motion.t)
        force, peak, deflection = list(received.values())[-1]
        heard = now > raised - ROUNDING
        values = {
            "position": x, "velocity": v, "time": now, "alarm": float(heard), "force": force, "force_peak": peak,
            "time_since_alarm": now - raised if heard else 0.0, "time_weight": 1.0, "distance_estimate": estimate - x,
            "range_noise": task.range_noise, "deflection": deflection, "reaction_delay": delay,
            **scenario, "distance": scenario["distance"] - x,
        }  # fmt: skip
        observations.append([scaled(entry.scale, values[entry.id]) for entry in spec.entries])
        velocity, acceleration = (
            round(low + (min(max(float(share), -1.0), 1.0) + 1) / 2 * (high - low), 6)
            for share, (low, high) in zip(action, (task.velocity_range, task.acceleration_range), strict=True)
        )
        command.steer(motion.t, velocity, acceleration)
        while True:
            detected = command.detection_time
            times = _observation_times(task, inf if detected is None else detected + delay, by_reading)
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
    end, approach_time = motion.t + SETTLE_LIMIT, task.horizon
    command.steer(motion.t, 0.0, task.acceleration_range[1])
    if motion.onsets:
        approach_time = min(motion.onsets[0][0], task.horizon)
        while motion.t < end:
            motion.advance(end)
    velocity = motion.top_speed if chain.friction else motion.object_velocity
    return Outcome(np.array(observations, np.float32), velocity, approach_time, motion.peak_force, len(motion.onsets))


def _observation_times(task, alarm, by_reading):
    """Return times (s) of observations and of the episode's end. Unless `by_reading`, periods restart at the alarm."""
    end, period = task.horizon if alarm == inf else alarm + task.after_alarm, task.control_period
    start = 0.0 if alarm == inf or by_reading else alarm
    before = [] if start == 0.0 else [k * period for k in range(1, 1 + int((alarm - ROUNDING) / period))] + [alarm]
    return before + [start + k * period for k in range(1, 1 + int((end - ROUNDING - start) / period))] + [end]


def scaled(scale, value):
    """The observation of a number: the function `scale.curve` is applied to it and to both limits."""
    curve = {"linear": np.asarray, "log": np.log, "log1p": np.log1p}[scale.curve]
    share = (curve(value) - curve(scale.low)) / (curve(scale.high) - curve(scale.low))
    return np.clip(scale.scaled_low + (1.0 - scale.scaled_low) * share, scale.scaled_low, 1.0)
