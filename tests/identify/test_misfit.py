"""Warnings of a wrong model; a log's clock, a far guess or a soft spring does not change a fit."""

from dataclasses import replace

import numpy as np
import pytest
from recorder import MOTION, log, scene, truths

import impact_gym as ig

TRUTH = scene(1e5, 0.4)


def recorded(truth, motion, rate, before, samples, noise):
    """A log with `samples`, `before` of them before the touch; the noise is relative to the peak."""
    time = ig.simulate(truth, motion, 20.0).contacts[0].start + (np.arange(samples) - before) / rate
    trace = ig.simulate(truth, motion, time[-1], trace=True).trace
    force = np.interp(time, trace.time, trace.contact_force)
    deviation = noise * force.max()
    return {"time": time, "force": force + np.random.default_rng(0).normal(0.0, deviation, samples)}, deviation


def guessed(truth, stiffness, restitution, mass):
    return replace(truth, object=replace(truth.object, mass=mass), contact=ig.Contact(stiffness, restitution))


@pytest.mark.parametrize(("contact", "mass", "speed"), [
    (ig.Contact(7.45e9, 0.77), 0.31, 0.0149), (ig.Contact(2.5e9, 0.7), 0.6, 0.02),
])  # fmt: skip
@pytest.mark.parametrize("later", [0.0, -3.36, 1e3])
def test_clock_of_the_log_does_not_change_the_fit(contact, mass, speed, later):
    """With a clock that differed by seconds the search once ended at 'the object is a wall'."""
    truth = ig.Scene(ig.Tool(0.16), ig.Object(mass, 0.05), contact, ig.SpringDamper(5.0))
    motion = ig.Trapezoid(speed, 50.0)
    blow, noise = recorded(truth, motion, 51200, 64, 360, 8e-4)
    blow["time"] += later
    fit = ig.identify(blow, guessed(truth, 1e7, 0.5, 1.0), motion, sensor=ig.Sensor(bias="estimated"))
    assert fit.estimate == pytest.approx(truths(truth), rel=0.01)
    assert fit.noise["force"] == pytest.approx(noise, rel=0.1)
    assert np.std(fit.residuals[0]["force"]) == pytest.approx(noise, rel=0.1)
    assert fit.warnings == ()


@pytest.mark.parametrize(("truth", "motion", "rate", "samples"), [
    (ig.Scene(ig.Tool(1.4), ig.Object(1.37, 0.17), ig.Contact(3.1e7, 0.9)), ig.Trapezoid(0.6, 20.0), 9e4, 250),
    (ig.Scene(ig.Tool(0.1), ig.Object(0.35, 0.27), ig.Contact(1.17e5, 0.29), ig.SpringDamper(823.0, 1.12)),
     ig.Trapezoid(0.075, 2.9, ig.Brake()), 11500.0, 1280),
    (ig.Scene(ig.Tool(0.3), ig.Object(0.054, 0.02), ig.Contact(2.3e11, 0.84), ig.SpringDamper(0.18, 0.0)),
     ig.Trapezoid(0.02, 50.0), 3.4e5, 106),
], ids=["rigid", "spring that pushes after the blow", "nearly free tool"])  # fmt: skip
@pytest.mark.parametrize("guess", [(1e3, 0.99, 100.0), (1e10, 0.1, 0.05), (1e7, 0.5, 1e5)])
def test_far_guess_and_truth_lead_to_the_same_fit(truth, motion, rate, samples, guess):
    """The misfit is not larger, and no force is refused as one in kN."""
    blow, noise = recorded(truth, motion, rate, 40, samples, 0.002)
    fit, best = (ig.identify(blow, start, motion) for start in (guessed(truth, *guess), truth))
    assert fit.noise["force"] <= best.noise["force"] * (1.0 + 1e-3) <= 1.3 * noise
    assert fit.estimate == pytest.approx(best.estimate, rel=1e-3)
    assert fit.estimate == pytest.approx(truths(truth), rel=0.03)


@pytest.mark.parametrize(("tool", "contact", "spring", "speed", "rate", "noise"), [
    (0.79, ig.Contact(1.5e6, 0.23), ig.SpringDamper(135.0, 0.24), 0.45, 7e3, 0.015),
    (0.14, ig.Contact(1e7, 0.49), ig.SpringDamper(14.4, 0.25), 0.32, 4.5e4, 0.005),
])  # fmt: skip
def test_number_fixed_at_its_estimate_fits_no_better_and_widens_no_interval(tool, contact, spring, speed, rate, noise):
    """The object is nearly a wall, so its mass may be at its bound."""
    sensor, motion = ig.Sensor(bias="estimated"), ig.Trapezoid(speed, 20.0)
    truth = ig.Scene(ig.Tool(tool), ig.Object(350.0, 0.1), contact, spring)
    blow, _ = recorded(truth, motion, rate, 30, 300, noise)
    fit = ig.identify(blow, truth, motion, sensor=sensor)
    for fixed in fit.estimate:
        nested = ig.identify(blow, fit.scene, motion, [name for name in fit.estimate if name != fixed], sensor)
        assert np.std(nested.residuals[0]["force"]) >= np.std(fit.residuals[0]["force"]) * (1.0 - 1e-5)
        for name, (low, high) in nested.interval.items():
            least, most = fit.interval[name]
            assert high / low <= (most / least) ** 1.05


@pytest.mark.parametrize(("spoil", "words"), [
    (lambda time: 5.0 + 0.0 * time, "not tared"),
    (lambda time: 100.0 * (time - time[0]), "drifts"),
    (lambda time: 3.0 * np.sin(2.0 * np.pi * 300.0 * time), "not white"),
], ids=["untared", "drift", "hum"])  # fmt: skip
def test_misfit_is_a_warning(spoil, words):
    good = log(TRUTH)
    with pytest.warns(UserWarning, match="log, force") as said:
        fit = ig.identify(good | {"force": good["force"] + spoil(good["time"])}, TRUTH, MOTION)
    assert tuple(str(each.message) for each in said) == fit.warnings
    assert any(words in text for text in fit.warnings)
    assert "95 %" not in str(fit)


def test_tool_that_lags_on_a_soft_spring_is_fitted():
    """It touches later than twice the time that the flange takes."""
    truth = ig.Scene(ig.Tool(4.2), ig.Object(0.52, 0.285), ig.Contact(9e5, 0.5), ig.SpringDamper(30.0, 0.42))
    motion = ig.Trapezoid(1.55, 42.0)
    assert ig.simulate(truth, motion, 2.0).contacts[0].start > 2.0 * truth.object.distance / motion.speed
    blow, noise = recorded(truth, motion, 15000, 100, 400, 0.01)
    assert ig.identify(blow, truth, motion).noise["force"] == pytest.approx(noise, rel=0.1)
