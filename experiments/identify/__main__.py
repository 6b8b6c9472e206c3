"""`python -m experiments.identify`: what `impact_gym.identify` finds in logs of the independent solver, how surely."""

from functools import partial
from pathlib import Path
from typing import Any

import tyro

from agents.jobs import digest_of
from experiments import reference
from experiments.identify import draws, fits, measures, recorder
from experiments.lab import experiment
from experiments.lab.experiment import Shown, Tables
from experiments.lab.tables import Gather, Row, solver_and

SCENES = 100


def tables(scenes: int, gather: Gather) -> Tables:
    """Return all samples of the logs, and the fits of them."""
    depends = digest_of(reference.__name__, draws.__name__, recorder.__name__)
    samples = gather("logs", draws.logs, [{"number": number} for number in range(scenes)], depends)
    grouped: dict[tuple[int, int], list[Row]] = {}
    for sample in samples:
        grouped.setdefault((sample["scene"], sample["log"]), []).append(sample)
    asked = [_asked(number, log, rows) for (number, log), rows in grouped.items()]
    fitted = gather("fits", fits.fit, asked, solver_and("impact_gym.identify", draws.__name__, fits.__name__))
    bounds = [{name: rows[0][name] for name in draws.NAMES} for rows in grouped.values()]
    joined = [measures.judged(row, bound) for row, bound in zip(fitted, bounds, strict=True)]
    return {"fits": joined, "coverage": measures.coverage(joined), "errors": measures.errors(joined)}


def _asked(number: int, log: int, rows: list[Row]) -> dict[str, Any]:
    columns, noise = ["time", "force"], {"force": rows[0]["force_noise"]}
    if draws.recording(number, log).with_velocity:
        columns.append("object_velocity")
        noise["object_velocity"] = rows[0]["velocity_noise"]
    return {
        "number": number, "log": log, "columns": {name: [row[name] for row in rows] for name in columns},
        "noise": noise,
    }  # fmt: skip


def shown(tables: Tables) -> Shown:
    """Return the figure and what the page says."""
    return {"errors": measures.figure(tables["fits"])}, {
        "coverage": tables["coverage"],
        "errors": tables["errors"],
        "seconds": measures.seconds(tables["fits"]),
        "failures": [row for row in tables["fits"] if row["failure"]],
        "logs": len(tables["fits"]),
        "random": sum(row["log"] < draws.RANDOM for row in tables["fits"]),
    }


def main(
    scenes: int | None = None, out: Path | None = None, quick: bool = False, force: bool = False,
    processes: int | None = None,
) -> None:  # fmt: skip
    """Fit logs of the independent solver and write a page about it; what is on disk is not computed again.

    Args:
        scenes: how many, five logs each: 100, or 4 of a quick run.
        out: folder for tables, figure and the page: reports/identify, or identify_quick beside it.
        quick: a first look.
        force: compute everything again.
        processes: at a time; one a core.
    """
    compute = partial(tables, scenes or (4 if quick else SCENES))
    experiment.command("identify", compute, shown, out, quick, again=force, processes=processes)


if __name__ == "__main__":
    tyro.cli(main, prog="python -m experiments.identify")
