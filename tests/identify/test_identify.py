"""What is identified from logs of the independent solver, how surely, and what a log cannot tell."""

import math
import subprocess
import sys

import numpy as np
import pytest
from blows import MOTION, SPRING, log, scene

import impact_gym as ig

GUESS = scene(1e4, 0.8, 1.0)
NUMBERS = ("contact.stiffness", "contact.restitution", "object.mass")
ROBOT = ig.Robot(5.225, 1.5e5, 53.75)


def guess(coupling=SPRING, robot=None):
    return scene(1e4, 0.8, 1.0, coupling, robot)


def truths(of):
    return dict(zip(NUMBERS, (of.contact.stiffness, of.contact.restitution, of.object.mass), strict=True))


def assert_near(found, of, widths=2.0):
    """Each estimate within so many half widths of its 95 % interval."""
    for name, truth in truths(of).items():
        low, high = found.interval[name]
        assert low < found.estimate[name] < high
        assert abs(found.estimate[name] - truth) <= widths * (high - low) / 2


@pytest.mark.parametrize(
    ("truth", "columns"),
    [
        (scene(1e6, 0.5, coupling=ig.Rigid()), ("force",)),
        (scene(2e5, 0.3), ("force",)),
        (scene(3e4, 0.7, 0.1, robot=ROBOT), ("force", "object_velocity")),
        (scene(1e5, 0.5), ("object_velocity",)),
    ],
    ids=["rigid", "spring", "robot, two columns", "velocity alone"],
)
def test_the_numbers_behind_a_log_of_the_independent_solver_are_found(truth, columns):
    found = ig.identify(log(truth, columns=columns), guess(truth.coupling, truth.robot), MOTION)
    assert_near(found, truth)
    assert found.indistinguishable == ()
    assert found.scene.contact.stiffness == found.estimate["contact.stiffness"]
    assert found.start[0] == pytest.approx(1.0, abs=1e-3)


def test_with_next_to_no_noise_they_are_found_to_a_thousandth():
    truth = scene(1e5, 0.5)
    found = ig.identify(log(truth, noise=1e-5), GUESS, MOTION)
    for name, value in truths(truth).items():
        assert found.estimate[name] == pytest.approx(value, rel=1e-3)


def test_filter_and_bias_of_a_sensor_are_taken_into_account():
    truth = scene(1e5, 0.5)
    recorded = log(truth, low_pass=300.0, bias=2.0)
    found = ig.identify(recorded, GUESS, MOTION, sensor=ig.Sensor(4000.0, 300.0, "estimated"))
    assert_near(found, truth)
    assert found.bias[0]["force"] == pytest.approx(2.0, abs=0.3)
    unaware = ig.identify(recorded, GUESS, MOTION, sensor=ig.Sensor(bias=2.0))
    assert unaware.estimate["contact.stiffness"] + 4000.0 < found.estimate["contact.stiffness"]


def test_noise_is_estimated_and_what_is_known_of_it_is_believed():
    recorded = log(scene(1e5, 0.5), noise=0.05)
    noise = 0.05 * log(scene(1e5, 0.5), noise=0.0)["force"].max()
    estimated, known, twice = (
        ig.identify(recorded, GUESS, MOTION, sensor=ig.Sensor(noise=one)) for one in (None, noise, 2 * noise)
    )
    assert estimated.noise["force"] == pytest.approx(noise, rel=0.2)
    assert np.std(known.residuals[0]["force"]) == pytest.approx(noise, rel=0.2)
    widths = [np.diff(np.log(one.interval["contact.stiffness"]))[0] for one in (known, twice)]
    assert widths[1] == pytest.approx(2 * widths[0], rel=0.25)  # the misfit is no parabola


def test_another_clock_changes_the_start_and_nothing_else():
    recorded = log(scene(1e5, 0.5))
    first, later = (ig.identify(recorded | {"time": recorded["time"] + shift}, GUESS, MOTION) for shift in (0.0, 0.375))
    assert later.start[0] - first.start[0] == pytest.approx(0.375, abs=1e-6)
    for name in NUMBERS:
        assert later.estimate[name] == pytest.approx(first.estimate[name], rel=1e-3)


def test_four_logs_share_their_numbers_and_know_them_twice_as_well():
    truth = scene(1e5, 0.5)
    logs = [log(truth, seed=seed) for seed in range(4)]
    one, all_four = (ig.identify(some, GUESS, MOTION) for some in (logs[0], logs))
    assert_near(all_four, truth)
    widths = [np.diff(np.log(found.interval["contact.stiffness"]))[0] for found in (one, all_four)]
    assert widths[0] / widths[1] == pytest.approx(2.0, rel=0.25)
    assert len(all_four.start) == len(all_four.residuals) == 4


def test_other_numbers_of_the_scene_may_be_free():
    truth = scene(1e5, 0.5)
    recorded = log(truth, columns=("force", "object_velocity"), after=0.06)
    free = {"contact.stiffness": (1e3, 1e7), "coupling.stiffness": (20.0, 1000.0)}
    found = ig.identify(recorded, scene(1e4, 0.5, coupling=ig.SpringDamper(300.0)), MOTION, free)
    low, high = found.interval["coupling.stiffness"]
    assert low < 150.0 < high < 2 * low


