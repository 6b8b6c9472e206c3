"""Errors and processor times (one thread) of solvers that compute an approach."""

import math
from collections.abc import Sequence
from time import thread_time

import impact_gym as ig
from experiments import reference
from experiments.lab.study import Row
from experiments.studies.solvers.approaches import Approach, Solution, named
from experiments.studies.solvers.taylor import TaylorApproach

OURS, SCIPY, HEYOKA = "impact_gym", "SciPy", "heyoka"  # "SciPy": `experiments.reference` with METHODS of SciPy
METHODS = ("RK45", "DOP853", "LSODA", "Radau")
# modules on which the rows of all solvers depend, in addition to `experiments.lab.study.SOLVER`
JUDGES = ("experiments.reference", "experiments.lab.scenes", "experiments.studies.solvers")
MISCOUNTED, WRONG, NOT_FINITE, GAVE_UP = "V_p right, events miscounted", "V_p wrong", "not finite", "gave up"
TOO_WRONG = 1e-2  # m/s, error of V_p above which a solver has failed
TRUE_RTOL = 1e-13  # rtol of the slow solver that computes the truth
LEAST, MOST_CALLS = 2e-2, 2000  # a call is repeated until its times sum up to LEAST (s), at most MOST_CALLS times
SLOW = 0.2  # s; a longer call is timed only in the first round


def power(value: float) -> str:
    """Return a number as text without leading zeros in a negative exponent, such as 1e-6."""
    return f"{value:g}".replace("e-0", "e-")


def failure(solution: Solution, truth: Solution, allowed: float) -> str:
    """Return why a solution is wrong; "": V_p is within `allowed` (m/s) of the truth, and the events are right."""
    if not math.isfinite(solution.velocity):
        return NOT_FINITE
    if not abs(solution.velocity - truth.velocity) <= allowed:
        return WRONG
    counts = [(one.contacts, one.passes, math.isnan(one.detection_time)) for one in (solution, truth)]
    return "" if counts[0] == counts[1] else MISCOUNTED


def solved(approach: Approach, name: str, setting: float) -> tuple[Solution, float]:
    """Return a solver's solution at the rtol `setting`, and the processor time (s).

    impact_gym: time of the call of `simulate`. SciPy: time of the contacts, because the reference computes flights
    without METHODS. heyoka: time in the library.
    """
    kind, _, method = name.partition(" ")
    if kind == SCIPY:
        outcome = reference.simulate(*approach, rtol=setting, method=method)
        return Solution.of(outcome, approach.duration), outcome.contact_seconds
    if kind == HEYOKA:
        run = TaylorApproach(*approach, setting)
        return run.solve(), run.seconds
    begun = thread_time()
    ours = ig.simulate(*approach, setting)
    seconds = thread_time() - begun
    return Solution.of(ours, approach.duration), seconds


def judged(approach: Approach, name: str, setting: float, truth: Solution) -> Row:
    """Return the shortest time of a call (µs), failure, error of V_p (m/s), counts; after an error, the first two."""
    try:
        if name == HEYOKA:  # the first call compiles
            solved(approach, name, setting)
        solution, seconds = solved(approach, name, setting)
        times = [seconds]
        while sum(times) < LEAST and len(times) < MOST_CALLS:
            times.append(solved(approach, name, setting)[1])
    except Exception as problem:  # a solver's failure is a result
        reason = f"{GAVE_UP}: {type(problem).__name__}: {problem}".replace("\n", " ")
        return {"microseconds": math.inf, "failure": reason}
    counts = {name: getattr(solution, name) for name in ("contacts", "passes")}
    found = {"microseconds": 1e6 * min(times), "velocity_error": abs(solution.velocity - truth.velocity)}
    return {**found, "failure": failure(solution, truth, TOO_WRONG), **counts}


def timed(approach: str, settings: Sequence[tuple[str, float]], rounds: int) -> list[Row]:
    """Return a row of `judged` for each setting (solver, rtol), with the shortest time of `rounds` rounds.

    The truth is that of the slow solver with DOP853.
    """
    _, found = named()[approach]
    truth = Solution.of(reference.simulate(*found, rtol=TRUE_RTOL), found.duration)
    solved(found, OURS, 1e-8)  # a first call, which loads modules and tables, is not timed
    rows: dict[tuple[str, float], Row] = {}
    for _ in range(rounds):
        for solver, setting in settings:
            before = rows.get((solver, setting), {"microseconds": math.inf})
            if before["microseconds"] <= 1e6 * SLOW or "failure" not in before:
                row = judged(found, solver, setting, truth)
                rows[solver, setting] = {**row, "microseconds": min(row["microseconds"], before["microseconds"])}
    return [{"solver": name, "setting": setting, **row} for (name, setting), row in rows.items()]
