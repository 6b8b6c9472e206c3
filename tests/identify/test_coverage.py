"""How often 95 % intervals hold the truth, over random scenes recorded by random sensors."""

from dataclasses import replace

import numpy as np
import pytest
from recorder import MOTION, log
from scenes import log_uniform
from scipy.stats import binomtest

import impact_gym as ig

LOGS = 40
GUESS = ig.Object(0.25, 0.25), ig.Contact(1e5, 0.5)  # what every fit is told


def drawn(number):
    """A random scene and motion, a log of its force and perhaps its object's velocity, and what is known of sensors."""
    rng = np.random.default_rng(number)
    spring = ig.SpringDamper(log_uniform(rng, 40.0, 300.0), rng.uniform(0.3, 1.5))
    robot = ig.Robot(rng.uniform(3.5, 7.0), log_uniform(rng, 1e5, 1e6), rng.uniform(30.0, 80.0))
    contact = ig.Contact(log_uniform(rng, 1e4, 1e6), rng.uniform(0.15, 0.9))
    struck = ig.Object(log_uniform(rng, 0.05, 0.4), rng.uniform(0.15, 0.35))
    coupling, behind = ig.Rigid() if number % 4 == 2 else spring, robot if number % 4 == 3 else None
    scene = ig.Scene(ig.Tool(0.125), struck, contact, coupling, behind)
    motion = replace(MOTION, speed=rng.uniform(0.3, 1.2))
    rate, noise = log_uniform(rng, 1e3, 8e3), log_uniform(rng, 0.01, 0.1)
    low_pass = log_uniform(rng, 200.0, 2000.0) if rng.random() < 2 / 3 else None
    bias, known = rng.choice([0.0, rng.normal(0.0, 0.5)]), rng.random() < 0.5
    columns = ("force", "object_velocity")[: 1 + (rng.random() < 1 / 3)]
    span = {"before": rng.uniform(0.005, 0.02), "after": rng.uniform(0.02, 0.04)}
    given = {"rate": rate, "low_pass": low_pass, "columns": columns, "motion": motion, **span}
    clean, offset = log(scene, noise=0.0, **given), "estimated" if bias else 0.0
    noises = {name: noise * clean[name].max() if known else None for name in columns}
    sensors = {name: ig.Sensor(rate, low_pass, offset, deviation) for name, deviation in noises.items()}
    return scene, motion, log(scene, noise=noise, bias=bias, seed=number, **given), sensors


def held(number):
    """Whether each of the intervals holds the truth."""
    scene, motion, recorded, sensors = drawn(number)
    struck, contact = GUESS
    guess = replace(scene, object=replace(struck, distance=scene.object.distance), contact=contact)
    fit = ig.identify(recorded, guess, motion, sensor=sensors)
    truths = scene.contact.stiffness, scene.contact.restitution, scene.object.mass
    return [low <= truth <= high for truth, (low, high) in zip(truths, fit.interval.values(), strict=True)]


@pytest.mark.storm
def test_intervals_hold_the_truth_as_often_as_chance_lets_95_percent_do():
    for hits in np.sum([held(number) for number in range(LOGS)], axis=0):
        assert binomtest(int(hits), LOGS, 0.95).pvalue > 0.003  # 33 to 40 of 40
