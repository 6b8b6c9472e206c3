"""Errors beside the Cramer-Rao bound, and how often an interval has the truth in it."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binomtest, norm

from experiments.identify.draws import NAMES, RANDOM
from experiments.lab.charts import SERIES
from experiments.lab.statistics import RESAMPLES, estimate
from experiments.lab.tables import Row

PROMISED = (0.93, 0.97)  # of the intervals
OVER_BOUND = 1.2  # median error over that of an estimator at the bound


def coverage(rows: Sequence[Row]) -> list[Row]:
    """Return, for random sensors and the standard one, how many intervals hold the truth; a failed fit holds none."""
    table: list[Row] = []
    for sensors, group in _groups(rows).items():
        hits = {name: sum(row[f"{name} covered"] for row in group) for name in NAMES}
        for name, hit in {**hits, "all": sum(hits.values())}.items():
            count = len(group) * (len(NAMES) if name == "all" else 1)
            low, high = binomtest(hit, count).proportion_ci(method="wilson")
            limits = {"low": float(low), "high": float(high), "met": PROMISED[0] <= hit / count <= PROMISED[1]}
            table.append({"sensors": sensors, "name": name, "intervals": count, "covered": hit / count, **limits})
    return table


def errors(rows: Sequence[Row]) -> list[Row]:
    """Return median errors, relative, and over the bound: 1 is what a normal error at the bound has; with intervals."""
    table: list[Row] = []
    for sensors, group in _groups(rows).items():
        fitted = [row for row in group if not row["failure"]]
        for name in NAMES:
            over = np.array([row[f"{name} over bound"] for row in fitted]) / norm.ppf(0.75)
            median = float(np.median(over))
            drawn = np.random.default_rng(0).choice(over, (RESAMPLES, len(over)))
            of_bound = estimate(np.append(median, np.median(drawn, axis=1)))
            relative = float(np.median([row[f"{name} error"] for row in fitted]))
            limits = {"low": of_bound.low, "high": of_bound.high, "met": median <= OVER_BOUND}
            table.append({"sensors": sensors, "name": name, "error": relative, "over_bound": median, **limits})
    return table


def seconds(rows: Sequence[Row]) -> dict[str, float]:
    """Return median, 95 % quantile and largest processor time of a fit, s."""
    times = np.array([row["seconds"] for row in rows if not row["failure"]])
    return {"median": float(np.median(times)), "p95": float(np.quantile(times, 0.95)), "most": float(times.max())}


def figure(rows: Sequence[Row]) -> Figure:
    """Return the distribution of errors over the bound beside that of a normal one, on logs of the standard sensor."""
    chart = Figure(figsize=(8.0, 4.0))
    axes = chart.subplots()
    group = _groups(rows)["standard"]
    grid = np.linspace(0.0, 4.0, 200)
    axes.plot(grid, 2.0 * norm.cdf(grid) - 1.0, color="black", linestyle="--", label="normal, at the bound")
    for name, color in zip(NAMES, SERIES, strict=False):
        over = np.sort([row[f"{name} over bound"] for row in group if not row["failure"]])
        axes.step(over, np.arange(1, len(over) + 1) / len(over), where="post", color=color, label=name)
    axes.set(xlim=(0.0, 4.0), xlabel="error over the Cramer-Rao bound (-)", ylabel="share of logs (-)")
    axes.legend()
    return chart


def _groups(rows: Sequence[Row]) -> dict[str, list[Row]]:
    random = [row for row in rows if row["log"] < RANDOM]
    return {"random": random, "standard": [row for row in rows if row["log"] >= RANDOM]}
