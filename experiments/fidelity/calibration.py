"""Constants from truth: for each reduction a sum of groups that lies above the error in all but a few of a thousand.

The logarithm of the predicted error is fitted to that of the true one by quantile regression (Koenker, Bassett,
Econometrica 46 (1978) 33-50): the loss is that of the quantile, so that a prediction is as small as it may be.
"""

from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit
from tqdm import tqdm

from experiments.fidelity.truth import Row
from impact_gym.fidelity import prediction

QUANTILE = 0.996  # of scenes in which the prediction is to hold: some more than the 99 % that are promised
FLOOR = 1e-9  # relative error of `simulate` itself, below which a true error means nothing
SHARPNESS = 30.0  # the loss is that of the quantile but for |log(true / predicted)| of about 1 / SHARPNESS
LOGS = (-12.0, 7.0)  # of a constant
NEGLIGIBLE = 1e-3  # share of the prediction that a group reaches nowhere: its constant is 0
DECIMALS = 4  # significant digits of a constant

Array = NDArray[np.float64]


def fit(groups: Array, errors: Array, starts: int) -> Array:
    """Return the constants, not negative, of the columns of `groups`: the best of as many searches as `starts`."""
    target = np.log(np.maximum(errors, FLOOR))

    def loss(logs: Array) -> tuple[float, Array]:
        terms = groups * np.exp(logs)
        total = terms.sum(axis=1) + FLOOR
        excess = target - np.log(total)
        above = SHARPNESS * excess
        value = np.mean((QUANTILE - 1.0) * excess + np.logaddexp(0.0, above) / SHARPNESS)  # rounds the kink at 0
        slope = QUANTILE - 1.0 + expit(above)
        return float(value), -(slope / total) @ terms / len(target)

    rng = np.random.default_rng(0)
    begins = rng.uniform(-3.0, 2.0, (starts, groups.shape[1]))
    limits = [LOGS] * groups.shape[1]
    runs: list[Any] = [minimize(loss, start, jac=True, method="L-BFGS-B", bounds=limits) for start in begins]
    constants = np.exp(min(runs, key=lambda run: run.fun).x)
    share = (groups * constants / (groups @ constants + FLOOR)[:, None]).max(axis=0)
    return np.where(share > NEGLIGIBLE, constants, 0.0)


def split(rows: list[Row]) -> dict[tuple[str, str], list[Row]]:
    """Return the rows by regime and reduction."""
    found: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        found["quiet" if row["quiet"] else "loud", row["kind"]].append(row)
    return dict(sorted(found.items()))


def calibrate(rows: list[Row], starts: int) -> dict[str, dict[str, dict[str, float]]]:
    """Return the constants by regime, reduction and group."""
    constants: dict[str, dict[str, dict[str, float]]] = {"quiet": {}, "loud": {}}
    for (regime, kind), part in (bar := tqdm(split(rows).items(), desc="constants")):
        bar.set_postfix_str(f"{regime} {kind}")
        names = sorted({name for row in part for name, value in row["groups"].items() if value > 0.0})
        groups = np.array([[row["groups"].get(name, 0.0) for name in names] for row in part])
        values = fit(groups, np.array([row["error"] for row in part]), starts)
        constants[regime][kind] = {
            name: float(f"{value:.{DECIMALS}g}") for name, value in zip(names, values, strict=True)
        }
    return constants


def predicted(rows: list[Row], known: dict[str, Any]) -> Array:
    """Return the error predicted for each row with the constants in `known`."""
    return np.array(
        [prediction.predicted(prediction.weighed(row["kind"], row["quiet"], row["groups"], known)) for row in rows]
    )
