"""`impact-gym check` prints numbers that follow from the set-up's file."""

import re

import pytest

from agents import check, load_setup
from agents.baselines import PaperTrapezoid
from agents.evaluate.scenario_batch import ScenarioBatch


def test_check_says_what_a_file_means(mine):
    setup = load_setup(mine)
    played = ScenarioBatch(1_000_000, 500, setup.task).play(PaperTrapezoid().for_task(setup.task))
    of_rule = [500, played.object_velocity.mean(), played.approach_time.mean(), played.missed.sum()]
    lags = [4e3 * (m / k + (8.0 + m) / k_r) for m in (0.3, 0.5) for k in (200, 400) for k_r in (5e4, 2e5)]  # mm
    for begin, expected in {
        "in 500 scenarios": of_rule, "the tool lags": [min(lags), max(lags), 4.0, 2.0], "on 30": [30, 1.0, 4.0],
        "distance: ": [0.1, 0.3], "velocity to go to": [-0.2, 0.6],
    }.items():  # fmt: skip
        (line,) = [line for line in check.lines(setup) if line.strip().startswith(begin)]
        numbers = [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?", line)]
        assert numbers == pytest.approx(expected, abs=6e-4, rel=5e-3), line
