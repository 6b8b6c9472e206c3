"""Folders of results, and records of the runs that wrote these results."""

import json
import os
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import polars as pl

from agents.provenance import circumstances
from impact_gym.files import write_file

REPORTS = Path("reports")
KEPT = "kept"  # subfolder of a study's folder, with the results of the study's cells


def csv_of(frame: pl.DataFrame) -> str:
    """Return a table as CSV; a text that a spreadsheet could read as a formula gets an apostrophe (OWASP)."""
    return frame.with_columns(pl.selectors.string().str.replace(r"^([=+\-@\t\r\n])", "'$1")).write_csv()


@contextmanager
def recorded_run(folder: Path, command: str, packages: Iterable[str]) -> Iterator[list[dict[str, Any]]]:
    """Record a run of a study in `folder`/results.json; yield the records of all runs; the last is that of this run.

    A record has the command, versions and machine, the machine's load before the run, and the run's duration in seconds
    (None: the run was stopped). If the folder KEPT is missing, earlier records are deleted.
    """
    log = folder / "results.json"
    runs: list[dict[str, Any]] = (
        json.loads(log.read_text())["runs"] if (folder / KEPT).is_dir() and log.is_file() else []
    )
    begun = time.perf_counter()
    record: dict[str, Any] = {"command": command, "seconds": None, "load_before": os.getloadavg()[0]}
    runs.append(record | circumstances("impact-gym", "numpy", "scipy", *packages))
    try:
        yield runs
        runs[-1]["seconds"] = time.perf_counter() - begun
    finally:
        write_file(log, json.dumps({"runs": runs}, indent=2) + "\n")
