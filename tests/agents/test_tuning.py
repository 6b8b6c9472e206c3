"""The search finds optima that are known, and tuning goes on where it was stopped."""

import json
import shutil
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from agents import tune as tuning
from agents.baselines import ConstantSpeed
from agents.baselines.cmaes import minimise
from agents.baselines.jittery import Jittery
from agents.baselines.rule import Parameter
from agents.baselines.tuned import load_baseline, read_tuned
from agents.jobs.job import resolve
from agents.setups import Tuned, load_setup
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


RESULT = {name: np.zeros(1) for name in ("train", "generations", "loss", "object_velocity", "approach_time", "missed")}
RESULT["parameters"] = np.array([0.5, 8.0, 8.0])


@pytest.fixture
def small(tmp_path):
    names, weights = ("constant-speed",), (1.0, 4.0)
    return Tune(
        ("linear-blind",),
        names,
        weights,
        scenarios=8,
        budget=24,
        population=8,
        processes=0,
        out=tmp_path,
        jobs=tmp_path / "jobs",
    )


@contextmanager
def counted(stop_at=None):
    """Give the weights that are tuned from now on; before the one `stop_at` the process ends."""
    begun, original = [], tuning.tune_one

    def tune_one(**arguments):
        if arguments["weight"] == stop_at:
            raise Stopped
        begun.append(arguments["weight"])
        return original(**arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tuning, "tune_one", tune_one)
        resolve.cache_clear()
        yield begun
    resolve.cache_clear()


def test_tuning_that_was_stopped_goes_on_and_ends_as_if_it_had_not_been(small, tmp_path):
    with counted(stop_at=4.0), pytest.raises(Stopped):
        tune(small)
    assert list(read_tuned("constant-speed", tmp_path)["weights"]) == ["1"]
    with counted() as begun:
        (path,) = tune(small)
        assert begun == [4.0]
        whole = path.read_bytes()
        tune(small)
        path.unlink()
        tune(small)  # from the finished searches
        assert begun == [4.0]
        shutil.rmtree(small.jobs)
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
        environment = load_setup("linear-blind").environment
        assert found["validation"] == tuning.scores("ConstantSpeed", environment, weight, rule.parameters)


def test_every_candidate_is_jostled_alike_in_the_same_scenario_and_by_as_much_as_is_said():
    class Still:
        def predict(self, observation, **arguments):
            return np.zeros((len(observation), 2)), "state"

    jittery = Jittery(Still(), 0.01, 5000, np.random.default_rng(1))
    first, state = jittery.predict(np.zeros((3 * 5000, 8)), deterministic=True)
    second, _ = jittery.predict(np.zeros((3 * 5000, 8)))
    assert state == "state"
    assert np.array_equal(first[:5000], first[5000:10000])
    assert np.array_equal(first[:5000], first[10000:])
    assert np.abs(np.corrcoef(first[:5000, 0], second[:5000, 0])[0, 1]) < 4.0 / np.sqrt(5000)
    assert first[:5000].std() / 2.0 == pytest.approx(0.01, rel=0.04)  # of a range that is 2 wide


def test_what_a_set_up_asks_of_a_search_reaches_it_and_is_kept(small, tmp_path, monkeypatch):
    given = []
    monkeypatch.setattr(tuning, "tune_one", lambda **arguments: given.append(arguments) or RESULT)
    resolve.cache_clear()
    plain = load_setup("linear-blind")
    noisy = {**plain.environment, "alarm": "reading", "force_noise": 2.0, "force_bias": 1.0}
    asked = replace(plain, environment=noisy, tuned={"constant-speed": Tuned("ConstantSpeed", 1e-6, True, 0.02)})
    monkeypatch.setattr(tuning, "load_setup", lambda name: asked)
    (path,) = tune(small)
    assert [one["jitter"] for one in given] == [0.02, 0.02]
    for one in given:
        assert one["environment"] == {**plain.environment, "alarm": "force", "force_noise": 0.0, "force_bias": 0.0}
    kept = json.loads(path.read_text())
    assert kept["environment"]["force_noise"] == 2.0
    assert kept["weights"]["1"]["search"] == {**small.search(asked), "told": True, "jitter": 0.02}
    tune(small)
    assert len(given) == 2
    calmer = replace(asked, tuned={"constant-speed": Tuned("ConstantSpeed", 1e-6, True, 0.01)})
    monkeypatch.setattr(tuning, "load_setup", lambda name: calmer)
    tune(small)
    assert len(given) == 4
    resolve.cache_clear()


def test_what_was_tuned_otherwise_or_for_another_environment_is_tuned_anew(small, monkeypatch, capsys):
    tune(small)
    with counted() as begun:
        tune(replace(small, seed=9))
        assert begun == [1.0, 4.0]
        assert "other settings" in capsys.readouterr().out
        heavier = replace(load_setup("linear-blind"), environment={"tool_mass": 0.2})
        monkeypatch.setattr(tuning, "load_setup", lambda name: heavier)
        tune(replace(small, seed=9))
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
