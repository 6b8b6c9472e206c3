"""The search finds optima that are known, and tuning goes on where it was stopped."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from agents import tune as tuning
from agents.baselines import ConstantSpeed
from agents.baselines.rule import Parameter
from agents.baselines.tuned import load_baseline, read_tuned
from agents.search_rules import minimise
from agents.setups import load_setup
from agents.tune import Tune, tune

SPACE = (
    Parameter("speed", "m/s", -1.0, 3.0, 0.0),
    Parameter("deceleration", "m/s^2", 0.0, 100.0, 20.0),
    Parameter("margin", "m", -0.01, 0.01, 0.0),
)
OPTIMA = np.array([[0.5, 70.0, 0.004], [2.5, 10.0, -0.008], [-0.9, 55.0, 0.0]])
SPANS = np.array([4.0, 100.0, 0.02])


def bowl(candidates):
    """Rosenbrock's valley around each optimum, in shares of the ranges."""
    x = 1.0 + (candidates - OPTIMA) / SPANS
    return np.sum(5.0 * (x[..., 1:] - x[..., :-1] ** 2) ** 2 + (1.0 - x[..., :-1]) ** 2, axis=-1)


def test_the_search_finds_a_known_optimum_of_each_problem():
    found = minimise(bowl, SPACE, problems=3, population=14, generations=200, seed=3)
    assert np.abs((found.parameters - OPTIMA) / SPANS).max() < 0.01
    assert found.loss == pytest.approx(bowl(found.parameters[None])[0], rel=1e-12, abs=1e-15)
    assert found.generations < 200


def test_an_optimum_beyond_the_limits_is_looked_for_at_the_limit():
    found = minimise(lambda x: np.sum((x / SPANS - 5.0) ** 2, axis=-1), SPACE, generations=80)
    assert found.parameters[0] == pytest.approx([3.0, 100.0, 0.01], rel=1e-3)
    assert (found.parameters[0] <= [3.0, 100.0, 0.01]).all()


def test_a_search_repeats_with_its_seed_and_leaves_the_global_generator_alone():
    np.random.seed(5)  # noqa: NPY002 - the one that must not matter
    state = np.random.get_state()[1].copy()  # noqa: NPY002
    one = minimise(bowl, SPACE, 3, generations=15, seed=1)
    assert np.array_equal(np.random.get_state()[1], state)  # noqa: NPY002
    np.random.seed(6)  # noqa: NPY002
    again, other = (minimise(bowl, SPACE, 3, generations=15, seed=seed) for seed in (1, 2))
    assert np.array_equal(one.parameters, again.parameters)
    assert not np.array_equal(one.parameters, other.parameters)


class Stopped(BaseException):
    """As if the process ended here."""


@pytest.fixture
def small(tmp_path, monkeypatch):
    monkeypatch.setattr(tuning, "ProcessPoolExecutor", lambda count, *spawned: ThreadPoolExecutor(1))
    effort = {"scenarios": 8, "budget": 24, "population": 8}
    return Tune(("linear-blind",), ("constant-speed",), (1.0, 4.0), **effort, processes=1, out=tmp_path)


def counted(monkeypatch, stop_at=None):
    """Return the weights that are tuned from now on; before the one `stop_at` the process ends."""
    begun, original = [], tuning.tune_one

    def tune_one(name, setup, weight, wanted):
        if weight == stop_at:
            raise Stopped
        begun.append(weight)
        return original(name, setup, weight, wanted)

    monkeypatch.setattr(tuning, "tune_one", tune_one)
    return begun


def test_tuning_that_was_stopped_goes_on_and_ends_as_if_it_had_not_been(small, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        counted(patch, stop_at=4.0)
        with pytest.raises(Stopped):
            tune(small)
    assert list(read_tuned("constant-speed", tmp_path)["weights"]) == ["1"]
    begun = counted(monkeypatch)
    (path,) = tune(small)
    assert begun == [4.0]
    whole = path.read_bytes()
    tune(small)
    assert begun == [4.0]
    path.unlink()
    tune(small)
    assert begun == [4.0, 1.0, 4.0]
    assert path.read_bytes() == whole
    for weight in (1.0, 4.0):
        found = json.loads(whole)["weights"][f"{weight:g}"]
        assert found["search"] == {"scenarios": 8, "budget": 24, "population": 8, "seed": 1}
        assert f"linear-blind --names constant-speed --weights {weight:g} --scenarios 8 --budget 24" in found["command"]
        rule = load_baseline("constant-speed", weight, tmp_path)
        assert isinstance(rule, ConstantSpeed)
        scores = tuning.scores("constant-speed", load_setup("linear-blind"), weight, rule.parameters)
        assert found["validation"] == scores


def test_what_was_tuned_otherwise_or_for_another_environment_is_tuned_anew(small, monkeypatch, capsys):
    tune(small)
    begun = counted(monkeypatch)
    other = replace(small, seed=9)
    tune(other)
    assert begun == [1.0, 4.0]
    assert "other settings" in capsys.readouterr().out
    heavier = replace(load_setup("linear-blind"), environment={"tool_mass": 0.2})
    monkeypatch.setattr(tuning, "load_setup", lambda name: heavier)
    tune(other)
    assert begun == [1.0, 4.0, 1.0, 4.0]
    assert "another environment" in capsys.readouterr().out


@pytest.mark.parametrize(("given", "message"), [
    ({"names": ("paper-trapezoid",)}, "no baseline 'paper-trapezoid' to tune"),
    ({"weights": (0.0,)}, "weights must be .*above 0"),
    ({"scenarios": 0}, "scenarios must be .*at least 1"),
    ({"population": 3}, "population must be .*at least 4"),
], ids=str)  # fmt: skip
def test_a_tuning_that_cannot_be_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        Tune(**given)
