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
from experiments.studies.solvers.peers import PEERS
from experiments.studies.solvers.pieces import Run
from experiments.studies.solvers.solutions import GAVE_UP, Solution, errors, failure

OURS, CAREFUL = "impact_gym", "SciPy"  # SciPy's integrators in the reference
METHODS = ("RK45", "DOP853", "LSODA", "Radau")
JUDGES = ("experiments.reference", "experiments.lab.scenes", "experiments.studies.solvers")
"""Modules that rows of contenders follow from, beside our solver."""
TOO_WRONG = 1e-2  # m/s in V_p: then an answer is a failure
LEAST = 5e-3  # s, in a round, so that the clock's grain does not matter
MOST_CALLS = 10_000
TURNS, CALLS = 10, 10  # how often a contact of ours is timed, and how many calls are one timing
TIMES = ("microseconds", "contact_microseconds")
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


def solved(approach: Approach, name: str, setting: float) -> tuple[Solution, float, float]:
    """Return the solution of a contender at a tolerance, and the processor time that it is charged, s: all, contacts.

    Ours is charged all the way from the scene to the outcome; of its contacts see `contacts_alone`. SciPy is charged
    the contacts alone: the reference, which drives it, flies by the matrix exponential, or at rtol 1e-12 where there is
    no closed form. Of a peer the calls of its own library count.
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
    """Return our processor time of all contacts, s: of runs that end behind each, less those that end before it."""
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


def averaged(approach: Approach, name: str, setting: float, least: float) -> tuple[Solution, float, float]:
    """Return what `solved` does, the times as the mean of so many calls as take at `least` s."""
    solution, spent, contacts = solved(approach, name, setting)
    calls = 1
    while spent < least and calls < MOST_CALLS:
        _, more, of_contacts = solved(approach, name, setting)
        spent, contacts, calls = spent + more, contacts + of_contacts, calls + 1
    return solution, spent / calls, contacts / calls


def judged(
    approach: Approach, name: str, setting: float, truth: Solution, allowed: float, counted: Sequence[str]
) -> Row:
    """Return the row of a contender: times of a call, errors, counts and failure; see `averaged` and `failure`.

    A contender that raises an error has a failure and no more. What a peer compiles at its first call is apart.
    """
    try:
        begun = thread_time()
        if name in PEERS:
            solved(approach, name, setting)
        first = thread_time() - begun
        solution, seconds, contacts = averaged(approach, name, setting, LEAST)
        if name == OURS:
            contacts = contacts_alone(approach, setting)
    except Exception as problem:  # of any kind: a failure is a result here
        return {
            "microseconds": math.inf, "failure": f"{GAVE_UP}: {type(problem).__name__}: {problem}".replace("\n", " ")
        }  # fmt: skip
    counts = {name: getattr(solution, name) for name in ("contacts", "passes", "steps")}
    found = failure(solution, truth, allowed, counted)
    times = {"microseconds": 1e6 * seconds, "contact_microseconds": 1e6 * contacts, "first_seconds": first}
    return {**times, "failure": found, **errors(solution, truth), **counts}


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
            best = {name: min(row[name], before[name]) for name in TIMES if name in row} if before else {}
            rows[contender, setting] = {**row, **best, "first_seconds": (before or row).get("first_seconds")}
    return [{"contender": name, "setting": setting, **row, "load": load} for (name, setting), row in rows.items()]
