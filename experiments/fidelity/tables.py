"""The tables of the report: how often the prediction is exceeded, how large it is, what a reduction saves."""

import csv
import io
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.fidelity.calibration import FLOOR, predicted
from experiments.fidelity.truth import TOLERANCES, Row
from impact_gym.files import whole_file

Table = list[dict[str, Any]]


def by_reduction(rows: list[Row], constants: dict[str, Any]) -> Table:
    """A line per reduction, regime by regime and together."""
    table: Table = []
    for kind in sorted({row["kind"] for row in rows}):
        for regime in ("quiet", "loud", "all"):
            part = [
                row for row in rows if row["kind"] == kind and regime in ("all", "quiet" if row["quiet"] else "loud")
            ]
            if part:
                table.append({"reduction": kind, "regime": regime, **_line(part, predicted(part, constants))})
    for regime in ("quiet", "loud", "all"):
        part = [row for row in rows if regime in ("all", "quiet" if row["quiet"] else "loud")]
        table.append({"reduction": "every", "regime": regime, **_line(part, predicted(part, constants))})
    return table


def _line(rows: list[Row], prediction: NDArray[np.float64]) -> dict[str, Any]:
    error = np.array([row["error"] for row in rows])
    exceeded = error > prediction + FLOOR
    seen = error > FLOOR
    line: dict[str, Any] = {
        "scenes": len(rows),
        "exceeded": int(exceeded.sum()),
        "exceeded_share": float(exceeded.mean()),
        "median_true": float(np.median(error)),
        "median_predicted_over_true": float(np.median(prediction[seen] / error[seen])) if seen.any() else float("nan"),
    }
    for tolerance in TOLERANCES:
        within = prediction <= tolerance
        line[f"allowed_{tolerance:g}"] = float(within.mean())
        line[f"truly_{tolerance:g}"] = float((error <= tolerance).mean())
        line[f"broken_{tolerance:g}"] = int((within & (error > tolerance)).sum())
    faster = [row["seconds"] / row["reduced_seconds"] for row in rows if row["reduced_seconds"] > 0.0]
    line["median_speedup"] = float(np.median(faster)) if faster else float("inf")
    return line


def by_tolerance(rows: list[Row]) -> Table:
    """A line per tolerance and chain: what `advise` as a whole delivers."""
    table: Table = []
    for tolerance in TOLERANCES:
        at = [row for row in rows if row["tolerance"] == tolerance]
        for chain in [*sorted({row["chain"] for row in at}), "every"]:
            part = [row for row in at if chain in (row["chain"], "every")]
            applied = [row for row in part if row["applied"]]
            simulated = [row for row in applied if not any("instantaneous" in name for name in row["applied"])]
            table.append(
                {
                    "tolerance": tolerance,
                    "chain": chain,
                    "scenes": len(part),
                    "applied": len(applied),
                    "exceeded": sum(row["error"] > row["predicted"] + FLOOR for row in applied),
                    "broken": sum(row["error"] > tolerance for row in part),
                    "largest_error": max((row["error"] for row in applied), default=0.0),
                    "median_speedup": _median(row["seconds"] / row["reduced_seconds"] for row in applied),
                    "median_speedup_simulated": _median(row["seconds"] / row["reduced_seconds"] for row in simulated),
                    "median_runs_to_repay": _median(_repaid(row) for row in applied),
                    "median_microseconds": 1e6 * _median(row["seconds"] for row in part),
                    "median_advice_microseconds": 1e6 * _median(row["advice_seconds"] for row in part),
                }
            )
    return table


def _repaid(row: Row) -> float:
    """After how many runs of the reduced scene the time of the advice is saved."""
    saved = row["seconds"] - row["reduced_seconds"]
    return row["advice_seconds"] / saved if saved > 0.0 else math.inf


def _median(values: Any) -> float:
    found = list(values)
    return float(np.median(found)) if found else float("nan")


def write(path: Path, table: Table) -> None:
    """Write `table` as CSV."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, table[0])
    writer.writeheader()
    writer.writerows(table)
    with whole_file(path) as file:
        file.write(text.getvalue().encode())
