"""What the trainings left, as files: learning curves, and what the policies score on scenarios that nobody has seen."""

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import polars as pl

from agents.evaluate import Stage
from agents.policies.policy import load_policy
from agents.setups import load_setup
from experiments.lab.statistics import Resamples, estimate

SCENARIOS = 2000  # of the test set


def curves(pairs: Iterable[tuple[str, str]], policies: Path) -> pl.DataFrame:
    """Return a row for each validation of each training: processor seconds before it, and its score (m/s)."""
    rows = []
    for setup, algo in pairs:
        for run in json.loads((policies / f"{setup}-{algo}" / "seeds.json").read_text())["seeds"]:
            for point, seconds in zip(run["curve"], run["clock"], strict=True):
                rows.append({"setup": setup, "algorithm": algo, "seed": run["seed"], "seconds": seconds, **point})
    return pl.DataFrame(rows).select("setup", "algorithm", "seed", "steps", "seconds", "score")


def finals(pairs: Iterable[tuple[str, str]], policies: Path) -> pl.DataFrame:
    """Return the mean of V_p + w T (m/s) over the set-up's weights on the test set, with its 95 % interval.

    The interval is over seeds and scenarios; `missed` is the share of objects missed.
    """
    rows, resamples = [], Resamples(SCENARIOS)
    for setup, algo in pairs:
        loaded = load_setup(setup)
        weights = loaded.evaluation.weights
        stage = Stage.of("test", SCENARIOS, copies=len(weights), time_weight=weights, **loaded.environment)
        paths = sorted((policies / f"{setup}-{algo}").glob("seed-*.npz"))
        played = [stage.play(load_policy(path)) for path in paths]
        losses = [one.loss(np.repeat(weights, SCENARIOS)).reshape(-1, SCENARIOS).mean(axis=0) for one in played]
        score = estimate(resamples.means(np.array(losses)))
        missed = float(np.mean([one.missed for one in played]))
        rows.append({"setup": setup, "algorithm": algo, "seeds": len(paths), **vars(score), "missed": missed})
    return pl.DataFrame(rows)
