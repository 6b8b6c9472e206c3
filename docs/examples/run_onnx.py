"""Run the ONNX file of a policy, from readings to a command in SI units, without impact_gym: run_onnx.py FILE."""

import json
import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import onnxruntime


def load(path: str) -> Callable[[Mapping[str, float]], dict[str, float]]:
    """Return a function from readings by id to outputs by id. The file has the scales of both.

    The ids are those of `sensors()` of the environment, and "time_weight".
    """
    session = onnxruntime.InferenceSession(path)
    told = session.get_modelmeta().custom_metadata_map
    if told.get("format") != '"impact_gym controller 1"':
        raise ValueError(f"{path} has no contract of this version")
    rows = [(key, json.loads(told[key])) for key in sorted(told)]
    inputs = [row for key, row in rows if key.startswith("input ")]
    outputs = [row for key, row in rows if key.startswith("output ")]

    def scaled(row: Mapping[str, Any], reading: float) -> Any:
        curve, start = getattr(np, row["curve"], float), row["scaled_low"]
        value, low, high = (curve(each) for each in (reading, row["low"], row["high"]))
        return np.clip(start + (1.0 - start) * (value - low) / (high - low), start, 1.0)

    def command(readings: Mapping[str, float]) -> dict[str, float]:
        observation = np.array([[scaled(row, readings.get(row["id"], 0.0)) for row in inputs]], np.float32)
        ((action,), *_) = session.run(None, {"observation": observation})
        shares = 0.5 * (action.astype(float) + 1.0)
        return {
            row["id"]: row["low"] + share * (row["high"] - row["low"])
            for row, share in zip(outputs, shares, strict=True)
        }

    return command


if __name__ == "__main__":
    first = load(sys.argv[1])({"time_weight": 2.0})  # all other readings are 0 at the start
    print(f"at the start: {first['velocity']:.1f} m/s, {first['acceleration']:.0f} m/s^2")
