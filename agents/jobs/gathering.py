"""Doing jobs and gathering their results: what is on disk first, then the rest as it comes."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path

from tqdm import tqdm  # type: ignore[import-untyped]

from agents.jobs import local, ray_cluster
from agents.jobs.job import Job, Result
from agents.jobs.store import Store
from agents.jobs.work import Engine, Failure
from impact_gym.validation import WrongTypeError, whole

SHOWN = 10  # failed jobs that an error names one by one


class JobsFailedError(RuntimeError):
    """Jobs have no result; those that have one are in the folder."""

    def __init__(self, failed: Sequence[tuple[Job, Failure]], count: int) -> None:
        self.failed = list(failed)
        lines = [f"{job}: {failure.reason}" for job, failure in self.failed[:SHOWN]]
        if len(self.failed) > SHOWN:
            lines.append(f"and {len(self.failed) - SHOWN} more")
        trace = next((failure.trace for _, failure in self.failed if failure.trace), "")
        head = f"{len(self.failed)} of {count} jobs failed (the others are done and kept):"
        super().__init__("\n".join([head, *lines, *([f"the first of these raised:\n{trace}"] if trace else [])]))


def gather(
    jobs: Iterable[Job],
    folder: Path | str,
    *,
    processes: int | None = None,
    cluster: str | None = None,
    title: str = "jobs",
    retries: int = 3,
) -> Iterator[tuple[int, Result]]:
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

    Raises:
        JobsFailedError: after all others are done, jobs that raised, or lost too many workers; names them.
        RuntimeError: no such cluster, or Ray is not installed.
    """
    wanted = list(jobs)
    for place, job in enumerate(wanted):
        if not isinstance(job, Job):
            raise WrongTypeError(f"jobs[{place}] must be a Job, got {job!r}")
    retries = whole("retries", retries, at_least=0)
    if cluster is not None:
        if processes is not None:
            raise ValueError("processes are those of this machine: give processes or cluster, not both")
        engine: Engine = partial(ray_cluster.run, address=cluster)
    else:
        engine = partial(local.run, processes=None if processes is None else whole("processes", processes, at_least=0))
    return _gather(wanted, Store(Path(folder)), engine, title, retries)


def gather_all(
    jobs: Iterable[Job],
    folder: Path | str,
    *,
    processes: int | None = None,
    cluster: str | None = None,
    title: str = "jobs",
    retries: int = 3,
) -> list[Result]:
    """Return the results in the order of the jobs; see `gather`."""
    wanted = list(jobs)
    came = dict(gather(wanted, folder, processes=processes, cluster=cluster, title=title, retries=retries))
    return [came[place] for place in range(len(wanted))]


def _gather(
    jobs: Sequence[Job], store: Store, engine: Engine, title: str, retries: int
) -> Iterator[tuple[int, Result]]:
    places: dict[str, list[int]] = {}
    for place, job in enumerate(jobs):
        places.setdefault(job.key, []).append(place)
    missing: list[str] = []
    failed: list[tuple[Job, Failure]] = []
    with tqdm(total=len(jobs), desc=title, smoothing=0.02) as bar:
        for key, same in places.items():
            kept = store.read(key)
            if kept is None:
                missing.append(key)
                continue
            bar.update(len(same))
            for place in same:
                yield place, dict(kept)
        if missing:
            pending = [jobs[places[key][0]] for key in missing]
            with closing(engine(pending, retries)) as answers:
                for number, answer in answers:
                    same = places[missing[number]]
                    bar.update(len(same))
                    if isinstance(answer, Failure):
                        failed.append((pending[number], answer))
                        continue
                    store.write(pending[number], answer)
                    for place in same:
                        yield place, dict(answer)
    if failed:
        raise JobsFailedError(failed, len(jobs))
