"""Searches find known optima; tuning keeps its results, and repeats a search if its settings or task have changed."""

from dataclasses import replace
from functools import wraps

import numpy as np
import pytest
from refusal import refused

from agents import load_setup, tune
from agents.baselines import Clairvoyant, ConstantSpeed, PaperTrapezoid, tuned_rule
from agents.baselines.cmaes import minimise
from agents.baselines.rule import Parameter
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.setups import tuned
from agents.setups.tuned import BOUND_SET, bound_of, load_baseline, read_bound, read_tuned, write_bound
from impact_gym.support.files import locked
from impact_gym.task import Task

SPACE = (
    Parameter("speed", "m/s", -1.0, 3.0, 0.0), Parameter("deceleration", "m/s^2", 0.0, 100.0, 20.0),
    Parameter("margin", "m", -0.01, 0.01, 0.0),
)  # fmt: skip
OPTIMA = np.array([[0.5, 70.0, 0.004], [2.5, 10.0, -0.008], [-0.9, 55.0, 0.0]])
SPANS = np.array([4.0, 100.0, 0.02])


def bowl(candidates):
    """Return Rosenbrock's function around each optimum, with each parameter over its range."""
    x = 1.0 + (candidates - OPTIMA) / SPANS
    return np.sum(5.0 * (x[..., 1:] - x[..., :-1] ** 2) ** 2 + (1.0 - x[..., :-1]) ** 2, axis=-1)


def test_minimise_finds_the_optimum_of_each_problem_in_limits():
    result, other = (minimise(bowl, SPACE, 3, population=12, generations=150, seed=seed) for seed in (3, 4))
    assert not np.array_equal(result.parameters, other.parameters)
    assert np.abs((result.parameters - OPTIMA) / SPANS).max() < 0.01
    assert result.loss == pytest.approx(bowl(result.parameters[None])[0], rel=1e-12, abs=1e-15)
    assert result.generations < 150
    seen = list[np.ndarray]()
    few = minimise(lambda x: seen.append(bowl(x)) or seen[-1], SPACE, problems=3, generations=15)
    assert np.array_equal(few.loss, np.min(seen, axis=(0, 1)))  # the best of all generations, not of the last one
    beyond = minimise(lambda x: np.sum((x / SPANS - 5.0) ** 2, axis=-1), SPACE, generations=60).parameters[0]
    assert beyond == pytest.approx([3.0, 100.0, 0.01], rel=1e-3)
    assert (beyond <= [3.0, 100.0, 0.01]).all()


NOISY = """[environment]
alarm = "reading"
force_noise = 2.0
force_bias = 1.0
[baselines.tuned]
noisy-speed = { rule = "ConstantSpeed", rtol = 1e-6, clean_alarm = true, jitter = 0.02 }
"""
SEARCH = {"scenarios": 8, "budget": 24, "population": 8, "seed": 1}


@pytest.fixture
def noisy(tmp_path):
    """Options to tune two weights in this process; the set-up's baseline has all options."""
    path = tmp_path / "noisy.toml"
    path.write_text(NOISY)
    where = {"processes": 0, "out": tmp_path, "jobs": tmp_path / "jobs"}
    return tune.Tune((str(path),), ("noisy-speed",), (1.0, 4.0), **where, **SEARCH)


def weights_of(options):
    return read_tuned("noisy-speed", options.out, load_setup(options.setups[0]))["weights"]


def test_tune_uses_and_records_the_settings_of_the_set_up(noisy):
    tune.tune(noisy)
    setup = load_setup(noisy.setups[0])
    for weight in (1.0, 4.0):
        entry, environment = weights_of(noisy)[f"{weight:g}"], {**setup.environment, **tune.CLEAN_ALARM}
        alone = tune.tune_one("ConstantSpeed", environment, weight, rtol=1e-6, jitter=0.02, **SEARCH)
        assert list(entry["parameters"].values()) == alone["parameters"]
        calm = tune.tune_one("ConstantSpeed", environment, weight, rtol=1e-6, jitter=0.0, **SEARCH)
        assert entry["train"] == alone["train"] != calm["train"]
        rule = ConstantSpeed.of(alone["parameters"]).for_task(Task(**environment))
        assert entry["validation"] == alone["validation"] == tune.scores(rule, weight)
        assert entry["search"] == {**SEARCH, "clean_alarm": True, "jitter": 0.02}
        assert f"--names noisy-speed --weights {weight} --scenarios 8 --budget 24" in entry["command"]


def test_simple_rival_is_tuned_with_half_the_candidates(noisy):
    """Its command, with the same options, tunes it again with as many."""
    (path,) = tune.tune(replace(noisy, names=("noisy-threshold",), weights=(1.0,)))
    entry = read_tuned(path.stem, noisy.out, load_setup(noisy.setups[0]))["weights"]["1"]
    assert entry["search"] == {**SEARCH, "budget": 12}
    assert "--budget 24" in entry["command"]


def test_stopped_tuning_keeps_weights_and_reaches_the_same_file(noisy, tmp_path):
    (path,), setup = tune.tune(noisy), load_setup(noisy.setups[0])
    weights, parts = weights_of(noisy), replace(noisy, out=tmp_path / "parts")
    for some in ((4.0,), (1.0, 4.0)):
        (other,) = tune.tune(replace(parts, jobs=tmp_path / "others", weights=some))
    assert other.read_bytes() == path.read_bytes()
    weights["1"]["parameters"]["speed"] = 0.123  # no search finds this number
    marked = tuned.write_tuned("noisy-speed", weights, setup, tmp_path).read_bytes()
    tune.tune(noisy)
    assert path.read_bytes() == marked


