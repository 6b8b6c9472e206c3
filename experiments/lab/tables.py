"""Tables: rows that jobs return, computed once and kept."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from agents.jobs import Failure, Job, Result, digest_of, gather_all
from experiments.lab.results import KEPT
from impact_gym.sources import compiled_from

Row = dict[str, Any]
Gather = Callable[..., list[Row]]
"""`gathered` into a folder, by as many processes as were asked for."""
SOLVER = tuple(f"impact_gym.{name}" for name in ("physics", "scene", "motion", "robot", "lowering", "simulation"))


@cache
def solver_and(*modules: str) -> str:
    """Return what a row depends on, for `Job.depends`: our solver, as it is compiled, and the modules that judge it."""
    return f"{compiled_from()} {digest_of(*SOLVER, *modules)}"


def result_of(rows: Sequence[Row]) -> Result:
    """Return rows, all with the same columns, as a job returns them."""
    names: Any = list(rows[0])  # which NumPy's stubs want as one string
    return {"rows": np.rec.fromrecords([tuple(row.values()) for row in rows], names=names)}


def rows_of(result: Result) -> list[Row]:
    """Return the rows of a job's result."""
    names = result["rows"].dtype.names or ()
    return [dict(zip(names, record, strict=True)) for record in result["rows"].tolist()]


def gathered(
    folder: Path, title: str, work: Callable[..., Result], asked: Sequence[Mapping[str, Any]], depends: str,
    failed: Callable[[Mapping[str, Any]], Row] | None = None, **options: Any,
) -> list[Row]:  # fmt: skip
    """Return the rows of jobs, in their order; what `folder` has of their results is not computed again.

    Args:
        folder: of the experiment.
        title: of the table.
        work: a function of a module that returns `result_of` rows.
        asked: its arguments, for each job.
        depends: what else the rows follow from; see `Job`.
        failed: gives the row of a job that has no result, from its arguments; the reason is then its failure, and
            numbers that other rows have are nan. Without it a failure is an error.
        options: of `agents.jobs.gather`.

    Raises:
        JobsFailedError: jobs failed, and none may.
    """
    jobs = [Job(f"{work.__module__}:{work.__name__}", arguments, depends) for arguments in asked]
    # a crash that another attempt would hide is a finding
    answers = gather_all(jobs, folder / KEPT, title=title, retries=0, failures=failed is not None, **options)
    rows: list[Row] = []
    for arguments, answer in zip(asked, answers, strict=True):
        if failed is not None and isinstance(answer, Failure):
            rows.append(failed(arguments) | {"failure": answer.reason.replace("\n", " ")})
        else:
            rows += rows_of(answer)
    columns = dict.fromkeys((name for row in rows for name in row), math.nan)
    return [columns | row for row in rows]
