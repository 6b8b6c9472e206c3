"""The bound that knows each scenario: what is shipped, and what a search leaves behind."""

import numpy as np
import pytest

from agents import tune
from agents.baselines import Clairvoyant, bound
from agents.baselines.tuned import load_baseline
from agents.evaluate import Stage
from agents.jobs.job import resolve
from agents.setups import load_setup


@pytest.mark.parametrize("weight", load_setup("linear-blind").evaluation.weights)
@pytest.mark.parametrize("name", ["linear-blind", "bistable-blind"])
def test_the_shipped_bound_is_below_every_baseline(name, weight):
    setup = load_setup(name)
    rule = Clairvoyant(bound.bound_of(setup)[weight])
    count, options = len(rule.parameters), {"time_weight": [weight], **setup.environment}
    known = Stage.of(bound.FROZEN, count, privileged=True, **options).play(rule).loss(weight)
    for baseline in setup.against:
        blind = Stage.of(bound.FROZEN, count, **options).play(load_baseline(baseline, weight)).loss(weight)
        assert known.mean() < blind.mean()
        assert np.mean(known < blind) > 0.9  # in single scenarios a search may end in the wrong valley


def test_knowing_the_scenario_is_worth_something():
    found = tune.search_bound({}, 1.0, scenarios=6, generations=25, population=10)["parameters"]
    bound = Stage.of("test", 6, time_weight=[1.0], privileged=True).play(Clairvoyant(found))
    tuned = Stage.of("test", 6, time_weight=[1.0]).play(load_baseline("blind-profile", 1.0))
    assert all(np.array_equal(bound.scenario[name], tuned.scenario[name]) for name in tuned.scenario)
    assert not bound.missed.any()
    assert bound.loss(1.0).mean() < tuned.loss(1.0).mean()
    fastest = np.sqrt(2 * bound.scenario["distance"] / 20.0)  # at full acceleration all the way
    assert (bound.approach_time > fastest - 0.02).all()  # the tool may swing ahead of the flange


@pytest.fixture
def wanted(tmp_path, monkeypatch):
    """A small search of two weights, in this process."""
    original = tune.search_bound
    monkeypatch.setattr(tune, "search_bound", lambda **given: original(**given, scenarios=3, generations=2))
    resolve.cache_clear()
    yield tune.Tune(("linear-blind",), weights=(1.0, 2.0), processes=0, out=tmp_path, jobs=tmp_path / "jobs")
    resolve.cache_clear()


def test_a_search_is_done_once_and_kept(wanted, tmp_path, monkeypatch):
    (path,) = tune.search_bounds(wanted)
    first, setup = path.read_bytes(), load_setup("linear-blind")
    monkeypatch.setattr(bound, "write_archive", None)  # it would fail, were anything written
    assert tune.search_bounds(wanted) == [path]
    assert path.read_bytes() == first
    found = bound.read_bound(setup, tmp_path)
    assert {weight: one.shape for weight, one in found.items()} == {1.0: (3, 13), 2.0: (3, 13)}
    assert bound.bound_of(setup, tmp_path) == {}  # which has no 0.7 and no 4


def test_a_bound_that_is_missing_damaged_or_anothers_is_refused(wanted, tmp_path):
    setup = load_setup("linear-blind")
    with pytest.raises(ValueError, match=r"was not searched.*agents.tune linear-blind --bound"):
        bound.read_bound(setup, tmp_path)
    (path,) = tune.search_bounds(wanted)
    whole = path.read_bytes()
    path.write_bytes(whole[:-100])
    with pytest.raises(ValueError, match="damaged"):
        bound.read_bound(setup, tmp_path)
    path.with_name("clairvoyant-rigid-blind.npz").write_bytes(whole)
    with pytest.raises(ValueError, match="for another environment"):
        bound.read_bound(load_setup("rigid-blind"), tmp_path)
