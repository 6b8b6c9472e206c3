"""Controllers of the study `sensors`: a filter that is told, inputs of networks, and the prediction of a rival."""

import numpy as np
import pytest
from episode_runs import estimates

from agents.baselines.rule import View
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.setups import load_baseline
from experiments.studies.sensors.ahead import LookAhead
from experiments.studies.sensors.learning import USUAL, Inputs, ToldProfile
from impact_gym.envs.batch import Batch


def test_told_filter_finds_the_place_of_the_object():
    sensor = {"bias": (-0.02, 0.02), "scale": (-0.13, 0.13)}
    error, *_ = estimates(100, 11, 0.0, ToldProfile, range_sensor=sensor, privileged=True)
    assert np.abs(error[-1]).max() < 0.003  # the tool's swing, as the filter predicts it, has an error of up to 2 mm


def test_prediction_of_the_cost_agrees_with_episodes():
    shipped = load_baseline("sensed-robust-profile", 2.0)
    task = shipped.task.changed({"time_weight": 2.0})
    played, rule = ScenarioBatch(0, 500, task).play(shipped), LookAhead.of(shipped.parameters).for_task(task)
    (batch := Batch(500, task)).begin_seeded(0, {})
    view, _ = rule.see(View(batch.observations, rule.spec), None, None)
    predicted = rule.predicted(view)[:, 0].mean()  # before the first step, without a shift
    assert predicted == pytest.approx(played.loss(2.0).mean(), rel=0.05)


def test_network_observes_the_last_eight_readings():
    inputs, state = Inputs("readings"), None
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, (10, 3, len(inputs.spec)))
    for step, observations in enumerate(seen):
        numbers, _, state = inputs.see(observations, state, np.full(3, step == 0) | (np.arange(3) == 1) & (step == 4))
    ranges, places = (View(seen, inputs.spec)[name] for name in ("range", "position"))
    for row, steps in ((0, range(9, 1, -1)), (1, [9, 8, 7, 6, 5, 4, 4, 4])):  # episode 1 began anew at step 4
        moved = places[9, row] - places[steps[1:], row]
        assert numbers[row] == pytest.approx(np.array([*ranges[steps, row], *moved]) / USUAL[0])
