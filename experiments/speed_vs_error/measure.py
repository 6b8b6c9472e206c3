"""Time contenders in rounds in which they take turns, judge them, and add the rows to a table."""

import math
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from tqdm import tqdm

from experiments.lab import tables as records
from experiments.lab.tables import Row
from experiments.speed_vs_error import peer
from experiments.speed_vs_error.contenders import OURS, Contender, Grid, contender, settings
from experiments.speed_vs_error.quantities import ERRORS, Answer, errors, failure
from experiments.speed_vs_error.scenes import Approach
from experiments.speed_vs_error.truth import in_parallel

LEAST = 5e-3  # s, in a round, so that the clock's grain does not matter
SLOW = 0.2  # s, of a call that is made in the first round only
SAVED_EVERY = 20  # scenes of the population


def best_times(found: Sequence[Contender], rounds: int, title: str | None) -> dict[Contender, float]:
    """Return seconds per call, the best of `rounds` rounds in which every contender has its turn.

    What fails is given inf. A first call says how many calls make a round; it is a round where one does. Whatever has
    to be compiled or loaded is so by an earlier call of the first contender, which does not count.
    """
    calls: dict[Contender, int] = {}
    best: dict[Contender, float] = {}
    with suppress(Exception):  # `solve` says why
        found[0].seconds(1)
    for turn in tqdm(range(rounds), desc=title, leave=False, disable=title is None):
        for one in found:
            if turn == 0:
                try:
                    once = one.seconds(1)
                except Exception:  # likewise
                    once = math.inf
                best[one], calls[one] = once, math.ceil(min(LEAST / max(once, 1e-9), 1e4))
                if calls[one] == 1:
                    continue
            if best[one] < SLOW:
                best[one] = min(best[one], one.seconds(calls[one]))
    return best


def judged(one: Contender, truth: Answer) -> Row:
    """Return the row of a contender without its time."""
    try:
        answer = one.solve()
    except Exception as problem:  # a failure is a result here
        nothing = dict.fromkeys((*ERRORS, "contacts", "passes"), math.nan)
        return {**nothing, "steps": 0, "failure": f"{type(problem).__name__}: {problem}".replace("\n", " ")}
    counts = {"contacts": answer.contacts, "passes": answer.passes, "steps": answer.steps}
    return {**errors(answer, truth), **counts, "failure": failure(answer, truth)}


@dataclass(frozen=True)
class Job:
    """What is to be measured of one approach."""

    approach: Approach
    truth: Answer
    fit: peer.Fit | None
    settings: tuple[tuple[str, float], ...]
    rounds: int


def measured(job: Job) -> list[Row]:
    """Return a row for each contender, timed in turns."""
    approach, load, run = job.approach, os.getloadavg()[0], datetime.now(UTC).isoformat(timespec="seconds")
    found = [contender(approach, name, setting, job.fit) for name, setting in job.settings]
    seconds = best_times(found, job.rounds, approach.name if job.rounds > 1 else None)
    about = {"rounds": job.rounds, "load": load, "run": run}
    return [
        {"scene": approach.name, "contender": one.name, "setting": one.setting, "microseconds": 1e6 * seconds[one]}
        | judged(one, job.truth)
        | about
        for one in found
    ]


def extend(
    path: Path, approaches: Sequence[Approach], grid: Grid, truth: Mapping[str, Answer],
    fits: Mapping[str, peer.Fit], rounds: int,
) -> None:  # fmt: skip
    """Measure what the table does not have; ours anew with it, so that ratios are of one run.

    In a single round the approaches are measured as many at a time as there are cores, in more one after the other.
    """
    rows = {(row["scene"], row["contender"], row["setting"]): row for row in records.read(path)}
    jobs = []
    for approach in approaches:
        left = [one for one in settings(grid) if (approach.name, *one) not in rows]
        if left:
            tried = tuple(one for one in settings(grid) if one[0] == OURS or one in left)
            jobs.append(Job(approach, truth[approach.name], fits.get(approach.name), tried, rounds))
    new = in_parallel(measured, jobs, path.stem) if rounds == 1 else map(measured, jobs)
    for count, found in enumerate(new, start=1):
        rows |= {(row["scene"], row["contender"], row["setting"]): row for row in found}
        if rounds > 1 or count % SAVED_EVERY == 0 or count == len(jobs):
            records.write(path, rows.values())
