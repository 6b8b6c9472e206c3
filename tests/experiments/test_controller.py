"""From a set-up of one's own to its controller and its report: what is left there is its own."""

import json
import sys

import pytest
from own_set_up import change, own_set_up
from policies import made_up_policy

from agents import load_setup
from agents.policies import load_ensemble
from experiments import controller
from experiments.controller import copy_setup
from experiments.report import matchups
from experiments.report.__main__ import ReportOptions, matchups_of


def test_copy_setup_keeps_a_folder_for_its_set_up(mine, tmp_path):
    out = tmp_path / "out"
    copy = copy_setup(load_setup(mine), out)
    assert copy.read_bytes() == mine.read_bytes()
    assert copy_setup(load_setup(mine), out) == copy
    change(mine, "A slow arm", "A slower arm")
    assert "slower" in copy_setup(load_setup(mine), out).read_text()
    with pytest.raises(ValueError, match="holds the whole: name another folder"):
        copy_setup(load_setup(mine), out, quick=True)
    change(mine, "0.7", "0.8")
    with pytest.raises(ValueError, match=r"mine\.toml as it was.*name another folder"):
        copy_setup(load_setup(mine), out)
    with pytest.raises(ValueError, match=r"holds something else \(mine\.toml\)"):
        copy_setup(load_setup("linear-blind"), out)
    assert "0.7" in copy.read_text()
    with pytest.raises(ValueError, match="is no folder"):
        copy_setup(load_setup(mine), mine)


@pytest.mark.storm
def test_controller_goes_from_a_file_to_a_controller_and_keeps_what_is_done(mine, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    monkeypatch.setattr(sys, "argv", ["controller", str(mine), "--out", str(out), "--quick"])
    controller.main()
    for path in ("tuned/mine-profile.json", "policies/mine.npz", "report/index.html", "export/mine.h"):
        assert (out / path).is_file(), path
    weights = json.loads((out / "tuned" / "mine-profile.json").read_text())["weights"]
    assert {entry["search"]["budget"] for entry in weights.values()} == {16}  # no more than the set-up says
    ensemble = load_ensemble(out / "policies" / "mine.npz")
    assert len(ensemble.policies) == 2
    assert load_setup(mine).describes(ensemble[None].environment)
    matchup = matchups.of_setup(load_setup(out / "mine.toml"), {"set": "test", "count": 30}, out)
    assert matchup.scenarios["ranges"]["object_mass"] == [0.2, 1.0]
    assert [baseline.name for baseline in matchup.baselines] == ["paper's rule", "mine-profile"]
    first = (out / "policies" / "mine.npz").read_bytes()
    capsys.readouterr()
    controller.main()
    assert (out / "policies" / "mine.npz").read_bytes() == first
    assert "training for" not in capsys.readouterr().out


def test_quick_look_note_says_what_is_less_than_a_set_up_wants(mine):
    setup, search = load_setup(mine), {"weights": {"2": {"search": {"budget": 8}}}}
    contestant = matchups.Contestant("mine-profile", {"tuned": search}, (2.0,), "")
    assert matchups.quick_look_note(setup, {"settings": {"steps": 2000}}, []) == ""
    note = matchups.quick_look_note(setup, {"settings": {"steps": 500}}, [contestant])
    assert note == "; A QUICK LOOK, trained for 500 steps of 2,000, baselines tuned with 8 candidates of 16"


def test_matchups_of_refuses_two_set_ups_of_one_name(mine, tmp_path):
    (tmp_path / "there").mkdir()
    other = own_set_up(tmp_path / "there")
    with pytest.raises(ValueError, match="the same name"):
        matchups_of(ReportOptions(setups=(str(mine), str(other))))


def test_matchups_of_setup_refuses_policies_of_another_arm(mine, tmp_path):
    made_up_policy(environment={"range_noise": 0.01}).save(tmp_path / "policies" / "mine.npz")
    with pytest.raises(ValueError, match=r"mine\.npz was trained for another environment than .*mine\.toml"):
        matchups.of_setup(load_setup(mine), {"set": "test", "count": 5}, tmp_path)


@pytest.mark.parametrize(("options", "scenarios"), [
    ({}, {"set": "test", "count": 2000}),
    ({"count": 7}, {"set": "test", "count": 7}),
    ({"scenarios": "hard", "count": 7}, {"set": "hard", "count": 7}),
])  # fmt: skip
def test_matchups_of_plays_the_set_of_the_set_up_unless_another_is_named(options, scenarios):
    (matchup,) = matchups_of(ReportOptions(setups=("rigid-blind",), **options))
    assert dict(matchup.scenarios) == scenarios
    assert matchup.evaluation == load_setup("rigid-blind").evaluation
