"""The filter of range readings: exact without errors, with true standard deviations, and reset in each episode."""

import numpy as np
import pytest

from agents.baselines.filtered import FilteredProfile, FirstReadingProfile
from agents.baselines.profile import LEAST_SPREAD
from agents.baselines.rule import View
from impact_gym.envs.batch import Batch
from impact_gym.task import ObservationSpec, Task

START = [parameter.start for parameter in FilteredProfile.PARAMETERS]
PRIOR = 12.0 / 0.2**2  # 1/m^2, weight of the prior: uniform between 15 and 35 cm


def estimates(rows, steps, kind=FilteredProfile, speed=0.3, **options):
    """Return arrays (steps, rows): error and spread of the estimate, age of the reading, whether there was a touch."""
    task = Task(**options)
    batch, rule = Batch(rows, task), kind(START).for_task(task)
    batch.begin_seeded(0, {})
    spec, state, found = ObservationSpec(task), None, []
    action, none = np.tile([speed, 0.2], (rows, 1)), np.zeros(rows, bool)
    for _ in range(steps):
        view, state = rule.see(View(batch.observations, spec), state, None)
        sensors, distance = batch.sensors(), batch.info()["scenario"]["distance"]
        error = view["distance_estimate"] + sensors["position"] - distance
        found.append((error, view["spread"], sensors["range_age"], batch.bodies().touched))
        batch.step(action, none)
    return (np.array(column) for column in zip(*found, strict=True))


@pytest.mark.parametrize("coupling", [{"type": "Rigid"}, {"type": "SpringDamper", "stiffness": 50.0}])
@pytest.mark.parametrize("delay", [0.0, 0.05])
def test_without_errors_the_estimate_is_the_distance(coupling, delay):
    error, _, age, touched = estimates(200, 12, coupling=coupling, range_sensor={"delay": delay, "bias": 0.01})
    read = np.isfinite(age) & ~touched
    assert read.any(axis=0).all()
    prior = PRIOR / (PRIOR + LEAST_SPREAD**-2) * 0.1  # m, remaining influence of the prior
    swing = 0.0 if coupling["type"] == "Rigid" else 2e-3  # m, because the flange's acceleration changes within a step
    assert np.abs(error[read]).max() < prior + swing + 1e-6


def test_spread_is_that_of_the_readings_weighted_by_their_inverse_variance():
    """At a flange at rest every reading has the same variance."""
    _, spread, age, _ = estimates(500, 10, speed=-0.5, range_sensor={"noise": 0.02, "dropout": 0.3})
    count = np.cumsum(age == 0.0, axis=0)
    assert spread == pytest.approx((PRIOR + count / 0.02**2) ** -0.5, rel=1e-9)
    _, spread, age, _ = estimates(500, 10, FirstReadingProfile, speed=-0.5, range_sensor={"noise": 0.02})
    assert spread == pytest.approx((PRIOR + 1.0 / 0.02**2) ** -0.5, rel=1e-9)


def test_errors_have_the_standard_deviation_of_the_filter():
    error, spread, age, touched = estimates(3000, 12, range_sensor={"noise": 0.01, "dropout": 0.2, "delay": 0.02})
    last = np.isfinite(age[-1]) & ~touched[-1]
    score = (error / spread)[-1][last]
    assert abs(score.mean()) < 5.0 / np.sqrt(score.size) + 0.05
    assert score.std() == pytest.approx(1.0, abs=0.06)


def test_filter_begins_anew_with_each_episode():
    task = Task(range_sensor={"noise": 0.01})
    batch, spec, rule = Batch(4, task), ObservationSpec(task), FilteredProfile(START).for_task(task)
    batch.begin_seeded(0, {})
    view, state = rule.see(View(batch.observations, spec), None, None)
    for _ in range(3):
        batch.step(np.zeros((4, 2)), np.zeros(4, bool))
        _, later = rule.see(View(batch.observations, spec), state, np.zeros(4, bool))
    batch.begin_seeded(0, {})
    again, _ = rule.see(View(batch.observations, spec), later, np.array([True, True, False, False]))
    assert np.array_equal(again["distance_estimate"][:2], view["distance_estimate"][:2])
    assert (again["spread"][2:] < view["spread"][2:]).all()
