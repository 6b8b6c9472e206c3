"""What `impact_gym.identify` makes of a log of the independent solver, beside the truth."""

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import impact_gym as ig
from agents.jobs import Result
from experiments.identify import draws
from experiments.lab.tables import Row, result_of

GUESS = np.log([1e5, 1.0, 0.25])  # stiffness, e/(1-e), mass: what every fit is told
MEASURES = ("estimate", "low", "high", "error", "over bound")  # of each number: relative error, and over the bound


def arguments(number: int, log: int, samples: Sequence[Row]) -> dict[str, Any]:
    """Return the arguments of `fit` for the samples of a log."""
    names = ["force", "object_velocity"][: 1 + draws.recording(number, log).with_velocity]
    noise = {"force": samples[0]["force_noise"], "object_velocity": samples[0]["velocity_noise"]}
    return {
        "number": number, "log": log, "columns": {name: [row[name] for row in samples] for name in ("time", *names)},
        "noise": {name: noise[name] for name in names}, "bound": [samples[0][name] for name in draws.NAMES],
    }  # fmt: skip


def fit(
    number: int, log: int, columns: Mapping[str, Sequence[float]], noise: Mapping[str, float], bound: Sequence[float]
) -> Result:
    """Return the row of one log: MEASURES of each number, whether its interval holds the truth, seconds, words.

    Args:
        number: of the scene.
        log: of its recording.
        columns: of the log.
        noise: of each column, which the fit is told if the recording says so.
        bound: the least standard deviation of each coordinate.
    """
    scene, motion = draws.scene(number)
    how = draws.recording(number, log)
    sensor = {name: how.sensor(deviation) for name, deviation in noise.items()}
    arrays = {name: np.array(values) for name, values in columns.items()}
    row: dict[str, Any] = {"scene": number, "log": log, "failure": "", "seconds": np.nan, "clock": np.nan, "words": ""}
    row |= {f"{name} {measure}": np.nan for name in draws.NAMES for measure in MEASURES}
    row |= {f"{name} covered": False for name in draws.NAMES}
    begun = time.process_time(), time.perf_counter()
    try:
        result = ig.identify(arrays, draws.at(scene, GUESS), motion, sensor=sensor)
    except (ValueError, RuntimeError) as error:
        return result_of([row | {"failure": str(error)}])
    row |= {"seconds": time.process_time() - begun[0], "clock": time.perf_counter() - begun[1]}
    row["words"] = " | ".join(result.indistinguishable)
    errors = np.abs(draws.coordinates(result.scene) - draws.coordinates(scene)) / bound
    for name, truth, over_bound in zip(draws.NAMES, draws.numbers(scene), errors, strict=True):
        estimate, (low, high) = result.estimate[name], result.interval[name]
        measures = zip(MEASURES, (estimate, low, high, abs(estimate / truth - 1.0), over_bound), strict=True)
        row |= {f"{name} {measure}": value for measure, value in measures}
        row[f"{name} covered"] = low <= truth <= high
    return result_of([row])
