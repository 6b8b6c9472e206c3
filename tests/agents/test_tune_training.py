"""The search for settings continues where it was, and the median of seeds stands for all."""

import json

import pytest
import tomli_w
from policies import made_up_policy
from training import tiny

from agents import load_setup, train_seeds, tune_training
from agents.setups import Training
from agents.train_seeds import median
from agents.tune_training import SPACE, Search


class Stopped(BaseException):
    """As if the process ended here."""


@pytest.fixture
def small(tmp_path):
    return Search(trials=3, steps=1024, validate_every=512, validation_scenarios=20, journals=tmp_path / "journals")


def test_search_continues_where_it_was_stopped_and_a_set_up_takes_its_best_settings(small, monkeypatch):
    started, original, start = [], tune_training.train, tiny().training

    def train(run, folder, on_validation):
        started.append(run)
        if len(started) == 2:
            raise Stopped
        return original(run, folder, on_validation)

    monkeypatch.setattr(tune_training, "train", train)
    with pytest.raises(Stopped):
        tune_training.search(small, start)
    path = tune_training.search(small, start)
    assert len({run.seed for run in started}) == len(started) == 4
    summary = json.loads(path.read_text())
    assert summary["command"].startswith("impact-gym tune-training linear-blind --trials 3 --steps 1024")
    trials = summary["trials"]
    assert [trial["number"] for trial in trials] == [0, 2, 3]
    assert trials[0]["parameters"]["learning_rate"] == start.learning_rate
    best = min((trial for trial in trials if trial["state"] == "complete"), key=lambda trial: trial["score"])
    assert summary["best"]["score"] == best["score"]
    own = small.journals.parent / "own.toml"
    own.write_text(tomli_w.dumps({"training": summary["best"]["settings"]}))
    assert load_setup(own).training == Training().changed(best["parameters"])
    assert tune_training.search(small, start) == path
    assert len(started) == 4
    assert sorted(file.suffix for file in small.journals.iterdir()) == [".journal", ".json"]


def test_search_gives_up_a_trial_that_falls_behind(tmp_path, monkeypatch):
    """Scores are made up: from the fifth trial on, each is worse than all before."""
    steps = []

    def train(run, folder, on_validation):
        folder.mkdir(parents=True)
        steps.append([])
        for step in range(512, run.training.steps + 1, 512):
            steps[-1].append(step)
            on_validation(step, {"score": float(len(steps))})

    monkeypatch.setattr(tune_training, "train", train)
    path = tune_training.search(Search(trials=6, steps=2048, validate_every=512, journals=tmp_path), tiny().training)
    summary = json.loads(path.read_text())
    assert [trial["state"] for trial in summary["trials"]] == ["complete"] * 4 + ["pruned"] * 2
    assert steps[-1] == [512, 1024]
    assert summary["best"]["number"] == 0


@pytest.mark.parametrize(("name", "distribution"), SPACE.items(), ids=list(SPACE))
def test_space_holds_settings(name, distribution):
    """Each end of each range, and each choice, is one that training takes."""
    for value in getattr(distribution, "choices", None) or (distribution.low, distribution.high):
        assert getattr(Training().changed({name: value}), name) == value


@pytest.mark.parametrize(("scores", "expected"), [
    ([0.3], 0.3), ([0.3, 0.1, 0.2], 0.2), ([0.4, 0.1, 0.2, 0.3], 0.3), ([0.2, 0.1], 0.2),
])  # fmt: skip
def test_median_is_in_the_middle_and_of_two_the_worse(scores, expected):
    policies = [made_up_policy() for _ in scores]
    for seed, (policy, score) in enumerate(zip(policies, scores, strict=True)):
        policy.provenance |= {"settings": {"seed": seed}, "validation": {"score": score}}
    assert train_seeds.score(median(policies)) == expected
