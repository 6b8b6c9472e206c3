"""Blows recorded by the slow independent solver through an independent sensor; at the end a quick one of our solver."""

from collections import namedtuple
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter
from solver_scenes import MOTION, SPRING, scene

import impact_gym as ig
from experiments import reference
from experiments.reference.chain import Chain
from experiments.reference.motion import Motion

RTOL = 1e-10
NODES = np.linspace(0.0, 1.0, 100) ** 2  # shares of a contact, with cubics in between; finest at its onset
GRID = 20_000  # times of a blow
SCENE_FILE = Path(__file__).with_suffix(".toml").read_text("utf-8")
Blow = namedtuple("Blow", "time force object_velocity")  # s, N, m/s; evenly and finely spaced


def truths(of):
    """The numbers that `identify` fits by default."""
    return {"contact.stiffness": of.contact.stiffness, "contact.restitution": of.contact.restitution,
            "object.mass": of.object.mass}  # fmt: skip


@lru_cache
def blow(of, motion, after):
    """The motion from the first touch to `after` seconds later."""
    run, moving = reference.simulate(of, motion, 3.0, RTOL), Motion(Chain(of, motion), of.object.distance, RTOL)
    until = run.contacts[0].start + after
    spans = [(contact.start, min(contact.end or until, until)) for contact in run.contacts if contact.start < until]
    time = spans[0][0] + after / GRID * np.arange(GRID)
    force, velocity = np.zeros((2, GRID))
    for start, end in spans:
        nodes, points = start + (end - start) * NODES, []
        for node in nodes:
            while moving.t < node:
                moving.advance(node)
            points.append((moving.force if start < node and moving.touching else 0.0, moving.object_velocity))
        inside = (time >= start) & (time < end)
        force[inside], velocity[inside] = CubicSpline(nodes, points)(time[inside]).T
        velocity[time >= end] = moving.object_velocity
    return Blow(time, force, velocity)


def log(of, rate=4000.0, noise=0.02, low_pass=None, bias=0.0, columns=("force",), seed=0, after=0.03, motion=MOTION):
    """A log until `after` s behind the touch; noise relative to each peak, filter of first order (Hz)."""
    here, rng, before = blow(of, motion, after), np.random.default_rng(seed), 0.01
    times = here.time[0] - before + np.arange(int((before + after) * rate)) / rate
    recorded = {"time": times + 1.0}  # s; the motion begins at 1 s
    for name in columns:
        values = getattr(here, name)
        if low_pass is not None:
            x = 2.0 * np.pi * low_pass * (here.time[1] - here.time[0])
            kept, share = np.exp(-x), -np.expm1(-x) / x  # exact for a signal that is straight between its points
            values = lfilter([1.0 - share, share - kept], [1.0, -kept], values)
        values = np.interp(times, here.time, values, left=0.0)
        recorded[name] = values + bias + rng.normal(size=len(times)) * noise * values.max()
    return recorded


SCENE = scene(1e4, 0.5, SPRING)
TIME = np.arange(0.303, 0.343, 1 / 4000)  # s
BLOW = ig.simulate(scene(1e5, 0.5, SPRING), MOTION, 0.5, trace=True).trace
CLEAN = np.interp(TIME, BLOW.time, BLOW.contact_force)  # N
NOISE = np.random.default_rng(0).normal(size=len(TIME))
FORCE = CLEAN + 0.02 * CLEAN.max() * NOISE
"""A log of a blow by our own solver, for the checks of a log before the fit."""


def put(values, place, value):
    values = values.copy()
    values[place] = value
    return values
