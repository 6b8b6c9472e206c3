"""Everyone who computes an approach, how long it takes them, and how wrong they are.

Times are processor times of the one thread that each contender uses: what else runs on the machine would lengthen long
calls, SciPy's, more than the best of many short ones.
"""

import math
import os
import signal
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from time import thread_time
from typing import Any

import impact_gym as ig
from experiments import reference
from experiments.lab.study import Row
from experiments.studies.solvers.approaches import Approach, approach_of
from experiments.studies.solvers.solutions import GAVE_UP, Solution, errors, failure

OURS, CAREFUL = "impact_gym", "SciPy"  # SciPy's integrators in the reference
METHODS = ("RK45", "DOP853", "LSODA", "Radau")
JUDGES = ("experiments.reference", "experiments.lab.scenes", "experiments.studies.solvers")
"""Modules that rows of contenders follow from, beside our solver."""
TOO_WRONG = 1e-2  # m/s in V_p: then an answer is a failure
LEAST = 5e-3  # s, in a round, so that the clock's grain does not matter
MOST_CALLS = 10_000
SLOW = 0.2  # s, of a call that is made in the first round only


@contextmanager
def limited(seconds: float | None) -> Iterator[None]:
    """Raise TimeoutError once this process has used so much more processor time, s."""

    def late(*_: Any) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGPROF, late)
    # more than once: a destructor swallows what is raised in it
    signal.setitimer(signal.ITIMER_PROF, seconds or 0.0, 0.01)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def solved(approach: Approach, name: str, setting: float) -> tuple[Solution, float]:
    """Return the solution of a contender at a tolerance, and the processor time that it is charged, s.

    Ours is charged all the way from the scene to the outcome. SciPy is charged the contacts alone: the reference,
    which drives it, flies by the matrix exponential, or at rtol 1e-12 where there is no closed form.
    """
    kind, _, method = name.partition(" ")
    if kind == CAREFUL:
        outcome = reference.simulate(*approach.run, rtol=setting, method=method)
        return Solution.of(outcome, approach.duration), outcome.contact_seconds
    begun = thread_time()
    ours = ig.simulate(*approach.run, setting)
    seconds = thread_time() - begun
    return Solution.of(ours, approach.duration), seconds


def averaged(approach: Approach, name: str, setting: float, least: float) -> tuple[Solution, float]:
    """Return what `solved` does, the time as the mean of so many calls as take at `least` s."""
    solution, spent = solved(approach, name, setting)
    calls = 1
    while spent < least and calls < MOST_CALLS:
        spent += solved(approach, name, setting)[1]
        calls += 1
    return solution, spent / calls


def judged(
    approach: Approach, name: str, setting: float, truth: Solution, allowed: float, counted: Sequence[str]
) -> Row:
    """Return the row of a contender: time of a call, errors, counts and failure; see `averaged` and `failure`.

    A contender that raises an error has a failure and no more.
    """
    try:
        solution, seconds = averaged(approach, name, setting, LEAST)
    except Exception as problem:  # of any kind: a failure is a result here
        return {
            "microseconds": math.inf, "failure": f"{GAVE_UP}: {type(problem).__name__}: {problem}".replace("\n", " ")
        }  # fmt: skip
    counts = {name: getattr(solution, name) for name in ("contacts", "passes", "steps")}
    found = failure(solution, truth, allowed, counted)
    return {"microseconds": 1e6 * seconds, "failure": found, **errors(solution, truth), **counts}


def timed(approach: str, truth: Mapping[str, Any], settings: Sequence[tuple[str, float]], rounds: int) -> list[Row]:
    """Return a row for each setting (contender, tolerance) on a named approach, the best of rounds taken in turns."""
    found, true, load = approach_of(approach), Solution(**truth), os.getloadavg()[0]
    counted = ("contacts", "passes", "alarms")
    solved(found, OURS, 1e-8)  # what is loaded at first use is so before time is taken
    rows: dict[tuple[str, float], Row] = {}
    for _ in range(rounds):
        for contender, setting in settings:
            before = rows.get((contender, setting))
            if before and before["microseconds"] > 1e6 * SLOW:
                continue
            row = judged(found, contender, setting, true, TOO_WRONG, counted)
            best = min(row["microseconds"], before["microseconds"]) if before else row["microseconds"]
            rows[contender, setting] = {**row, "microseconds": best}
    return [{"contender": name, "setting": setting, **row, "load": load} for (name, setting), row in rows.items()]
