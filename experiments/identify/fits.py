"""What `impact_gym.identify` makes of a log of the independent solver, beside the truth."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

import impact_gym as ig
from agents.jobs import Result
from experiments.identify import draws
from experiments.lab.tables import result_of

GUESS = np.log([1e5, 1.0, 0.25])  # stiffness, e/(1-e), mass: what every fit is told


def fit(number: int, log: int, columns: dict[str, Sequence[float]], noise: dict[str, float]) -> Result:
    """Return the row of one log: errors and interval of each number, seconds of processor and clock, what it says.

    Args:
        number: of the scene.
        log: of its recording.
        columns: of the log.
        noise: of each column, which the fit is told if the recording says so.
    """
    scene, motion = draws.scene(number)
    how = draws.recording(number, log)
    sensor = {
        name: ig.Sensor(
            how.rate, how.low_pass, 0.0 if how.bias is None else "estimated", noise[name] if how.noise_known else None
        )
        for name in noise
    }
    arrays = {name: np.array(values) for name, values in columns.items()}
    begun = time.process_time(), time.perf_counter()
    row: dict[str, Any] = {"scene": number, "log": log, "failure": ""}
    try:
        found = ig.identify(arrays, draws.at(scene, GUESS), motion, sensor=sensor)
    except (ValueError, RuntimeError) as error:
        numbers = {f"{name} {what}": np.nan for name in draws.NAMES for what in ("estimate", "low", "high")}
        return result_of([row | numbers | {"failure": str(error), "seconds": np.nan, "clock": np.nan, "said": ""}])
    numbers = {}
    for name, value in found.estimate.items():
        low, high = found.interval[name]
        numbers |= {f"{name} estimate": value, f"{name} low": low, f"{name} high": high}
    seconds, clock = time.process_time() - begun[0], time.perf_counter() - begun[1]
    said = " | ".join(found.indistinguishable)
    return result_of([row | numbers | {"seconds": seconds, "clock": clock, "said": said}])
