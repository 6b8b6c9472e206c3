"""Learning curves, over steps and over seconds."""

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from experiments.lab.charts import SERIES

NAMES = {"ppo": "PPO", "recurrent_ppo": "recurrent PPO", "sac": "SAC", "tqc": "TQC"}


def learning_curves(curves: pl.DataFrame) -> Figure:
    """Return the best score so far of every training, thin, and the median of the seeds; a row for each set-up."""
    setups = curves["setup"].unique(maintain_order=True).to_list()
    figure = Figure(figsize=(10.0, 3.0 * len(setups)))
    grid = figure.subplots(len(setups), 2, squeeze=False, sharey="row")
    for axes, setup in zip(grid, setups, strict=True):
        for color, (algo, name) in zip(SERIES, NAMES.items(), strict=False):
            rows = curves.filter(pl.col("setup") == setup, pl.col("algorithm") == algo).sort("seed", "steps")
            seeds = [one.drop("seed").to_dict(as_series=False) for _, one in rows.group_by("seed", maintain_order=True)]
            best = np.array([np.minimum.accumulate(one["score"]) for one in seeds])
            for axis, x in zip(axes, ("steps", "seconds"), strict=True):
                along = np.array([one[x] for one in seeds])
                axis.plot(along.T, best.T, color=color, linewidth=0.5, alpha=0.4)
                axis.plot(np.median(along, axis=0), np.median(best, axis=0), color=color, marker=".", label=name)
        axes[0].set(xscale="log", ylabel="V_p + w T (m/s)", title=setup, xlabel="environment steps")
        axes[1].set(xscale="log", xlabel="seconds of one core")
    grid[0, 0].legend()
    return figure
