"""What `impact_gym.identify` makes of logs of the independent solver, beside the truth."""

import time
from typing import Any

import numpy as np

import impact_gym as ig
from agents.jobs import Result
from experiments.identify import draws
from experiments.lab.tables import Row, result_of

GUESS = np.log([1e5, 1.0, 0.25])  # stiffness, e/(1-e), mass: what every fit is told
MEASURES = ("estimate", "low", "high", "error", "over bound")  # of each number: relative error, and over the bound


def fit(number: int) -> Result:
    """Return a row for each log of a scene: MEASURES of its numbers, whether intervals hold the truth, time, words."""
    return result_of([_row(number, log, *recorded) for log, recorded in enumerate(draws.logs(number))])


def _row(
    number: int, log: int, how: draws.Recording, columns: dict[str, draws.Array], noise: draws.Array, bound: draws.Array
) -> Row:
    scene, motion = draws.scene(number)
    sensor = {name: how.sensor(deviation) for name, deviation in zip(list(columns)[1:], noise.tolist(), strict=True)}
    row: dict[str, Any] = {"scene": number, "log": log, "failure": "", "seconds": np.nan, "clock": np.nan, "words": ""}
    row |= {f"{name} {measure}": np.nan for name in draws.NAMES for measure in MEASURES}
    row |= {f"{name} covered": False for name in draws.NAMES}
    begun = time.process_time(), time.perf_counter()
    try:
        result = ig.identify(columns, draws.at(scene, GUESS), motion, sensor=sensor)
    except (ValueError, RuntimeError) as error:
        return row | {"failure": str(error)}
    row |= {"seconds": time.process_time() - begun[0], "clock": time.perf_counter() - begun[1]}
    row["words"] = " | ".join(result.indistinguishable)
    errors = np.abs(draws.coordinates(result.scene) - draws.coordinates(scene)) / bound
    for name, truth, over_bound in zip(draws.NAMES, draws.numbers(scene), errors, strict=True):
        estimate, (low, high) = result.estimate[name], result.interval[name]
        measures = zip(MEASURES, (estimate, low, high, abs(estimate / truth - 1.0), over_bound), strict=True)
        row |= {f"{name} {measure}": value for measure, value in measures}
        row[f"{name} covered"] = low <= truth <= high
    return row
