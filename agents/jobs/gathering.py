"""Doing jobs and gathering their results: what is on disk first, then the rest as it comes."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from copy import copy
from functools import partial
from pathlib import Path
from typing import Any

from tqdm import tqdm

from agents.jobs import local, ray_cluster
from agents.jobs.job import Answer, Engine, Failure, Job
from agents.jobs.store import Store
from impact_gym.files import DiskFullError
from impact_gym.validation import WrongTypeError, number, whole

SHOWN = 10  # failed jobs that an error names one by one


class JobsFailedError(RuntimeError):
    """Jobs have no result; those that have one are in the folder."""

    def __init__(self, failed: Sequence[tuple[Job, Failure]], count: int) -> None:
        self.failed = list(failed)
        lines = [f"{len(self.failed)} of {count} jobs failed (the others are done and kept):"]
        lines += [f"{job}: {failure.reason}" for job, failure in self.failed[:SHOWN]]
        lines += [f"and {len(self.failed) - SHOWN} more"] if len(self.failed) > SHOWN else []
        lines += [f"the first of these raised:\n{failure.trace}" for _, failure in self.failed if failure.trace][:1]
        super().__init__("\n".join(lines))


def gather(
    jobs: Iterable[Job], folder: Path | str, *, processes: int | None = None, cluster: str | None = None,
    title: str = "jobs", retries: int = 3, seconds: float | None = None, failures: bool = False,
) -> Iterator[tuple[int, Any]]:  # fmt: skip
    """Yield the place of each job in `jobs` and its result, in any order; results that are in `folder` come first.

    Every new result is written to the folder before it is yielded, by this process. Run again, only what is missing is
    computed; a damaged result is, too. Jobs with the same key are computed once.

    Args:
        jobs: what is to be done.
        folder: of the results, on this machine.
        processes: how many on this machine; None: one a core; 0: none but this one. They are started fresh, with one
            thread each, so that no result depends on how many there are.
        cluster: None, or an existing Ray cluster instead: "ray" or "auto" for the one of this machine (or of
            RAY_ADDRESS), "host:port", "ray://host:port".
        title: of the progress bar.
        retries: how often a job is begun again whose worker, or its node, was lost.
        seconds: how long a job may take by the clock; whose answer is not there by then fails, its process is ended,
            and it is not begun again. Only for processes of this machine; with `processes` 0 nothing can end a job.
        failures: yield a `Failure` for a job that has no result, and keep it in the folder like one.

    Raises:
        JobsFailedError: after all others are done, jobs that raised, took too long or lost too many workers; names
            them. Not with `failures`.
        DiskFullError: there is no room for a result, or a job found none for its files; what is in `folder` is kept.
        RuntimeError: no such cluster, or Ray is not installed.
    """
    jobs = list(jobs)
    for place, job in enumerate(jobs):
        if not isinstance(job, Job):
            raise WrongTypeError(f"jobs[{place}] must be a Job, got {job!r}")
    retries = whole("retries", retries, at_least=0)
    seconds = None if seconds is None else number("seconds", seconds, "s", above=0.0)
    processes = None if processes is None else whole("processes", processes, at_least=0)
    engine: Engine = partial(local.run, processes=processes, seconds=seconds)
    if cluster is not None:
        for name, value in (("processes", processes), ("seconds", seconds)):
            if value is not None:
                raise ValueError(f"{name} are those of this machine: give {name} or cluster, not both")
        engine = partial(ray_cluster.run, address=cluster)
    return _gather(jobs, Path(folder), engine, title, retries, failures)


def gather_all(jobs: Iterable[Job], folder: Path | str, **options: Any) -> list[Any]:  # as `gather`
    """Return the results in the order of the jobs; options and errors are those of `gather`."""
    answers = dict(gather(jobs, folder, **options))
    return [answers[place] for place in range(len(answers))]


def _gather(
    jobs: Sequence[Job], folder: Path, engine: Engine, title: str, retries: int, failures: bool
) -> Iterator[tuple[int, Answer]]:
    places: dict[str, list[int]] = {}
    for place, job in enumerate(jobs):
        places.setdefault(job.key, []).append(place)
    missing: list[Job] = []
    failed: list[tuple[Job, Failure]] = []
    bar = tqdm(total=len(jobs), desc=title, smoothing=0.02, disable=not jobs)
    with bar, closing(Store(folder)) as store:
        for key, same in places.items():
            kept = store.read(key)
            if kept is None or (isinstance(kept, Failure) and not failures):
                missing.append(jobs[same[0]])
                continue
            bar.update(len(same))
            yield from ((place, copy(kept)) for place in same)
        if missing:
            with closing(engine(missing, retries)) as answers:
                for number, answer in answers:
                    if isinstance(answer, DiskFullError):
                        raise answer
                    job = missing[number]
                    bar.update(len(places[job.key]))
                    if isinstance(answer, Failure) and not failures:
                        failed.append((job, answer))
                        continue
                    store.write(job, answer)
                    yield from ((place, copy(answer)) for place in places[job.key])
    if failed:
        raise JobsFailedError(failed, len(jobs))
