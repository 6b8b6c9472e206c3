"""Run folders: the files of a training; an interrupted training ends with the same bits as an uninterrupted one."""

import fcntl
import json
import shutil

import numpy as np
import pytest
from episode_runs import assert_identical
from own_set_up import change
from refusal import refused
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tiny_training import interrupted, left, rows, tiny

import impact_gym as ig
from agents import load_policy, load_setup
from agents.evaluate.scenario_batch import Validation
from agents.jobs import JobsFailedError
from agents.policies.networks import to_arrays
from agents.train.__main__ import read_options, run
from agents.train.callback import OBJECTIVES, CollapsedError
from agents.train.ppo import resume, train
from agents.train.seeds import train_one
from impact_gym.files import UNFINISHED
from impact_gym.task import Task


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return train(tiny(), tmp_path_factory.mktemp("whole") / "run")


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    """The folder of the same training, killed after its first checkpoint; tests copy it."""
    return interrupted(tiny(), tmp_path_factory.mktemp("broken") / "run")


@pytest.fixture
def part(broken, tmp_path):
    return shutil.copytree(broken, tmp_path / "part")


def read(folder, name):
    return json.loads((folder / name).read_text())


def test_train_writes_policies_with_their_provenance(whole):
    config, metrics, training = read(whole, "config.json"), read(whole, "metrics.json"), tiny().training
    assert config["command"].startswith("impact-gym train linear-blind --steps 4096")
    assert config["settings"]["rollout"] == 16
    assert {"python", "numpy", "torch", "gymnasium", "stable-baselines3"} <= set(config["versions"])
    assert config["versions"]["impact-gym"] == ig.__version__
    validation = Validation(Task(**config["environment"]), config["weights"], training.validation_scenarios)
    for name in ("best", "final"):
        policy = load_policy(whole / f"{name}.npz")
        assert config.items() <= policy.provenance.items()
        assert policy.provenance["validation"] == metrics["validation"][name] == validation.score(policy)
    best, final = (metrics["validation"][name]["score"] for name in ("best", "final"))
    assert best == min(point["score"] for point in metrics["curve"])
    assert metrics["curve"][-1] == {"steps": training.whole_steps, "score": final}
    kinds = {file.name.split(".")[0] for file in whole.iterdir()}
    assert kinds == {"config", "metrics", "progress", "events", "best", "final", "lock"}


def test_resume_reaches_the_same_result_and_logs_each_step_once(whole, part):
    """As text and for TensorBoard. A row before the first end of an episode is empty instead of nan."""
    np.random.seed(7)  # noqa: NPY002 - stable-baselines3 draws from it; in a new process its state differs
    (part / f".best.npz.0{UNFINISHED}").touch()  # an unfinished file of a killed process
    train_one(str(part), tiny().made_for())
    assert_identical(left(whole), left(part))
    assert not (part / f".best.npz.0{UNFINISHED}").exists()
    log, events = rows(part), EventAccumulator(str(part))
    events.Reload()
    steps = [int(float(row["time/total_timesteps"])) for row in log]
    assert steps == sorted(set(steps))
    assert steps[-1] == tiny().training.whole_steps
    objectives = [f"objectives/{name}" for name in OBJECTIVES]
    for name in (*objectives, "validation/score", "validation/approach_time at weight 2"):
        written = [(step, float(row[name])) for step, row in zip(steps, log, strict=True) if row[name]]
        assert len(written) >= 2
        assert np.isfinite(written).all()
        drawn = [(event.step, event.value) for event in events.Scalars(name)]
        assert drawn == pytest.approx(np.array(written), rel=1e-6)


@pytest.mark.parametrize("imitation_steps", [512, 2048])
def test_resume_reaches_the_same_result_during_and_after_imitation(tmp_path, imitation_steps):
    path = tmp_path / "all.toml"
    path.write_text("[environment]\ntool_mass = [0.1, 0.2]\n[evaluation.nominal]\ntool_mass = 0.125\n")
    run = tiny(path, nominal=0.5, teacher="blind-profile", imitation_steps=imitation_steps, steps=2048)
    part = resume(interrupted(run, tmp_path / "part"))
    assert_identical(left(train(run, tmp_path / "whole")), left(part))


def test_train_and_resume_do_not_change_a_finished_run(whole):
    before = {file.name: file.read_bytes() for file in whole.iterdir()}
    assert resume(whole) == whole
    for training, out in ((tiny(), whole), (tiny(teacher="nope"), whole / "nothing")):
        with pytest.raises((FileExistsError, ValueError), match=r"exists|nope"):
            train(training, out)
    assert {file.name: file.read_bytes() for file in whole.iterdir()} == before


