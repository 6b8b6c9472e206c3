"""The three rates of a set-up, in steps per second of all its environments together, resets included.

*environment*: actions drawn beforehand. *environment with inference*: the set-up's shipped policy acts. *training*: all
that `agents.train` does from the first rollout to the end, updates and validation included; `metrics.json` has it too.
Random actions play other episodes than a policy, so the first rate need not be the highest.
"""

import io
import json
import tempfile
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl

from agents import load_policy
from agents.setups import load_setup
from agents.train.run import train
from agents.train.settings import default_settings
from impact_gym.doctor import at_random, rate, stepping

SETUPS = ("linear-blind", "bistable-blind")
SECONDS = 3.0  # of each measurement but that of training
STEPS = 1_000_000  # of training


def training(setup: str, steps: int) -> float:
    """Return the steps per second of a training as its set-up has it."""
    settings = replace(default_settings(setup), steps=steps)
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        run = train(replace(settings, out=Path(folder) / "run"))
        return float(json.loads((run / "metrics.json").read_text())["steps_per_second"])


def rates(setup: str, seconds: float, steps: int) -> dict[str, Any]:
    """Return the row of a set-up: as many environments side by side as its training has, and the three rates."""
    count, policy = default_settings(setup).envs, load_policy(setup)
    envs = load_setup(setup).make_vec(count)
    ways = {
        "environment": at_random(envs.action_space),
        "environment with inference": lambda last: policy.predict(last[0])[0],
    }
    played = {name: rate(stepping(envs, act), count, seconds) for name, act in ways.items()}
    return {"set-up": setup, "environments": count, **played, "training": training(setup, steps)}


def measure(quick: bool) -> dict[str, pl.DataFrame]:
    """Return a row for each set-up."""
    much = (SECONDS / 30.0, STEPS // 30) if quick else (SECONDS, STEPS)
    return {"The three rates, steps per second": pl.DataFrame([rates(setup, *much) for setup in SETUPS])}
