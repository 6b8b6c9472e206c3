"""Run folders: the files of a training; an interrupted training ends with the same bits as an uninterrupted one."""

import csv
import fcntl
import json
import pickle
import shutil
from unittest import mock

import numpy as np
import pytest
from episode_runs import assert_identical
from own_set_up import change
from refusal import refused
from tiny_training import ALL_PARTS, tiny

import impact_gym as ig
from agents import load_policy
from agents.evaluate.scenario_batch import Validation
from agents.policies.networks import to_arrays
from agents.train.__main__ import read_options, run
from agents.train.callback import CollapsedError, TrainingCallback
from agents.train.checkpoint import FORMAT
from agents.train.ppo import resume, train
from agents.train.seeds import train_one
from impact_gym.support.archive import archive_of, read_archive
from impact_gym.support.files import UNFINISHED
from impact_gym.task import Task


def interrupted(run, out, after=0):
    """Begin or resume a training; interrupt it in the first validation that follows a checkpoint and some steps."""
    validate = TrainingCallback.validate

    def interrupt(callback):
        policy = validate(callback)
        if callback.num_timesteps >= after and (out / "checkpoint.npz").is_file():
            raise KeyboardInterrupt
        return policy

    with mock.patch.object(TrainingCallback, "validate", interrupt), pytest.raises(KeyboardInterrupt):
        resume(out) if out.exists() else train(run, out)


def read(folder, name):
    return json.loads((folder / name).read_text())


def rows(folder):
    return list(csv.DictReader((folder / "progress.csv").read_text().splitlines()))


def left(folder):
    """Return the results of a training without times: weights, learning curve, scores."""
    weights = [to_arrays(load_policy(folder / name).network) for name in ("final.npz", "best.npz")]
    metrics = read(folder, "metrics.json")
    return weights, rows(folder), metrics["validation"], metrics["curve"]


@pytest.fixture(scope="module")
def all_parts(tmp_path_factory):
    """A short training that draws numbers, has nominal environments, and imitates for its first half."""
    path = tmp_path_factory.mktemp("setup") / "all-parts.toml"
    path.write_text(ALL_PARTS)
    return tiny(path, nominal=0.5, teacher="blind-profile", imitation_steps=2048)


@pytest.fixture(scope="module")
def finished(all_parts, tmp_path_factory):
    """The folder of this training after its end; tests only read it."""
    return train(all_parts, tmp_path_factory.mktemp("trained") / "run")


@pytest.fixture
def part(all_parts, tmp_path):
    """The folder of the same training, killed after its first checkpoint."""
    interrupted(all_parts, tmp_path / "part")
    return tmp_path / "part"


def test_train_writes_policies_with_their_provenance(finished, all_parts):
    config, metrics, training = read(finished, "config.json"), read(finished, "metrics.json"), all_parts.training
    assert config["command"] == all_parts.command
    assert config["versions"]["impact-gym"] == ig.__version__
    validation = Validation(Task(**config["environment"]), config["weights"], training.validation_scenarios)
    for name in ("best", "final"):
        policy = load_policy(finished / f"{name}.npz")
        assert config.items() <= policy.provenance.items()
        assert policy.provenance["validation"] == metrics["validation"][name] == validation.score(policy)
    best, final = (metrics["validation"][name]["score"] for name in ("best", "final"))
    assert best == min(point["score"] for point in metrics["curve"])
    assert metrics["curve"][-1] == {"steps": training.whole_steps, "score": final}


def test_twice_interrupted_training_reaches_the_same_bits(finished, all_parts, part):
    """During the imitation and after it."""
    (part / f".best.npz.0{UNFINISHED}").touch()  # an unfinished file of a killed process
    np.random.seed(7)  # noqa: NPY002 - stable-baselines3 draws from it; in a new process its state differs
    interrupted(all_parts, part, after=3000)
    np.random.seed(8)  # noqa: NPY002
    train_one(str(part), all_parts.made_for())
    assert_identical(left(finished), left(part))
    assert not (part / f".best.npz.0{UNFINISHED}").exists()
    assert float(rows(part)[-1]["time/total_timesteps"]) == all_parts.training.whole_steps


