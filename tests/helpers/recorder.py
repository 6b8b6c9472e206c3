"""Blows recorded by the slow independent solver, through a sensor of its own: nothing here knows our solver.

The motion is read off the solver at NODES times of each contact. In between penetration is a cubic of its values and
rates, and the force follows from that by the contact's law (paper, eq. 5).
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator
from scipy.signal import lfilter

import impact_gym as ig
from experiments import reference
from experiments.reference.chain import Chain
from experiments.reference.motion import Motion

RTOL = 1e-10
NODES = 100  # in a contact
FINE, LARGEST_GRID = 1500, 100_000  # steps of the filter's grid: in the shortest contact, and at most
MOTION, SPRING = ig.Trapezoid(1.0, 8.0, ig.Brake()), ig.SpringDamper(150.0)

SCENE_FILE = """
title = "Our arm"
[environment]
tool_mass = 0.125
coupling = { type = "SpringDamper", stiffness = 150.0, damping_ratio = 1.0 }
reaction_delay = [0.012, 0.020]
[environment.scenario]
object_mass = 1.0
contact_stiffness = 1e4
restitution = 0.8
distance = 0.2505
[motion]
speed = 1.0
acceleration = 8.0
brake = { threshold = 1.0, delay = 0.016 }
[sensor.force]
rate = 4000.0
"""


class Blow(NamedTuple):
    """Force (N) and velocity of the object (m/s) at `time` (n,) s, evenly and finely spaced."""

    time: np.ndarray
    force: np.ndarray
    object_velocity: np.ndarray


def scene(k_c=1e5, e=0.5, m_p=0.25, coupling=SPRING, robot=None):
    return ig.Scene(ig.Tool(0.125), ig.Object(m_p, 0.2505), ig.Contact(k_c, e), coupling, robot)


@lru_cache
def blow(of, motion, after):
    """Return the motion from the first touch to `after` seconds behind it."""
    touch = reference.simulate(of, motion, 3.0, RTOL).contacts[0].start
    until = touch + after
    run = reference.simulate(of, motion, until, RTOL)
    spans = [(contact.start, until if contact.end is None else contact.end) for contact in run.contacts]
    step = max(min(end - start for start, end in spans) / FINE, after / LARGEST_GRID)
    time = touch + step * np.arange(int(after / step), dtype=float)
    force, velocity = np.zeros(len(time)), np.zeros(len(time))
    chain = Chain(of, motion)
    assert chain.m == chain.n, "one power for stiffness and damping"
    moving = Motion(chain, of.object.distance, RTOL)
    kink = [] if run.detection_time is None or motion.brake is None else [run.detection_time + motion.brake.delay]
    for (start, end), contact in zip(spans, run.contacts, strict=True):
        shares = np.linspace(0.0, 1.0, NODES) ** 2  # the onset is the roughest place
        nodes = np.union1d(start + (end - start) * shares, [time for time in kink if start < time < end])
        points = [[0.0, contact.approach_velocity, contact.object_velocity - contact.impulse / chain.m_p]]
        for node in nodes[1:] if contact.end is None else nodes[1:-1]:
            while moving.t < node:
                moving.advance(node)
            points.append([*moving.state[:2].tolist(), moving.object_velocity])
        if contact.separation_velocity is not None:
            points.append([0.0, -contact.separation_velocity, contact.object_velocity])
        delta, rate, speed = np.array(points).T
        inside = (time >= start) & (time < end)
        penetration = CubicHermiteSpline(nodes, delta, rate)
        u, u_dot = np.maximum(penetration(time[inside]), 0.0), penetration(time[inside], 1)
        v_in = max(contact.approach_velocity, moving.floor)
        force[inside] = np.maximum(chain.k_c * u**chain.m * (1.0 + chain.d * u_dot / v_in), 0.0)
        velocity[inside] = PchipInterpolator(nodes, speed)(time[inside])
        velocity[time >= end] = contact.object_velocity
    return Blow(time, force, velocity)


def sensed(struck, values, at, low_pass):
    """Return `values` of a blow at times `at` (s), through a first-order low pass (Hz) that is at rest at the touch."""
    if low_pass is not None:
        x = 2.0 * np.pi * low_pass * (struck.time[1] - struck.time[0])
        kept, share = np.exp(-x), -np.expm1(-x) / x  # exact for a signal that is straight between points of the grid
        values = lfilter([1.0 - share, share - kept], [1.0, -kept], values)
    return np.interp(at, struck.time, values, left=0.0)


def log(
    of, rate=4000.0, noise=0.02, low_pass=None, bias=0.0, columns=("force",), seed=0, after=0.03, motion=MOTION,
    before=0.01,
):  # fmt: skip
    """A log to `after` s behind the touch, the motion beginning at 1 s; noise over the peak of each column."""
    here, rng = blow(of, motion, after), np.random.default_rng(seed)
    times = here.time[0] - before + np.arange(int((before + after) * rate)) / rate
    recorded = {"time": times + 1.0}
    for name in columns:
        values = sensed(here, getattr(here, name), times, low_pass)
        recorded[name] = values + bias + rng.normal(size=len(times)) * noise * values.max()
    return recorded


def write_log(path, columns):
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
