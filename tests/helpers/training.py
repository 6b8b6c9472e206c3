"""Short trainings for tests."""

import csv
import json
from dataclasses import replace

import pytest
from episodes import assert_identical

from agents.policies.networks import to_arrays
from agents.policies.policy import load_policy
from agents.train import callback, checkpoint
from agents.train.run import train
from agents.train.settings import Settings

TINY = Settings(
    steps=4096,
    envs=16,
    batch=64,
    width=16,
    simulation_threads=1,
    validate_every=1500,
    validation_scenarios=20,
    checkpoint_every=1000,
    rollout=16,
)
OBJECTIVES = callback.OBJECTIVES


def tiny(**changes):
    return replace(TINY, **changes)


class Killed(BaseException):
    """As if the process ended here."""


def interrupted(settings, out, checkpoints):
    """Train until so many checkpoints are written, and some steps more."""
    original, written = checkpoint.write, []

    def write(*arguments):
        if len(written) == checkpoints:
            raise Killed
        written.append(original(*arguments))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpoint, "write", write)
        with pytest.raises(Killed):
            train(replace(settings, out=out))
    assert (out / "checkpoint.npz").is_file()
    assert not (out / "metrics.json").exists()


def rows(folder):
    """Return the learning curve but for what the clock says."""
    with (folder / "progress.csv").open() as file:
        return [{name: row[name] for name in row if "per_second" not in name} for row in csv.DictReader(file)]


def left(folder):
    """Return what a training left, but for what the clock says: weights, learning curve, scores."""
    weights = [to_arrays(load_policy(folder / name).network) for name in ("final.npz", "best.npz")]
    metrics = json.loads((folder / "metrics.json").read_text())
    return weights, rows(folder), metrics["validation"], metrics["curve"]


def assert_same(one, other):
    assert_identical(left(one), left(other))
