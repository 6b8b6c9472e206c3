"""Searches find known optima; tuning keeps its results, and repeats a search if its settings or task have changed."""

import json
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context

import numpy as np
import pytest
from episode_runs import Always
from refusal import refused

from agents import load_setup, tune
from agents.baselines import Clairvoyant, ConstantSpeed, LocalBrake, PaperTrapezoid
from agents.baselines.cmaes import Jittery, minimise
from agents.baselines.rule import Parameter
from agents.baselines.tuned import BOUND_SET, bound_of, load_baseline, read_bound, read_tuned, write_bound, write_tuned
from agents.evaluate.scenario_batch import TUNING_SEED, ScenarioBatch
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


def test_minimise_finds_the_optimum_of_each_problem_within_the_limits():
    result = minimise(bowl, SPACE, problems=3, population=14, generations=200, seed=3)
    assert np.abs((result.parameters - OPTIMA) / SPANS).max() < 0.01
    assert result.loss == pytest.approx(bowl(result.parameters[None])[0], rel=1e-12, abs=1e-15)
    assert result.generations < 200
    seen = list[np.ndarray]()
    few = minimise(lambda x: seen.append(bowl(x)) or seen[-1], SPACE, problems=3, generations=15)
    assert np.array_equal(few.loss, np.min(seen, axis=(0, 1)))  # the best of all generations, not of the last one
    beyond = minimise(lambda x: np.sum((x / SPANS - 5.0) ** 2, axis=-1), SPACE, generations=80).parameters[0]
    assert beyond == pytest.approx([3.0, 100.0, 0.01], rel=1e-3)
    assert (beyond <= [3.0, 100.0, 0.01]).all()


def test_minimise_depends_on_its_seed_and_not_on_the_global_generator():
    runs = []
    for seed, other in ((1, 5), (1, 6), (2, 5)):
        np.random.seed(other)  # noqa: NPY002 - the search must not use it
        state = np.random.get_state()[1].copy()  # noqa: NPY002
        runs.append(minimise(bowl, SPACE, 3, generations=15, seed=seed).parameters)
        assert np.array_equal(np.random.get_state()[1], state)  # noqa: NPY002
    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_jittery_adds_the_same_error_of_the_given_size_to_all_candidates_in_a_scenario():
    jittery = Jittery(Always(0.5, 10.5), 0.01, 5000, np.random.default_rng(1))
    first, second = (jittery.predict(np.zeros((3 * 5000, 8)))[0] for _ in range(2))
    assert np.array_equal(first[:5000], first[5000:10000])
    assert np.array_equal(first[:5000], first[10000:])
    assert np.abs(np.corrcoef(first[:5000, 0], second[:5000, 0])[0, 1]) < 4.0 / np.sqrt(5000)
    assert first[:5000].std() / 2.0 == pytest.approx(0.01, rel=0.04)  # the range is 2 wide


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
    return tune.Tune((str(path),), weights=(1.0, 4.0), processes=0, out=tmp_path, jobs=tmp_path / "jobs", **SEARCH)


def test_tune_searches_with_the_settings_of_the_set_up_and_records_them(noisy, tmp_path):
    (path,), setup = tune.tune(noisy), load_setup(noisy.setups[0])
    weights = read_tuned("noisy-speed", tmp_path, setup)["weights"]
    for weight in (1.0, 4.0):
        entry = weights[f"{weight:g}"]
        environment = {**setup.environment, **tune.CLEAN_ALARM}
        alone = tune.tune_one("ConstantSpeed", environment, weight, rtol=1e-6, jitter=0.02, **SEARCH)
        assert list(entry["parameters"].values()) == alone["parameters"]
        calm = tune.tune_one("ConstantSpeed", environment, weight, rtol=1e-6, jitter=0.0, **SEARCH)
        assert entry["train"] == alone["train"] != calm["train"]
        rule = ConstantSpeed.of(alone["parameters"]).for_task(Task(**environment))
        assert entry["validation"] == alone["validation"] == tune.scores(rule, weight)
        assert entry["search"] == {**SEARCH, "clean_alarm": True, "jitter": 0.02}
        assert f"--names noisy-speed --weights {weight} --scenarios 8 --budget 24" in entry["command"]
        assert isinstance(load_baseline("noisy-speed", weight, tmp_path), ConstantSpeed)
    assert json.loads(path.read_text())["environment"]["force_noise"] == 2.0


