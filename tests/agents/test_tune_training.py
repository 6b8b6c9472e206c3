"""The search for settings and the training of many seeds go on where they were."""

import json
import shutil

import pytest
from training import tiny

from agents import train_seeds, tune_training
from agents.policies.policy import load_policy
from agents.train.settings import default_settings, with_changes
from agents.train_seeds import Seeds, median, train_all
from agents.tune_training import SPACE, Search


class Stopped(BaseException):
    """As if the process ended here."""


@pytest.fixture
def small(tmp_path, monkeypatch):
    monkeypatch.setattr(tune_training, "default_settings", lambda setup: tiny(setup=setup))
    folders = {"journals": tmp_path / "journals", "summaries": tmp_path / "studies"}
    return Search(trials=3, steps=1024, validate_every=512, validation_scenarios=20, **folders)


def test_a_search_that_was_stopped_goes_on_and_a_set_up_takes_what_it_found(small, monkeypatch):
    started, original = [], tune_training.train

    def train(chosen, told):
        started.append(chosen)
        if len(started) == 2:
            raise Stopped
        return original(chosen, told)

    monkeypatch.setattr(tune_training, "train", train)
    with pytest.raises(Stopped):
        tune_training.search(small)
    path = tune_training.search(small)
    assert len(started) == 4
    assert len({str(one) for one in started}) == 4
    summary = json.loads(path.read_text())
    assert "agents.tune_training" in summary["command"]
    trials = summary["trials"]
    assert [trial["number"] for trial in trials] == [0, 2, 3]
    first = trials[0]["parameters"]
    assert first["learning_rate"] == tiny().learning_rate
    assert first["gae_lambda"] == tiny().gae_lambda
    complete = [trial for trial in trials if trial["state"] == "complete"]
    best = min(complete, key=lambda trial: trial["score"])
    assert summary["best"]["score"] == best["score"]
    own = small.journals.parent / "own.toml"
    own.write_text(tune_training.training_table(summary["best"]["settings"]))
    found = default_settings(str(own))
    assert found.learning_rate == best["parameters"]["learning_rate"]
    assert found.epochs == best["parameters"]["epochs"]
    assert found.setup == str(own)
    assert tune_training.search(small) == path
    assert len(started) == 4
    assert [file.suffix for file in small.journals.iterdir()] == [".journal"]


def test_a_trial_that_falls_behind_is_given_up(small, monkeypatch):
    """Scores are made up: from the fifth trial on, each is worse than all before."""
    steps = []

    def train(chosen, told):
        chosen.out.mkdir(parents=True)
        steps.append([])
        for step in range(512, chosen.steps + 1, 512):
            steps[-1].append(step)
            told(step, {"score": float(len(steps))})
        return chosen.out

    monkeypatch.setattr(tune_training, "train", train)
    summary = json.loads(tune_training.search(with_changes(small, {"trials": 6, "steps": 2048})).read_text())
    assert [trial["state"] for trial in summary["trials"]] == ["complete"] * 4 + ["pruned"] * 2
    assert steps[-1] == [512, 1024]
    assert summary["best"]["number"] == 0


def test_what_is_searched_are_settings():
    """Each end of each range, and each choice, is one that training takes."""
    start = default_settings("linear-blind")
    for name, distribution in SPACE.items():
        ends = getattr(distribution, "choices", None) or (distribution.low, distribution.high)
        taken = [getattr(with_changes(start, {name: value}), name) for value in ends]
        assert taken == list(ends)


def test_all_seeds_are_trained_once_the_median_is_shipped_and_a_lost_run_folder_filled_again(tmp_path, monkeypatch):
    wanted = Seeds(seeds=3, processes=2, runs=tmp_path / "runs", policies=tmp_path / "policies")
    short = tiny(steps=512)
    shipped = train_all("linear-blind", wanted, short)
    assert shipped == tmp_path / "policies" / "linear-blind.npz"
    record = json.loads((tmp_path / "policies" / "linear-blind" / "seeds.json").read_text())
    scores = {row["seed"]: row["score"] for row in record["seeds"]}
    assert sorted(scores) == [0, 1, 2]
    assert sorted(scores, key=scores.get)[1] == record["median"]
    for seed in scores:
        policy = load_policy(tmp_path / "policies" / "linear-blind" / f"seed-{seed}.npz")
        assert policy.provenance["settings"]["seed"] == seed
        assert policy.provenance["validation"]["score"] == scores[seed]
    assert load_policy(shipped).provenance["settings"]["seed"] == record["median"]

    folder, before = tmp_path / "runs" / "linear-blind" / "seed-0", shipped.read_bytes()
    trained = {name: (folder / name).read_bytes() for name in train_seeds.KEPT.values()}
    shutil.rmtree(folder)
    monkeypatch.setattr(train_seeds, "train", None)  # which nobody calls again
    assert train_all("linear-blind", wanted, short) == shipped
    assert shipped.read_bytes() == before
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == trained
    with pytest.raises(ValueError, match="trained with other settings"):
        train_all("linear-blind", wanted, tiny(steps=512, width=24))


@pytest.mark.parametrize(("scores", "expected"), [
    ([0.3], 0.3), ([0.3, 0.1, 0.2], 0.2), ([0.4, 0.1, 0.2, 0.3], 0.3), ([0.2, 0.1], 0.2),
])  # fmt: skip
def test_the_median_is_in_the_middle_and_of_two_the_worse(scores, expected):
    rows = [{"seed": seed, "score": score} for seed, score in enumerate(scores)]
    assert median(rows)["score"] == expected
