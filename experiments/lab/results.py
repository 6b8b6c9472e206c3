"""Folders of results, and records of the runs that wrote them."""

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
KEPT = "kept"
"""Subfolder of a study with the results of its cells."""


def csv_of(frame: pl.DataFrame) -> str:
    """Return a table as CSV, with an apostrophe before each text that a spreadsheet would read as a formula.

    Such a text begins with =, +, -, @, a tab or a line break (OWASP, CSV Injection).
    """
    return frame.with_columns(pl.selectors.string().str.replace(r"^([=+\-@\t\r\n])", "'$1")).write_csv()


@contextmanager
def recorded_run(folder: Path, command: str, packages: Iterable[str]) -> Iterator[list[dict[str, Any]]]:
    """Record a run of a study in `folder`/results.json; yield the records of all runs, this run last.

    A record has the command, the circumstances, the machine's load before the run, and the run's duration (s), None if
    the run was stopped. Earlier records are dropped if the folder has no kept results.
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
