"""Blows recorded by the slow independent solver, through a sensor of its own: nothing here knows our solver.

The motion is read off the solver at NODES times of each contact. In between penetration is a cubic of its values and
rates, and the force follows from that by the contact's law (paper, eq. 5).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator
from scipy.signal import lfilter

from experiments import reference
from experiments.reference.chain import Chain
from experiments.reference.motion import Motion

Array = NDArray[np.float64]

RTOL = 1e-10
NODES = 100  # in a contact
FINE = 1500  # steps of the filter's grid in the shortest contact
LARGEST_GRID = 100_000


@dataclass(frozen=True)
class Blow:
    """Force (N) and velocity of the object (m/s) at `time` (n,) s, evenly and finely spaced."""

    time: Array
    force: Array
    object_velocity: Array


def blow(scene: Any, motion: Any, after: float) -> Blow:  # Any: whatever has their attributes
    """Return the motion from the first touch to `after` seconds behind it.

    Raises:
        ValueError: there is no touch within 3 s.
    """
    contacts = reference.simulate(scene, motion, 3.0, RTOL).contacts
    if not contacts:
        raise ValueError("the tool does not reach the object")
    touch = contacts[0].start
    until = touch + after
    run = reference.simulate(scene, motion, until, RTOL)
    spans = [(contact.start, until if contact.end is None else contact.end) for contact in run.contacts]
    step = max(min(end - start for start, end in spans) / FINE, after / LARGEST_GRID)
    time: Array = touch + step * np.arange(int(after / step), dtype=float)
    force, velocity = np.zeros(len(time)), np.zeros(len(time))
    chain = Chain(scene, motion)
    moving = Motion(chain, scene.object.distance, RTOL)
    kink = [] if run.detection_time is None or motion.brake is None else [run.detection_time + motion.brake.delay]
    for (start, end), contact in zip(spans, run.contacts, strict=True):
        shares = np.linspace(0.0, 1.0, NODES) ** 2  # the onset is the roughest place
        nodes = np.union1d(start + (end - start) * shares, [time for time in kink if start < time < end])
        states = [_at(moving, node) for node in (nodes[1:] if contact.end is None else nodes[1:-1])]
        onset = [0.0, contact.approach_velocity, contact.object_velocity - contact.impulse / chain.m_p]
        points = [onset, *states]
        if contact.separation_velocity is not None:
            points.append([0.0, -contact.separation_velocity, contact.object_velocity])
        delta, rate, speed = np.array(points).T
        inside = (time >= start) & (time < end)
        penetration = CubicHermiteSpline(nodes, delta, rate)
        u, u_dot = np.maximum(penetration(time[inside]), 0.0), penetration(time[inside], 1)
        v_in = max(contact.approach_velocity, moving.floor)
        assert chain.m == chain.n, "one power for stiffness and damping"
        force[inside] = np.maximum(chain.k_c * u**chain.m * (1.0 + chain.d * u_dot / v_in), 0.0)
        velocity[inside] = PchipInterpolator(nodes, speed)(time[inside])
        velocity[time >= end] = contact.object_velocity
    return Blow(time, force, velocity)


def _at(run: Motion, time: float) -> list[float]:
    """Move on to `time` (s) and return penetration, its rate and the object's velocity."""
    while run.t < time:
        run.advance(time)
    return [*run.state[:2].tolist(), run.object_velocity]


def sample_signal(blow: Blow, values: Array, at: Array, low_pass: float | None) -> Array:
    """Return `values` of a blow at times `at` (s), through a first-order low pass (Hz) that is at rest at the touch."""
    if low_pass is not None:
        step = blow.time[1] - blow.time[0]
        x = 2.0 * np.pi * low_pass * step
        kept = np.exp(-x)
        share = -np.expm1(-x) / x  # exact for a signal that is straight between the points of the grid
        values = lfilter([1.0 - share, share - kept], [1.0, -kept], values)
    return np.interp(at, blow.time, values, left=0.0)
