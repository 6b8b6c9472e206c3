"""Times of contenders, in rounds in which they take turns, and their errors."""

import math
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime

from tqdm import tqdm

from agents.jobs import Result
from experiments import reference
from experiments.lab.tables import Gather, Row, result_of, solver_and
from experiments.speed_vs_error import by_hand, contenders, peer, quantities, taylor
from experiments.speed_vs_error.contenders import Contender, contender
from experiments.speed_vs_error.quantities import ERRORS, Solution, as_json, errors, failure, from_json
from experiments.speed_vs_error.scenes import SOURCES, Approach, approach_of

LEAST = 5e-3  # s, in a round, so that the clock's grain does not matter
SLOW = 0.2  # s, of a call that is made in the first round only


def best_times(found: Sequence[Contender], rounds: int, title: str | None) -> dict[Contender, float]:
    """Return seconds per call, the best of `rounds` rounds in which every contender has its turn.

    What fails is given inf. A first call says how many calls make a round; it is a round where one does. Whatever has
    to be compiled or loaded is so by an earlier call of the first contender, which does not count.
    """
    calls: dict[Contender, int] = {}
    best: dict[Contender, float] = {}
    with suppress(Exception):  # `solve` says why
        found[0].seconds(1)
    # not in a worker: what tqdm holds of the system is lost when its process is ended
    for turn in range(rounds) if title is None else tqdm(range(rounds), desc=title, leave=False):
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


def judged(one: Contender, truth: Solution) -> Row:
    """Return the row of a contender without its time."""
    try:
        found = one.solve()
    except Exception as problem:  # a failure is a result here
        nothing = dict.fromkeys((*ERRORS, "contacts", "passes"), math.nan)
        return {**nothing, "steps": 0, "failure": f"{type(problem).__name__}: {problem}".replace("\n", " ")}
    counts = {name: getattr(found, name) for name in ("contacts", "passes", "steps")}
    return {**errors(found, truth), **counts, "failure": failure(found, truth)}


def timed(
    approach: Approach, truth: Solution, fit: peer.Fit | None, tried: Sequence[tuple[str, float]], rounds: int
) -> list[Row]:
    """Return a row for each contender that is tried on an approach, timed in turns; MuJoCo needs its fit."""
    load, run = os.getloadavg()[0], datetime.now(UTC).isoformat(timespec="seconds")
    found = [contender(approach, name, setting, fit) for name, setting in tried]
    seconds = best_times(found, rounds, approach.name if rounds > 1 else None)
    circumstances = {"rounds": rounds, "load": load, "run": run}
    return [
        {"scene": approach.name, "contender": one.name, "setting": one.setting, "microseconds": 1e6 * seconds[one]}
        | judged(one, truth)
        | circumstances
        for one in found
    ]


def measured(
    scene: str, truth: Mapping[str, float | None], fit: Mapping[str, float] | None,
    tried: Sequence[tuple[str, float]], rounds: int,
) -> Result:  # fmt: skip
    """Return the rows of `timed` for a scene by its name, as a job."""
    by_hand.compile_now()
    contact = None if fit is None else peer.Fit(**fit)
    return result_of(timed(approach_of(scene), from_json(truth), contact, tried, rounds))


def rows(
    gather: Gather, title: str, truths: Mapping[str, Solution], fits: Sequence[Row],
    tried: Sequence[tuple[str, float]], rounds: int,
) -> list[Row]:  # fmt: skip
    """Return the rows of all approaches whose truth is given.

    In a single round they are measured as many at a time as there are processes, in more one after the other, here.
    """
    judges = (by_hand, contenders, peer, quantities, reference, taylor)
    depends = solver_and(*(judge.__name__ for judge in judges), __name__, *SOURCES)
    fit = {row["scene"]: {name: row[name] for name in ("stiffness", "damping")} for row in fits}
    about = {"tried": [list(one) for one in tried], "rounds": rounds}
    asked = [{"scene": name, "truth": as_json(true), "fit": fit.get(name)} | about for name, true in truths.items()]
    return gather(title, measured, asked, depends, **({"processes": 0} if rounds > 1 else {}))