def test_train_and_resume_do_not_change_a_finished_run(finished, all_parts):
    before = {file.name: file.read_bytes() for file in finished.iterdir()}
    assert resume(finished) == finished
    with pytest.raises(FileExistsError, match="exists"):
        train(all_parts, finished)
    assert {file.name: file.read_bytes() for file in finished.iterdir()} == before


def test_resume_refuses_what_it_cannot_continue(part, tmp_path):
    """A running training, another one's checkpoint, a folder without a training."""
    with (part / "lock").open() as lock:  # a second open file excludes even the same process
        fcntl.flock(lock, fcntl.LOCK_EX)
        refused(lambda: resume(part), "another process")
    saved = part / "checkpoint.npz"
    good, (content, arrays) = saved.read_bytes(), read_archive(saved, FORMAT)
    settings = content["settings"]
    for other in ({"settings": settings | {"seed": 3}}, {"settings": settings | {"learning_rate": 0.1}},
                  {"settings": 3}, {"parameters": []}, {"parameters": {"tensor": "no"}}, {"counters": 3},
                  {"environment": None}, {"last": [1]}, {"torch": "x"}, {"numpy": {}}, {"python": [3, [], 1e400]},
                  {"log": []}, {"callback_state": 5}):  # fmt: skip
        saved.write_bytes(archive_of(FORMAT, content | other, arrays))
        refused(lambda: resume(part), "does not fit this training")
    for damaged in (b"", b"x", good[:999], pickle.dumps(settings)):
        saved.write_bytes(damaged)
        refused(lambda: resume(part), "is no impact_gym checkpoint")
    saved.write_bytes(good)
    change(part / "config.json", '"width": 16', '"width": 24')
    refused(lambda: resume(part), "does not fit this training", "width is 16 in the checkpoint, got 24")
    refused(lambda: resume(tmp_path), "holds no run")


def trained(folder, setup, *words):
    where = ["--processes", "0", "--out", str(folder / "runs"), "--policies", str(folder / "policies")]
    return run(read_options([str(setup), *words, *where]))


def test_train_seeds_trains_each_once_for_one_set_up(mine, tmp_path):
    wanted = ("--seeds", "2", "--steps", "512")
    path = trained(tmp_path, mine, *wanted)
    weights, others = (to_arrays(load_policy(path, seed).network) for seed in (0, 1))
    assert not any(np.array_equal(weights[name], others[name]) for name in weights if name != "log_std.weight")
    shutil.rmtree(tmp_path / "runs" / "seed-1")
    before = path.read_bytes()
    trained(tmp_path, mine, *wanted)  # the stored results fill the folder again
    assert path.read_bytes() == before
    refused(lambda: trained(tmp_path, mine, *wanted, "--width", "24"), "other settings", "or name another folder")
    change(mine, "damping_ratio = 0.7", "damping_ratio = 0.9")
    refused(lambda: trained(tmp_path, mine, *wanted), "another environment: remove this folder")
    refused(lambda: resume(tmp_path / "runs" / "seed-0"), "has changed since")


def test_train_stops_with_the_reason_if_it_touches_no_object(tmp_path):
    """The arm reaches an object only at full speed, as no untrained policy moves. An interruption changes nothing."""
    path = tmp_path / "slow.toml"
    path.write_text("[environment]\nvelocity_range = [-0.2, 0.2]\nscenario = { distance = [0.236, 0.237] }\n")
    interrupted(tiny(path, validate_every=512, checkpoint_every=256), tmp_path / "run", after=1024)
    reason = r"after 1,536 of 4,096 steps: at least \d+% of the objects missed.*learning_rate below.*log_std below"
    for _ in range(2):
        with pytest.raises(CollapsedError, match=f"{reason}.*impact-gym check .*slow.toml"):
            resume(tmp_path / "run")


def test_train_ends_if_weights_are_not_finite(tmp_path):
    with pytest.raises(CollapsedError, match=r"no longer finite.*learning_rate below 1e\+30"):
        train(tiny(learning_rate=1e30), tmp_path / "run")
    with pytest.raises(CollapsedError):
        resume(tmp_path / "run")  # without a checkpoint it begins again, also with what TensorBoard shows
    assert len([*(tmp_path / "run").glob("events.*")]) == 1
