"""A fit that may not be trusted is said; the clock of a log, or a soft spring, changes none."""

from dataclasses import replace

import numpy as np
import pytest
from recorder import MOTION, log, scene

import impact_gym as ig

TRUTH = scene(1e5, 0.4)


@pytest.mark.parametrize("later", [0.0, -3.36, 1e3])
def test_wrong_minimum_of_the_clock_is_not_taken(later):
    """The issue's: a clock seconds from the motion's ended the search at 'the object is a wall'."""
    truth = ig.Scene(ig.Tool(0.16), ig.Object(0.31, 0.05), ig.Contact(7.45e9, 0.77), ig.SpringDamper(5.0))
    motion = ig.Trapezoid(0.0149, 50.0)
    touch = ig.simulate(truth, motion, 5.0).contacts[0].start
    time = touch + (np.arange(360) - 64) / 51200
    trace = ig.simulate(truth, motion, time[-1], trace=True).trace
    force = np.interp(time, trace.time, trace.contact_force) + np.random.default_rng(0).normal(0.0, 0.008, 360)
    guess = replace(truth, object=ig.Object(1.0, 0.05), contact=ig.Contact(1e7, 0.5))
    fit = ig.identify({"time": time + later, "force": force}, guess, motion, sensor=ig.Sensor(bias="estimated"))
    assert fit.estimate == pytest.approx(
        {"contact.stiffness": 7.45e9, "contact.restitution": 0.77, "object.mass": 0.31}, rel=0.01
    )
    assert fit.noise["force"] == pytest.approx(0.008, rel=0.1)
    assert np.std(fit.residuals[0]["force"]) == pytest.approx(0.008, rel=0.1)
    assert fit.warnings == ()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda time: 5.0 + 0.0 * time, "not tared"),
        (lambda time: 100.0 * (time - time[0]), "drifts"),
        (lambda time: 3.0 * np.sin(2.0 * np.pi * 300.0 * time), "not white"),
    ],
    ids=["untared", "drift", "hum"],
)
def test_misfit_is_said(spoil, words):
    good = log(TRUTH)
    with pytest.warns(UserWarning, match="log, force") as said:
        fit = ig.identify(good | {"force": good["force"] + spoil(good["time"])}, TRUTH, MOTION)
    assert tuple(str(each.message) for each in said) == fit.warnings
    assert any(words in text for text in fit.warnings)
    assert "95 %" not in str(fit)


def test_log_that_fits_is_not_said_to_misfit():
    for seed in range(4):  # UserWarning is an error in these tests
        assert ig.identify(log(TRUTH, seed=seed), TRUTH, MOTION).warnings == ()


def test_tool_that_lags_on_a_soft_spring_is_fitted_at_its_own_touch():
    """It touches later than twice the time of the flange."""
    truth = ig.Scene(ig.Tool(4.2), ig.Object(0.52, 0.285), ig.Contact(9e5, 0.5), ig.SpringDamper(30.0, 0.42))
    motion = ig.Trapezoid(1.55, 42.0)
    touch = ig.simulate(truth, motion, 2.0).contacts[0].start
    assert touch > 2.0 * truth.object.distance / motion.speed
    time = touch + (np.arange(400) - 100) / 15000
    trace = ig.simulate(truth, motion, time[-1], trace=True).trace
    force = np.interp(time, trace.time, trace.contact_force)
    noise = 0.01 * force.max() * np.random.default_rng(0).normal(size=400)
    fit = ig.identify({"time": time, "force": force + noise}, truth, motion)
    assert fit.noise["force"] == pytest.approx(0.01 * force.max(), rel=0.1)
