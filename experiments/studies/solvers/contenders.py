"""The contenders: all solvers that compute an approach, their times and their errors.

Times are processor times of the single thread that each contender uses. Other work on the machine lengthens a long
call, such as SciPy's, more than the best of many short calls.
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
from experiments.studies.solvers.peers import PEERS
from experiments.studies.solvers.pieces import Run
from experiments.studies.solvers.solutions import GAVE_UP, Solution, errors, failure

OURS, CAREFUL = "impact_gym", "SciPy"  # SciPy's integrators inside the reference
METHODS = ("RK45", "DOP853", "LSODA", "Radau")
JUDGES = ("experiments.reference", "experiments.lab.scenes", "experiments.studies.solvers")
"""Modules besides our solver on which the rows of contenders depend."""
TOO_WRONG = 1e-2  # m/s in V_p: an answer with a larger error is a failure
LEAST = 5e-3  # s of one timing, so that the resolution of the clock does not matter
MOST_CALLS = 10_000
TURNS, CALLS = 10, 10  # timings of each of our contacts, and calls in each timing
TIMES = ("microseconds", "contact_microseconds")
SLOW = 0.2  # s: if a call takes longer, it is timed in the first round only


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise TimeoutError after `seconds` more of this process's processor time."""

    def late(*_: Any) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGPROF, late)
    # repeated every 0.01 s, as an error that is raised in a destructor is lost
    signal.setitimer(signal.ITIMER_PROF, seconds, 0.01)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def solved(approach: Approach, name: str, setting: float) -> tuple[Solution, float, float]:
    """Return a contender's solution at a tolerance, and its processor times (s): of the approach, of the contacts.

    Our time is that of the whole call of `simulate`; for our contacts see `contacts_alone`. SciPy's time counts
    only the contacts: the reference computes flights without SciPy's methods, by the matrix exponential, or by
    integration at rtol 1e-12 where there is no closed form. A peer's time counts only the calls of its own library.
    """
    kind, _, method = name.partition(" ")
    if kind == CAREFUL:
        outcome = reference.simulate(*approach.run, rtol=setting, method=method)
        return Solution.of(outcome, approach.duration), outcome.contact_seconds, outcome.contact_seconds
    if name in PEERS:
        run = Run(*approach.run, setting, PEERS[name])
        return run.solve(), sum(run.seconds), run.seconds[True]
    begun = thread_time()
    ours = ig.simulate(*approach.run, setting)
    seconds = thread_time() - begun
    return Solution.of(ours, approach.duration), seconds, math.nan


def contacts_alone(approach: Approach, rtol: float) -> float:
    """Return our processor time of all contacts (s): that of runs up to each end less that up to each start."""
    marks = [
        mark
        for contact in ig.simulate(*approach.run, rtol).contacts
        for mark in (contact.start, approach.duration if contact.end is None else contact.end)
    ]
    best = [math.inf] * len(marks)
    for _ in range(TURNS):
        for place, mark in enumerate(marks):
            begun = thread_time()
            for _ in range(CALLS):
                ig.simulate(approach.scene, approach.motion, mark, rtol)
            best[place] = min(best[place], (thread_time() - begun) / CALLS)
    return sum(best[1::2]) - sum(best[::2])


def judged(approach: Approach, name: str, setting: float, truth: Solution) -> Row:
    """Return the row of a contender: mean processor times of a call (µs), errors, counts and failure.

    If the contender raises an error, the row has only a failure. A peer compiles in its first call, which is timed
    separately.
    """
    try:
        begun = thread_time()
        if name in PEERS:
            solved(approach, name, setting)
        first = thread_time() - begun
        solution, seconds, contacts = solved(approach, name, setting)
        calls = 1
        while seconds < LEAST and calls < MOST_CALLS:
            _, *more = solved(approach, name, setting)
            seconds, contacts, calls = seconds + more[0], contacts + more[1], calls + 1
        seconds, contacts = seconds / calls, contacts / calls
        if name == OURS:
            contacts = contacts_alone(approach, setting)
    except Exception as problem:  # any error: that a contender fails is a result here
        return {
            "microseconds": math.inf, "failure": f"{GAVE_UP}: {type(problem).__name__}: {problem}".replace("\n", " ")
        }  # fmt: skip
    counts = {name: getattr(solution, name) for name in ("contacts", "passes", "steps")}
    times = {"microseconds": 1e6 * seconds, "contact_microseconds": 1e6 * contacts, "first_seconds": first}
    return {**times, "failure": failure(solution, truth, TOO_WRONG), **errors(solution, truth), **counts}


def timed(approach: str, truth: Mapping[str, Any], settings: Sequence[tuple[str, float]], rounds: int) -> list[Row]:
    """Return a row for each setting (contender, tolerance) on a named approach: the best of some rounds.

    In each round all settings are timed in turn.
    """
    found, true, load = approach_of(approach), Solution(**truth), os.getloadavg()[0]
    solved(found, OURS, 1e-8)  # a first call, which loads modules and tables, before anything is timed
    rows: dict[tuple[str, float], Row] = {}
    for _ in range(rounds):
        for contender, setting in settings:
            before = rows.get((contender, setting))
            if before and before["microseconds"] > 1e6 * SLOW:
                continue
            row = judged(found, contender, setting, true)
            best = {name: min(row[name], before[name]) for name in TIMES if name in row} if before else {}
            rows[contender, setting] = {**row, **best, "first_seconds": (before or row).get("first_seconds")}
    return [{"contender": name, "setting": setting, **row, "load": load} for (name, setting), row in rows.items()]
