"""Errors beside the Cramer-Rao bound, and how often an interval has the truth in it."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binomtest, norm

from experiments.identify import draws
from experiments.lab.charts import SERIES
from experiments.lab.statistics import Resamples, estimate
from experiments.lab.tables import Row

PROMISED = (0.93, 0.97)  # of the intervals
OVER_BOUND = 1.2  # median error over that of an estimator at the bound


def judged(row: Row, bound: Row) -> Row:
    """Return the row of a fit with, for each number, its error, that over the bound, and whether it is covered."""
    scene, _ = draws.scene(row["scene"])
    truth = (scene.contact.stiffness, scene.contact.restitution, scene.object.mass)
    found = dict(row)
    if not row["failure"]:
        there = draws.at(scene, _coordinates(row))
        errors = draws.coordinates(there) - draws.coordinates(scene)
        for name, value, error in zip(draws.NAMES, truth, errors, strict=True):
            found[f"{name} error"] = abs(row[f"{name} estimate"] / value - 1.0)
            found[f"{name} over bound"] = abs(error) / bound[name]
            found[f"{name} covered"] = bool(row[f"{name} low"] <= value <= row[f"{name} high"])
    return found


def _coordinates(row: Row) -> np.ndarray:
    stiffness, e, mass = (row[f"{name} estimate"] for name in draws.NAMES)
    return np.array([math.log(stiffness), math.log(e / (1.0 - e)), math.log(mass)])


def coverage(rows: Sequence[Row]) -> list[Row]:
    """Return, for random sensors and the standard one, how many intervals hold the truth; a failed fit holds none."""
    found = []
    for sensors, those in _groups(rows):
        for name in (*draws.NAMES, "all"):
            names = draws.NAMES if name == "all" else (name,)
            hits = sum(bool(row.get(f"{one} covered", False)) for row in those for one in names)
            count = len(those) * len(names)
            low, high = binomtest(hits, count).proportion_ci(method="wilson")
            share = hits / count
            limits = {"low": float(low), "high": float(high), "met": PROMISED[0] <= share <= PROMISED[1]}
            found.append({"sensors": sensors, "name": name, "intervals": count, "covered": share, **limits})
    return found


def errors(rows: Sequence[Row]) -> list[Row]:
    """Return median errors, relative, and over the bound: 1 is what a normal error at the bound has; with intervals."""
    found = []
    for sensors, those in _groups(rows):
        fitted = [row for row in those if not row["failure"]]
        for name in draws.NAMES:
            over = np.array([row[f"{name} over bound"] for row in fitted]) / norm.ppf(0.75)
            median = float(np.median(over))
            shares = Resamples(len(over))
            drawn = np.random.default_rng(0).choice(over, (shares.count, len(over)))
            of_bound = estimate(np.append(median, np.median(drawn, axis=1)))
            relative = float(np.median([row[f"{name} error"] for row in fitted]))
            limits = {"low": of_bound.low, "high": of_bound.high, "met": median <= OVER_BOUND}
            found.append({"sensors": sensors, "name": name, "error": relative, "over_bound": median, **limits})
    return found


def seconds(rows: Sequence[Row]) -> dict[str, float]:
    """Return median and largest processor time of a fit, s."""
    took = np.array([row["seconds"] for row in rows if not row["failure"]])
    return {"median": float(np.median(took)), "p95": float(np.quantile(took, 0.95)), "most": float(took.max())}


def figure(rows: Sequence[Row]) -> Figure:
    """Return the distribution of errors over the bound beside that of a normal one, on logs of the standard sensor."""
    chart = Figure(figsize=(8.0, 4.0))
    axes = chart.subplots()
    _, those = _groups(rows)[1]
    grid = np.linspace(0.0, 4.0, 200)
    axes.plot(grid, 2.0 * norm.cdf(grid) - 1.0, color="black", linestyle="--", label="normal, at the bound")
    for name, color in zip(draws.NAMES, SERIES, strict=False):
        over = np.sort([row[f"{name} over bound"] for row in those if not row["failure"]])
        axes.step(over, np.arange(1, len(over) + 1) / len(over), where="post", color=color, label=name)
    axes.set(xlim=(0.0, 4.0), xlabel="error over the Cramer-Rao bound (-)", ylabel="share of logs (-)")
    axes.legend()
    return chart


def _groups(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    random = [row for row in rows if row["log"] < draws.RANDOM]
    return [("random", random), ("standard", [row for row in rows if row["log"] >= draws.RANDOM])]
