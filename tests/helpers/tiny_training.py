"""Short trainings for tests."""

import csv
import json
from dataclasses import replace

import pytest

from agents import load_policy, load_setup
from agents.policies.networks import to_arrays
from agents.setups import Training
from agents.train.callback import TrainingCallback
from agents.train.ppo import Run, resume, train

TINY = Training(
    steps=4096, envs=16, rollout=16, batch=64, width=16, simulation_threads=1,
    validate_every=1536, validation_scenarios=20, checkpoint_every=1024, imitation_steps=4096, rtol=1e-4,
)  # fmt: skip
ALL_PARTS = "[environment]\ntool_mass = [0.1, 0.2]\n[evaluation.nominal]\ntool_mass = 0.125\n"


def tiny(setup="linear-blind", seed=0, **changes):
    """Return a training that takes at most a second."""
    return Run(load_setup(setup), replace(TINY, **changes), seed)


def interrupted(run, out, after=0):
    """Begin or resume a training; interrupt it in the first validation that follows a checkpoint and some steps."""
    validate = TrainingCallback.validate

    def interrupt(callback):
        policy = validate(callback)
        if callback.num_timesteps >= after and (out / "checkpoint.npz").is_file():
            raise KeyboardInterrupt
        return policy

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TrainingCallback, "validate", interrupt)
        with pytest.raises(KeyboardInterrupt):
            resume(out) if out.exists() else train(run, out)
    assert not (out / "metrics.json").exists()
    return out


def rows(folder):
    with (folder / "progress.csv").open() as file:
        return list(csv.DictReader(file))


def left(folder):
    """Return the results of a training without times: weights, learning curve, scores."""
    weights = [to_arrays(load_policy(folder / name).network) for name in ("final.npz", "best.npz")]
    metrics = json.loads((folder / "metrics.json").read_text())
    return weights, rows(folder), metrics["validation"], metrics["curve"]