def test_an_interval_ends_where_the_misfit_has_grown_by_the_quantile():
    recorded = log(scene(1e5, 0.5), noise=0.1)
    noise = 0.1 * log(scene(1e5, 0.5), noise=0.0)["force"].max()
    free = ("contact.stiffness",)
    found = ig.identify(recorded, scene(1e4, 0.5), MOTION, free, ig.Sensor(noise=noise))

    def misfit(stiffness):  # over a fine grid of start times
        trace = ig.simulate(scene(stiffness, 0.5), MOTION, 0.4, trace=True).trace
        starts = found.start[0] + np.linspace(-3e-4, 3e-4, 301)
        at = recorded["time"] - starts[:, None]
        fitted = np.interp(at, trace.time, trace.contact_force)
        return np.min(np.sum((fitted - recorded["force"]) ** 2, axis=1)) / noise**2

    least = misfit(found.estimate["contact.stiffness"])
    for end in found.interval["contact.stiffness"]:
        assert misfit(end) - least == pytest.approx(3.841, rel=0.1)  # chi-squared, one degree of freedom, 95 %


def test_an_object_much_heavier_than_the_tool_is_as_good_as_a_wall_to_the_force():
    truth = scene(1e5, 0.5, 50.0)
    found = ig.identify(log(truth, after=0.012), GUESS, MOTION)
    low, high = found.interval["object.mass"]
    assert 1.0 < low < 50.0
    assert high == math.inf
    assert any("does not tell object.mass" in one and "heavier than the tool" in one for one in found.indistinguishable)


def test_samples_slower_than_the_blow_do_not_tell_the_stiffness():
    truth = scene(1e7, 0.3, coupling=ig.Rigid())
    noise = 0.02 * log(truth, rate=500.0, noise=0.0, after=0.012)["force"].max()
    found = ig.identify(log(truth, rate=500.0, after=0.012), guess(ig.Rigid()), MOTION, sensor=ig.Sensor(noise=noise))
    low, high = found.interval["contact.stiffness"]
    assert low < 1e7 < high
    assert high > 10 * low
    assert any("contact.stiffness" in one and "2 ms apart, lie in the blow" in one for one in found.indistinguishable)


def test_a_filter_longer_than_the_blow_hides_the_restitution():
    truth = scene(1e7, 0.5, coupling=ig.Rigid())
    recorded = log(truth, low_pass=5.0, noise=0.1, after=0.012, seed=1)
    found = ig.identify(recorded, guess(ig.Rigid()), MOTION, sensor=ig.Sensor(low_pass=5.0))
    low, high = found.interval["contact.restitution"]
    assert low < 0.5 < high
    assert high - low > 0.5
    assert any("contact.restitution" in one and "filter takes 32 ms" in one for one in found.indistinguishable)


def test_a_motion_that_was_over_long_before_the_log_is_no_fit_and_costs_no_simulation():
    recorded = log(scene(1e5, 0.5))
    model = ig.identify(recorded, GUESS, MOTION, free=("object.mass",)).fit.model
    done = model.simulations
    left = model.residuals(np.array([np.log(0.25), recorded["time"][0] - 100.0]))
    assert model.simulations == done
    assert np.all(np.abs(left) * model.noise["force"] > 100 * recorded["force"].max())


def test_a_sensors_low_pass_answers_a_ramp_as_its_equation_does():
    time = np.linspace(0.0, 0.05, 40)
    at = np.linspace(0.0, 0.05, 77)
    read, slope = ig.Sensor(low_pass=100.0).senses(time, 3.0 * time, at)
    lag = 1.0 / (2.0 * math.pi * 100.0)  # of y' = (u - y) / lag with u = 3 t
    assert read == pytest.approx(3.0 * (at - lag * (1.0 - np.exp(-at / lag))), abs=1e-6)
    assert slope == pytest.approx(3.0 * (1.0 - np.exp(-at / lag)), abs=1e-3)


def test_correlations_are_those_of_the_estimates():
    truth = scene(1e5, 0.5)
    found = [ig.identify(log(truth, seed=seed), GUESS, MOTION) for seed in range(2)]
    for one in found:
        assert np.allclose(np.diag(one.correlation), 1.0)
        assert np.allclose(one.correlation, one.correlation.T)
        assert f"correlation of contact.stiffness and object.mass: {one.correlation[0, 2]:.2f}" in str(one)
        assert " N/m^1.5, 95 % in " in str(one)
    assert np.allclose(found[0].correlation, found[1].correlation, atol=0.1)  # of the scene, hardly of the noise


def test_the_picture_has_a_row_for_each_column_with_units():
    found = ig.identify(log(scene(1e5, 0.5), columns=("force", "object_velocity")), GUESS, MOTION)
    labels = [axes.get_ylabel() for axes in found.plot().axes]
    assert "force (N)" in labels
    assert "object_velocity (m/s)" in labels
    assert labels.count("residual over noise") == 2


@pytest.mark.parametrize(
    "first",
    ["import impact_gym.identify", "from impact_gym.identify import Sensor", "import impact_gym.identify.fit"],
)
def test_identify_is_the_function_whatever_is_imported_first(first):
    lines = f"{first}\nimport impact_gym as ig\nimport impact_gym.identify.log\nassert callable(ig.identify)"
    subprocess.run([sys.executable, "-c", lines], check=True)
