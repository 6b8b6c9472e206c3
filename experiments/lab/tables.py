"""Tables: rows that jobs compute once and keep, and the same as CSV for people."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from impact_gym.kernels import COMPILED_FROM

from agents.jobs import Failure, Job, Result, digest_of, gather_all
from experiments.lab.results import KEPT
from impact_gym.files import whole_file

Row = dict[str, Any]
SOLVER = tuple(f"impact_gym.{name}" for name in ("physics", "scene", "motion", "robot", "lowering", "simulation"))


@cache
def solver_and(*modules: str) -> str:
    """Return what a row depends on, for `Job.depends`: our solver, as it is compiled, and the modules that judge it."""
    return f"{COMPILED_FROM} {digest_of(*SOLVER, *modules)}"


def result_of(rows: Sequence[Row]) -> Result:
    """Return rows, all with the same columns, as a job returns them."""
    return {"rows": np.rec.fromrecords([tuple(row.values()) for row in rows], names=list(rows[0]))}


def rows_of(result: Result) -> list[Row]:
    """Return the rows of a job's result."""
    names = result["rows"].dtype.names
    return [dict(zip(names, record, strict=True)) for record in result["rows"].tolist()]


def gathered(
    folder: Path, title: str, jobs: Iterable[Job], failed: Callable[[Job], Row] | None = None, **options: Any
) -> list[Row]:
    """Return the rows of jobs, in their order; what `folder` has of their results is not computed again.

    Args:
        folder: of the experiment.
        title: of the table.
        jobs: whose functions return `result_of` rows.
        failed: gives the row of a job that has no result, what of it is known; the reason is then its failure, and
            numbers that other rows have are nan. Without it a failure is an error.
        options: of `agents.jobs.gather`.

    Raises:
        JobsFailedError: jobs failed, and none may.
    """
    wanted = list(jobs)
    # a crash that another attempt would hide is a finding
    answers = gather_all(wanted, folder / KEPT, title=title, retries=0, failures=failed is not None, **options)
    rows: list[Row] = []
    for job, answer in zip(wanted, answers, strict=True):
        if isinstance(answer, Failure):
            assert failed is not None
            rows.append(failed(job) | {"failure": answer.reason.replace("\n", " ")})
        else:
            rows += rows_of(answer)
    columns = dict.fromkeys((name for row in rows for name in row), math.nan)
    return [columns | row for row in rows]


def write(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write all rows, whole or not at all."""
    with whole_file(path) as file:
        pl.DataFrame(list(rows), infer_schema_length=None).write_csv(file)
