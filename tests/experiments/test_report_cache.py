"""What a report is made from: it is made anew where that changed, and what it recommends is what is exported."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from made_up_comparison import played
from refusal import refused

from agents.setups import load_setup
from agents.setups.evaluation import Evaluation
from experiments.controller import ControllerOptions, copy_setup, exporting, stages
from experiments.lab import grid, study
from experiments.lab.parts import Section
from experiments.report import __main__ as report
from experiments.report import comparisons, episodes, page
from experiments.report.comparisons import PAPER, Contestant
from impact_gym.support import provenance
from impact_gym.support.files import locked

ROOT = Path(__file__).parents[2]
EPISODES = ("agents/evaluate/specs.py", "agents/baselines/profile.py", "agents/policies/networks.py", "mine.py",
            "impact_gym/task/task.py", "experiments/report/episodes.py", "experiments/lab/grid.py")  # fmt: skip
PAGE = ("experiments/report/choice.py", "experiments/lab/statistics.py", "agents/setups/linear-blind.toml")


@pytest.fixture
def source(tmp_path, monkeypatch):
    """Let digests read a copy of the sources; return a function from a file's name to the file in the copy."""
    copy, without = tmp_path / "sources", shutil.ignore_patterns("*.npz", "*.so", "*.csv", "__pycache__")
    for name in ("impact_gym", "agents", "experiments"):
        shutil.copytree(ROOT / name, copy / name, copy_function=os.symlink, ignore=without)
    (copy / "mine.py").touch()

    def origin_of(name):
        path = copy.joinpath(*name.split("."))
        return path if path.is_dir() else path.with_suffix(".py")

    monkeypatch.setattr(provenance, "origin_of", origin_of)
    return copy.joinpath


@pytest.fixture
def made(source, tmp_path, monkeypatch):
    """A function that writes a report without playing: folder and digest of the episodes; None if it is up to date."""
    asked, usual, own = [], played().comparison, Contestant("mine:rule", {"object": "mine:rule"}, (2.0,), "")
    usual = replace(usual, scenarios={"set": "test", "count": 9}, baselines=(*usual.baselines, own))

    def cached(_, arguments, folder, *, depends, **__):
        refused(lambda: locked(tmp_path / "out" / study.LOCK_FILE, wait=False).__enter__(), "is being written")
        folder.mkdir(parents=True, exist_ok=True)
        asked.append((folder, depends))
        return [[{"episode": 0}]] * len(arguments)

    def made(changes=None, own=False, **options):
        asked.clear()
        what = report.study_of([replace(usual, **(changes or {}))], own)
        study.run(what, study.StudyOptions(tmp_path / "out", **options), "")
        return asked[0] if asked else None

    monkeypatch.setattr(page, "analyse", lambda *_: study.Findings("", [Section("Nothing", [])]))
    monkeypatch.setattr(study, "cached", cached)
    return made


def test_report_is_made_anew_where_its_input_changed(made, tmp_path):
    first, seed = made(), Contestant("seed-0", {"policy": "other"}, (1.0, 2.0), "")
    for changes in ({"scenarios": {"set": "test", "count": 8}}, {"seeds": (seed,)}, {"environment": {"rtol": 1e-9}},
                    {"evaluation": Evaluation(weights=(1.0,))}, {"title": "Other"}):  # fmt: skip
        assert (made(changes), made(changes), made()) == (first, None, first), changes
    assert (made(own=True), made(), made(force=True)) == (first,) * 3
    for lost in ("index.html", "results.json"):  # as where it was killed
        (tmp_path / "out" / lost).unlink()
        assert (made(), made()) == (first, None)


def test_report_is_made_anew_where_its_sources_changed(made, source, monkeypatch):
    before = made()
    for name in (*EPISODES, *PAGE):
        text = source(name).read_text()
        source(name).unlink()
        source(name).write_text(f"{text}\n")
        now = made()
        assert now, name
        assert (now != before) == (name in EPISODES), name  # only episodes that depend on it are played again
        assert [*now[0].parent.iterdir()] == [now[0]]  # those of other sources are gone
        before = now
    monkeypatch.setattr(study, "compiled_from", lambda: "other")
    assert made()[0] != before[0]


@pytest.mark.filterwarnings("ignore:the policy was trained for another environment")  # once in a process
def test_weight_at_rule_time_gives_the_rules_mean_time():
    """Where the weight is found it is met and not exceeded; in other scenarios, nearly."""
    arm = {"velocity_range": [-0.2, 1.2], "acceleration_range": [1.0, 10.0]}
    scenarios = {"set": "test", "count": 200}
    elsewhere = episodes.selection_scenarios(scenarios, episodes.CALIBRATION_SCENARIOS)
    policy, rule = comparisons.of_setup(load_setup("linear-blind"), scenarios).policy, {"baseline": "paper-trapezoid"}
    assert (policy.weights[0], policy.weights[-1]) == load_setup("linear-blind").training.time_weight
    weight = episodes.weight_at_rule_time(policy.controller, arm, scenarios, policy.weights)
    ours, late = (grid.play(policy.controller, arm, each, [weight]) for each in (elsewhere, scenarios))
    chosen, other = (grid.play(rule, arm, each, [2.0]) for each in (elsewhere, scenarios))
    assert ours["approach_time"].mean() == pytest.approx(chosen["approach_time"].mean(), abs=1e-3)
    assert ours["approach_time"].mean() <= chosen["approach_time"].mean()
    assert late["approach_time"].mean() == pytest.approx(other["approach_time"].mean(), rel=0.03)


def test_recommended_controller_is_exported_for_the_users_arm(mine, tmp_path):
    out = tmp_path / "out"
    options = ControllerOptions(str(mine), out, time_weight=3.0)
    copy = copy_setup(load_setup(mine), out)
    (out / "report").mkdir()
    for best, source in (
        (PAPER, "paper-trapezoid"), ("mine-profile", out / "tuned" / "mine-profile.json"),
        ("seed-1", out / "policies" / "mine.npz"), ("local-brake", "local-brake"),
    ):  # fmt: skip
        numbers = {"choices": {"mine": {"controller": best}}}
        (out / "report" / "results.json").write_text(json.dumps({"runs": [{"numbers": numbers}]}))
        found = exporting(copy, options)
        assert (found.controller, found.setup) == (str(source), None if best == "seed-1" else str(copy))
    (_, tuning), (_, training), (_, page) = stages(copy, options).values()
    assert (training.seeds, training.out, training.policies) == (2, out / "runs", out / "policies")
    assert (tuning.weights, page.time_weight) == ((1.0, 3.0, 4.0), 3.0)