def test_tune_prefers_a_gentle_touch_to_a_miss_at_any_time_weight():
    """At 0.05 m/s per s, 1.2 s without a touch cost less than any impact, but a miss costs 2 m/s."""
    found = tune.tune_one("ConstantSpeed", {}, 0.05, 1e-5, 0.0, **SEARCH | {"scenarios": 20, "budget": 80})
    assert found["validation"]["missed"] == 0
    assert 0.05 * 1.2 < found["train"] < 2.0
    stage = ScenarioBatch(TUNING_SEED, 20, Task(rtol=1e-5))
    assert found["train"] == pytest.approx(stage.play(ConstantSpeed.of(found["parameters"])).loss(0.05).mean())


def test_baselines_use_the_whole_speed_and_acceleration_of_a_fast_arm():
    """If only time counts, the fastest approach is best; the brake is the arm's."""
    arm = {"velocity_range": [-0.5, 3.0], "acceleration_range": [1.0, 60.0]}
    found = tune.tune_one("ConstantSpeed", arm, 100.0, 1e-5, 0.0, **SEARCH | {"scenarios": 20, "budget": 160})
    assert found["parameters"][:2] == pytest.approx([3.0, 60.0], rel=0.05)
    assert LocalBrake().for_task(Task(**arm)).parameters.tolist() == [3.0, 60.0, 60.0]


def test_tune_keeps_finished_weights_and_reaches_the_same_result_after_a_stop(noisy, tmp_path):
    (path,) = tune.tune(noisy)
    whole, setup = path.read_bytes(), load_setup(noisy.setups[0])
    tune.tune(replace(noisy, out=tmp_path / "parts", jobs=tmp_path / "others", weights=(4.0,)))
    (parts,) = tune.tune(replace(noisy, out=tmp_path / "parts", jobs=tmp_path / "others"))
    assert parts.read_bytes() == whole
    weights = read_tuned("noisy-speed", tmp_path, setup)["weights"]
    weights["1"]["parameters"]["speed"] = 0.123  # no search finds this number
    write_tuned("noisy-speed", weights, setup, tmp_path)
    marked = path.read_bytes()
    tune.tune(noisy)
    assert path.read_bytes() == marked
    path.unlink()
    tune.tune(noisy)
    assert path.read_bytes() == whole


def test_parallel_tunings_keep_each_others_weights(noisy, tmp_path):
    each = [replace(noisy, weights=(weight,), jobs=tmp_path / f"jobs-{weight}") for weight in (0.5, 1.0, 2.0, 4.0)]
    with ProcessPoolExecutor(4, get_context("spawn")) as pool:
        list(pool.map(tune.tune, each))
    assert [*read_tuned("noisy-speed", tmp_path, load_setup(noisy.setups[0]))["weights"]] == ["0.5", "1", "2", "4"]


def test_tune_repeats_a_search_with_other_settings_or_another_environment(noisy, tmp_path, capsys):
    first = tune.tune(noisy)[0].read_bytes()
    path = tune.tune(replace(noisy, seed=9))[0]
    assert "the results at ['1', '4'] have other settings, and are not reused" in capsys.readouterr().out
    second = path.read_bytes()
    (tmp_path / "noisy.toml").write_text(NOISY.replace("[baselines", "tool_mass = 0.2\n[baselines"))
    tune.tune(replace(noisy, seed=9))
    assert "the environment in" in capsys.readouterr().out
    assert len({first, second, path.read_bytes()}) == 3


def test_tune_of_the_shipped_set_ups_searches_nothing():
    for name, setup in tune.Tune().baselines().items():
        options = tune.Tune((setup.called,))
        for found in read_tuned(name, options.folder(setup), setup)["weights"].values():
            assert found["search"] == options.search(name, setup)


