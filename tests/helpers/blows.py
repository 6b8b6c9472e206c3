"""Logs of blows, recorded by the independent solver: what our own is fitted to."""

from functools import lru_cache

import numpy as np

import impact_gym as ig
from experiments.identify.recorder import blow, sample_signal

MOTION = ig.Trapezoid(1.0, 8.0, ig.Brake())
SPRING = ig.SpringDamper(150.0)


def scene(k_c=1e5, e=0.5, m_p=0.25, coupling=SPRING, robot=None):
    return ig.Scene(ig.Tool(0.125), ig.Object(m_p, 0.2505), ig.Contact(k_c, e), coupling, robot)


@lru_cache
def struck(of, after):
    return blow(of, MOTION, after)


def log(of, rate=4000.0, noise=0.02, low_pass=None, bias=0.0, columns=("force",), seed=0, after=0.03):
    """A log from 10 ms before the touch to `after` s behind it, the motion beginning at 1 s; noise over the peak."""
    here, rng = struck(of, after), np.random.default_rng(seed)
    times = here.time[0] - 0.01 + np.arange(int((0.01 + after) * rate)) / rate
    recorded = {"time": times + 1.0}
    for name in columns:
        values = sample_signal(here, getattr(here, name), times, low_pass)
        recorded[name] = values + bias + rng.normal(size=len(times)) * noise * values.max()
    return recorded
