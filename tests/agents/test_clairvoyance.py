"""The bound that knows each scenario: what is shipped, and what a search leaves behind."""

import numpy as np
import pytest

from agents import clairvoyance
from agents.baselines.tuned import TUNED, load_baseline
from agents.clairvoyance import FROZEN, SETUPS, Wanted, load_clairvoyant, search_all
from agents.evaluation import Stage
from agents.setups import load_setup
from agents.validation import WEIGHTS


@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.parametrize("setup", SETUPS)
def test_the_shipped_bound_is_below_every_baseline(setup, weight):
    if not (TUNED / f"clairvoyant-{setup}.npz").is_file():
        pytest.skip("not searched yet: make tune")
    bound = load_clairvoyant(setup, weight)
    count, options = len(bound.parameters), {"time_weight": [weight], **load_setup(setup).environment}
    known = Stage.of(FROZEN, count, privileged=True, **options).play(bound).loss(weight)
    for name in load_setup(setup).against:
        blind = Stage.of(FROZEN, count, **options).play(load_baseline(name, weight)).loss(weight)
        assert known.mean() < blind.mean()
        assert np.mean(known < blind) > 0.9  # in single scenarios a search may end in the wrong valley


def test_a_search_goes_on_where_it_was_and_a_damaged_one_is_refused(tmp_path, monkeypatch):
    wanted = Wanted(("linear-blind",), scenarios=3, generations=2, processes=1, out=tmp_path)
    (path,) = search_all(wanted)
    first = path.read_bytes()
    monkeypatch.setattr(clairvoyance, "write_archive", None)  # it would fail, were anything written
    search_all(wanted)
    assert path.read_bytes() == first
    shape = load_clairvoyant("linear-blind", 2.0, tmp_path).parameters.shape
    assert shape == (3, len(clairvoyance.Clairvoyant.PARAMETERS))
    with pytest.raises(ValueError, match=r"was not searched.*agents.clairvoyance"):
        load_clairvoyant("linear-blind", 3.0, tmp_path)
    path.write_bytes(first[:-100])
    with pytest.raises(ValueError, match="damaged"):
        load_clairvoyant("linear-blind", 2.0, tmp_path)