def test_tune_uses_a_cluster_even_if_processes_are_given(noisy, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(RuntimeError, match="install the extra `cluster`"):
        tune.tune(replace(noisy, processes=2, cluster="ray"))


@pytest.mark.parametrize("weight", load_setup("linear-blind").evaluation.weights)
@pytest.mark.parametrize("name", ["linear-blind", "bistable-blind"])
def test_bound_is_below_every_shipped_baseline(name, weight):
    setup = load_setup(name)
    rule = Clairvoyant(bound_of(setup)[weight])
    count, of = len(rule.parameters), partial(ScenarioBatch.of, BOUND_SET, time_weight=[weight])
    known = of(count=count, task=setup.task.changed({"privileged": True})).play(rule).loss(weight)
    for baseline in setup.against:
        blind = of(count=count, task=setup.task).play(load_baseline(baseline, weight)).loss(weight)
        assert known.mean() < blind.mean()
        assert np.mean(known < blind) > 0.9  # in single scenarios a search may end in a local minimum


def test_search_bounds_beats_a_blind_profile_and_keeps_its_result(tmp_path):
    wanted = tune.Tune(("linear-blind",), weights=(1.0,), processes=0, out=tmp_path, jobs=tmp_path / "jobs")
    setup, size = load_setup("linear-blind"), {"scenarios": 4, "generations": 25}
    assert read_bound(setup, tmp_path) == {}
    (path,) = tune.search_bounds(wanted, **size)
    parameters = read_bound(setup, tmp_path, generations=25)[1.0]
    known = ScenarioBatch.of("test", 4, Task(privileged=True), time_weight=[1.0]).play(Clairvoyant(parameters))
    blind = ScenarioBatch.of("test", 4, time_weight=[1.0]).play(load_baseline("blind-profile", 1.0))
    assert not known.missed.any()
    assert known.loss(1.0).mean() < blind.loss(1.0).mean()
    fastest = np.sqrt(2 * known.scenario["distance"] / 20.0)  # s, at full acceleration
    assert (known.approach_time > fastest - 0.02).all()  # the tool may swing ahead of the flange
    write_bound(setup, {1.0: 0.5 * parameters}, tmp_path, generations=25)
    assert tune.search_bounds(wanted, **size) == [path]
    assert np.array_equal(read_bound(setup, tmp_path, 25)[1.0], 0.5 * parameters)  # it was not searched again
    write_bound(setup, {1.0: 0.5 * parameters}, tmp_path, generations=9)
    tune.search_bounds(wanted, **size)
    assert np.array_equal(read_bound(setup, tmp_path, 25)[1.0], parameters)


def test_read_bound_refuses_the_result_of_another_search(tmp_path):
    setup = load_setup("linear-blind")
    path = write_bound(setup, {2.0: np.zeros((3, 13))}, tmp_path)
    assert read_bound(setup, tmp_path)[2.0].shape == (3, 13)
    assert bound_of(setup, tmp_path) == {}  # the weights 0.7, 1 and 4 are missing
    refused(lambda: read_bound(setup, tmp_path, generations=2), "for another environment or other search settings")
    path.with_name("clairvoyant-rigid-blind.npz").write_bytes(path.read_bytes())
    refused(lambda: read_bound(load_setup("rigid-blind"), tmp_path), "for another environment")


@pytest.mark.parametrize("target", [0.12, 0.3, 0.31, 0.6])
@pytest.mark.parametrize("power", [0.1, 0.3, 0.6])
def test_tuned_times_enclose_the_time_of_the_rule_within_5_ms(target, power):
    times = {weight: 0.35 * weight**-power for weight in (0.7, 1.0, 2.0, 4.0)}
    for _ in range(tune.MOST_TRIED):
        if (weight := tune.next_weight(times, target)) is None:
            break
        times[weight] = 0.35 * weight**-power
    sooner, later = (np.array([time for time in times.values() if (time > target) == side]) for side in (False, True))
    in_reach = 0.35 * 32.0**-power <= target - tune.NEAR and target + tune.NEAR <= 0.35 * 0.125**-power
    if in_reach:
        assert target - sooner.max() <= tune.NEAR
        assert later.min() - target <= tune.NEAR
    assert in_reach or tune.next_weight(times, target) is None


def test_command_tunes_around_the_time_of_the_rule_if_asked(noisy, tmp_path):
    setup, gaps = load_setup(noisy.setups[0]), []
    rule = ScenarioBatch.of("validation", task=setup.task).play(PaperTrapezoid().for_task(setup.task))
    for asked in (False, True):
        tune.run(replace(noisy, at_rule_time=asked))
        found = read_tuned("noisy-speed", tmp_path, setup)["weights"].values()
        gaps.append([abs(each["validation"]["approach_time"] - rule.approach_time.mean()) for each in found])
    assert min(gaps[1]) < min(gaps[0])


def test_tuning_at_the_rules_time_ends_for_a_front_with_a_gap():
    times = {weight: 0.25 if weight > 0.3 else 0.45 for weight in (0.2, 0.7, 1.0, 2.0)}
    while (weight := tune.next_weight(times, 0.31)) is not None:
        times[weight] = 0.25 if weight > 0.3 else 0.45
    assert len(times) < 50