@pytest.mark.parametrize(("setting", "before", "now"), [("width", 16, 24), ("envs", 16, 8)])
def test_resume_refuses_the_checkpoint_of_another_training(part, setting, before, now):
    record = read(part, "config.json")
    record["settings"][setting] = now
    (part / "config.json").write_text(json.dumps(record))
    refused(lambda: resume(part), "does not fit this training", f"{setting} is {before} in the checkpoint, got {now}")


def test_resume_refuses_a_folder_without_a_run_or_with_a_running_one(part, tmp_path):
    with (part / "lock").open() as lock:  # a second open file excludes even the same process
        fcntl.flock(lock, fcntl.LOCK_EX)
        refused(lambda: resume(part), "another process")
    refused(lambda: resume(tmp_path), "holds no run")
    (tmp_path / "config.json").write_text(json.dumps({"settings": {**tiny().made_for()["settings"], "gama": 1.0}}))
    refused(lambda: resume(tmp_path), "gama")


def trained(folder, setup, *words):
    where = ["--processes", "0", "--out", str(folder / "runs"), "--policies", str(folder / "policies")]
    return run(read_options([str(setup), *words, *where]))


def test_train_seeds_trains_each_seed_once_and_refuses_a_changed_set_up(mine, tmp_path):
    wanted = ("--seeds", "2", "--steps", "512")
    path = trained(tmp_path, mine, *wanted)
    policies = [load_policy(path, seed) for seed in (0, 1)]
    weights, others = (to_arrays(policy.network) for policy in policies)
    assert not any(np.array_equal(weights[name], others[name]) for name in weights if name != "log_std.weight")
    assert load_setup(mine).describes(policies[0].task)
    shutil.rmtree(tmp_path / "runs" / "seed-1")
    before = path.read_bytes()
    trained(tmp_path, mine, *wanted)  # the stored results fill the folder again
    assert path.read_bytes() == before
    refused(lambda: trained(tmp_path, mine, *wanted, "--width", "24"), "other settings", "or name another folder")
    change(mine, "damping_ratio = 0.7", "damping_ratio = 0.9")
    refused(lambda: trained(tmp_path, mine, *wanted), "another environment: remove this folder")
    refused(lambda: resume(tmp_path / "runs" / "seed-0"), "has changed since")


@pytest.fixture
def unreachable(tmp_path):
    """A training of 16 rollouts whose arm reaches an object only at full speed, as no untrained policy moves.

    A validation follows every second rollout.
    """
    path = tmp_path / "slow.toml"
    path.write_text("[environment]\nvelocity_range = [-0.2, 0.2]\nscenario = { distance = [0.236, 0.237] }\n")
    return tiny(path, validate_every=512, checkpoint_every=256)


def test_train_stops_with_the_reason_if_it_touches_no_object(unreachable, tmp_path):
    """At the same step if the training was interrupted."""
    interrupted(unreachable, tmp_path / "run", after=1024)
    reason = r"after 1,536 of 4,096 steps: at least \d+% of the objects missed.*learning_rate below.*log_std below"
    for _ in range(2):
        with pytest.raises(CollapsedError, match=f"{reason}.*impact-gym check .*slow.toml"):
            resume(tmp_path / "run")
    assert not (tmp_path / "run" / "metrics.json").exists()


def test_train_seeds_ships_nothing_of_a_collapsed_seed(unreachable, tmp_path):
    names = ("steps", "envs", "rollout", "batch", "width", "validate_every", "validation_scenarios")
    settings = (f"--{name.replace('_', '-')} {getattr(unreachable.training, name)}" for name in names)
    with pytest.raises(JobsFailedError, match=r"1 of 1 jobs failed(.|\n)*CollapsedError(.|\n)*objects missed"):
        trained(tmp_path, unreachable.setup.path, "--seeds", "1", *" ".join(settings).split())
    assert not (tmp_path / "policies").exists()


@pytest.mark.parametrize("steps", [4096, 256])
def test_train_ends_if_weights_are_not_finite(tmp_path, steps):
    with pytest.raises(CollapsedError, match=r"no longer finite.*learning_rate below 1e\+30"):
        train(tiny(learning_rate=1e30, steps=steps), tmp_path / "run")
    assert not (tmp_path / "run" / "final.npz").exists()