def test_tuning_keeps_weights_that_another_one_wrote_meanwhile(noisy, monkeypatch):
    """It reads, merges and writes while it holds the lock."""
    search, seen = tune.tune_one, []

    def watched(function):
        def watching(*given):
            refused(lambda: locked(noisy.out / tune.LOCK, wait=False).__enter__(), "another process")
            seen.append(function.__name__)
            return function(*given)

        return watching

    @wraps(search)
    def meanwhile(**arguments):
        monkeypatch.undo()
        tune.tune(replace(noisy, weights=(10.0, 2.0), jobs=noisy.jobs / "others"))
        for function in (tuned.read_tuned, tuned.write_tuned):
            monkeypatch.setattr(tuned, function.__name__, watched(function))
        return search(**arguments)

    monkeypatch.setattr(tune, "tune_one", meanwhile)
    tune.tune(replace(noisy, weights=(1.0,)))
    assert seen == ["read_tuned", "write_tuned"]
    assert [*weights_of(noisy)] == ["1", "2", "10"]


def test_tune_repeats_a_search_if_anything_else_has_changed(noisy, tmp_path, monkeypatch):
    """Settings, the task, or the sources on which the stored results of searches depend."""
    contents = [tune.tune(noisy)[0].read_bytes(), tune.tune(replace(noisy, seed=9))[0].read_bytes()]
    (tmp_path / "noisy.toml").write_text(NOISY.replace("[baselines", "tool_mass = 0.2\n[baselines"))
    (path,) = tune.tune(replace(noisy, seed=9))
    assert len({*contents, path.read_bytes()}) == 3
    path.unlink()
    asked, stored = [], len([*noisy.jobs.iterdir()])
    monkeypatch.setattr(tune, "digest_of", lambda *names: asked.extend(names) or "another digest")
    tune.tune(replace(noisy, seed=9))
    assert len([*noisy.jobs.iterdir()]) == stored + 2
    assert {"impact_gym", "agents.baselines", "agents.evaluate", "agents.tune"} <= {*asked}


@pytest.mark.parametrize("name", ["linear-blind", "bistable-blind"])
def test_bound_is_below_every_shipped_baseline(name):
    setup = load_setup(name)
    bound, weights = bound_of(setup), setup.evaluation.weights
    count = len(bound[weights[0]])
    every, options = np.repeat(weights, count), {"copies": len(weights), "time_weight": weights}

    def losses(rule, task):
        return ScenarioBatch.of(BOUND_SET, count, task, **options).play(rule).loss(every).reshape(len(weights), -1)

    rule = Clairvoyant(np.concatenate([bound[weight] for weight in weights]))
    known = losses(rule, setup.task.changed({"privileged": True}))
    for baseline in setup.against:
        blind = losses(tuned_rule(read_tuned(baseline)).at(every).for_task(setup.task), setup.task)
        assert (known.mean(axis=1) < blind.mean(axis=1)).all()
        assert (np.mean(known < blind, axis=1) > 0.9).all()  # in a scenario a search may end in a local minimum


def test_search_bounds_beats_a_blind_profile_and_is_kept(tmp_path):
    """Unless its file is of another search or another environment."""
    wanted = tune.Tune(("linear-blind",), weights=(1.0,), processes=0, out=tmp_path)
    setup, size = load_setup("linear-blind"), {"scenarios": 4, "generations": 25}
    (path,) = tune.search_bounds(wanted, **size)
    assert any((tmp_path / "searches").iterdir())
    parameters = read_bound(setup, tmp_path, generations=25)[1.0]
    known = ScenarioBatch.of("test", 4, Task(privileged=True), time_weight=[1.0]).play(Clairvoyant(parameters))
    blind = ScenarioBatch.of("test", 4, time_weight=[1.0]).play(load_baseline("blind-profile", 1.0))
    assert known.loss(1.0).mean() < blind.loss(1.0).mean()
    for written, found in ((25, 0.5 * parameters), (9, parameters)):
        write_bound(setup, {1.0: 0.5 * parameters}, tmp_path, generations=written)
        assert tune.search_bounds(wanted, **size) == [path]
        assert np.array_equal(read_bound(setup, tmp_path, 25)[1.0], found)
    path.rename(path.with_name("clairvoyant-rigid-blind.npz"))
    refused(lambda: read_bound(load_setup("rigid-blind"), tmp_path, 25), "for another environment")


@pytest.mark.parametrize("target", [0.12, 0.3, 0.31, 0.6])
@pytest.mark.parametrize("power", [0.1, 0.3, 0.6])
def test_tuned_times_enclose_the_time_of_the_rule(target, power):
    """Within 5 ms, after at most eight more weights, if the time is in reach."""
    times = {weight: 0.35 * weight**-power for weight in (0.7, 1.0, 2.0, 4.0)}
    while (weight := tune.next_weight(times, target)) is not None:
        times[weight] = 0.35 * weight**-power
    assert len(times) <= 4 + tune.MOST_TRIED
    if 0.35 * 32.0**-power <= target - tune.NEAR <= target + tune.NEAR <= 0.35 * 0.125**-power:
        off = target - np.array([*times.values()])
        assert off[off >= 0.0].min() <= tune.NEAR >= -off[off < 0.0].max()


def test_command_tunes_around_the_time_of_the_rule_if_asked(noisy):
    setup, gaps = load_setup(noisy.setups[0]), []
    rule = ScenarioBatch.of("validation", task=setup.task).play(PaperTrapezoid().for_task(setup.task))
    for asked in (False, True):
        tune.run(replace(noisy, at_rule_time=asked))
        gaps.append([abs(each["validation"]["approach_time"] - rule.approach_time.mean())
                     for each in weights_of(noisy).values()])  # fmt: skip
    assert min(gaps[1]) < min(gaps[0])
