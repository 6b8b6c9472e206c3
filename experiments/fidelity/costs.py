"""How long a run takes, chain by chain, and what softer stops save of it: medians over a population."""

import math

import numpy as np

from experiments.fidelity.truth import Row


def relative(rows: list[Row]) -> dict[str, float]:
    """Median time of each chain over that of a rigid tool on a rigid robot."""
    times: dict[str, list[float]] = {}
    for row in rows:
        times.setdefault(row["chain"], []).append(row["seconds"])
    unit = float(np.median(times["rigid"]))
    return {name: float(f"{np.median(values) / unit:.2g}") for name, values in sorted(times.items())}


def saved(rows: list[Row]) -> float:
    """Share of a run's time that stops ten times softer save."""
    shares = [
        1.0 - (row["reduced_seconds"] / row["seconds"]) ** (1.0 / math.log10(row["factor"]))
        for row in rows
        if "factor" in row
    ]
    return float(f"{np.median(shares):.2g}")
