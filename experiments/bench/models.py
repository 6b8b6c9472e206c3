"""Simpler models of random scenes: how far off they are, and how much time they save."""

import polars as pl
from tqdm import tqdm

from experiments.solver.approaches import storm
from impact_gym.fidelity import ROUNDS, advise

TOLERANCE = 0.05  # relative error of V_p allowed


def measure(quick: bool) -> dict[str, pl.DataFrame]:
    """Ask for advice on scenes of the storm one by one; return a row for each model tried, and what advice saves."""
    scenes, tried = 30 if quick else 300, []
    for number in tqdm(range(scenes), desc="models"):
        approach = storm(number)
        advice = advise(approach.scene, approach.motion, TOLERANCE, duration=approach.duration)
        tried += [(model.name, model.bound, model.time_saved, model is advice.model) for model in advice.tried[1:]]
    models = pl.DataFrame(tried, ["model", "error", "saved", "advised"], orient="row")
    error, saved = pl.col("error"), pl.col("saved").median().alias("median share of time saved")
    count, within = pl.len().alias("scenes"), (error <= TOLERANCE).sum().alias("within")
    middle, largest = error.median().alias("median error"), error.max().alias("largest error")
    by_model = models.group_by("model").agg(count, within, middle, largest, saved).sort("model")
    advised = models.filter("advised").select(pl.len().alias("scenes that need no more"), saved)
    return {
        f"Simpler models, V_p within {TOLERANCE:.0%}, best of {ROUNDS} runs": by_model,
        f"What advice on each of the {scenes} scenes of the storm saves": advised,
    }
