"""Errors and processor times (one thread) of solvers, for whole approaches and for first contacts alone."""

from collections.abc import Sequence
from dataclasses import replace
from statistics import median
from time import thread_time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import impact_gym as ig
from experiments import reference
from experiments.lab.study import Row
from experiments.studies.solvers import compiled, taylor
from experiments.studies.solvers.approaches import CRUISE, Approach, named

SWEEP, CALL = "impact_gym, sweep", "impact_gym, simulate"
PLAIN, CVODE, HEYOKA, LANES, SCIPY = "plain C", "CVODE", "heyoka", "heyoka, batch", "SciPy"
METHODS = ("RK45", "DOP853", "LSODA")  # of SciPy, in the slow independent solver `experiments.reference`
# modules on which the rows of all solvers depend, in addition to `experiments.lab.study.SOLVER`
JUDGES = ("experiments.reference", "experiments.lab.scenes", "experiments.studies.solvers")
APPROACH, CONTACT = "approaches", "contacts"  # what is computed: whole approaches, or first contacts alone
TRUE_RTOL = 1e-13  # rtol of the slow solver (DOP853) that computes the truth
ROWS, JUDGED = 1024, 8  # approaches with objects of other masses; how many of them are compared with the truth
SPREAD = 0.03  # the masses differ by up to this part from that of the named approach
BATCHES = (SWEEP, PLAIN, LANES)  # timed on all approaches at once; the others on JUDGED approaches
GAVE_UP, WRONG, TOO_WRONG = "gave up", "V_p wrong", 1e-2  # failures; m/s, error of V_p above which a solver has failed
LEAST, SLOW = 5e-3, 0.2  # s; a call is repeated in a round for LEAST, and made in the first round only if SLOW

Floats = NDArray[np.float64]


class Work(NamedTuple):
    """Approaches that differ in the object's mass (kg) and in their durations (s)."""

    approach: Approach
    masses: Floats
    durations: Floats
    starts: Floats | None = None  # s, just before the touch, from where the time is measured; None: from the start

    def part(self, rows: slice) -> "Work":
        """Return some of the approaches."""
        starts = None if self.starts is None else self.starts[rows]
        return Work(self.approach, self.masses[rows], self.durations[rows], starts)

    def rows(self) -> list[Approach]:
        """Return the approaches one by one."""
        (scene, motion, _), numbers = self.approach, zip(self.masses.tolist(), self.durations.tolist(), strict=True)
        return [Approach(replace(scene, object=replace(scene.object, mass=m)), motion, t) for m, t in numbers]


def problem(name: str, what: str, rows: int = ROWS) -> tuple[Work, Work, Floats]:
    """Return approaches like a named one; some of them, and one that ends at as many times within contacts; their V_p.

    A contact alone has no brake; its run ends 1 % after it.
    """
    approach, middle = named()[name][1], rows // 2
    masses = approach.scene.object.mass * np.linspace(1.0 - SPREAD, 1.0 + SPREAD, rows)
    work = Work(approach, masses, np.full(rows, approach.duration))
    if what == CONTACT:
        work = work._replace(approach=approach._replace(motion=replace(approach.motion, brake=CRUISE.brake)))
        firsts = [ig.simulate(*each, TRUE_RTOL).contacts[0][:2] for each in work.rows()]
        starts, ends = np.array(firsts, float).T
        work = work._replace(durations=ends + 0.01 * (ends - starts), starts=starts - 1e-9)
    some, end = work.part(slice(None, None, rows // JUDGED)), work.durations[middle]
    contacts = reference.simulate(*work.rows()[middle], TRUE_RTOL).contacts
    edges = np.ravel([(one.start, end if one.end is None else one.end) for one in contacts])
    inside = np.append(0.0, np.cumsum(np.diff(edges) * (np.arange(1, len(edges)) % 2)))  # s, in contact up to each edge
    times = np.interp((np.arange(JUDGED) + 0.5) / JUDGED * inside[-1], inside, edges)
    durations = np.append(some.durations, times)
    judged = Work(work.approach, np.append(some.masses, np.full(JUDGED, masses[middle])), durations)
    return work, judged, np.array([reference.simulate(*each, TRUE_RTOL).object_velocity for each in judged.rows()])


def solved(solver: str, work: Work, setting: Any) -> tuple[Floats, NDArray[np.int64], float]:
    """Return the objects' final velocities (m/s), the counts of contacts, and the processor time (s).

    impact_gym: the whole call. Plain C and CVODE: the compiled loop. heyoka: in the library. SciPy: in contacts only,
    because the slow solver computes flights without METHODS.
    """
    kind, _, method = solver.partition(": ")
    (scene, motion, _), masses, durations, starts = work
    begun = thread_time()
    if kind == SWEEP:
        found = ig.sweep(scene, motion, {"object.mass": masses}, durations, setting, threads=1)
        return found.object_velocity, found.contact_count, thread_time() - begun
    if kind in (PLAIN, CVODE):
        return compiled.approaches(kind == CVODE, scene, motion, masses, durations, setting)
    if kind == LANES:
        velocities, seconds = taylor.first_contacts(work.approach, masses, setting)
        return velocities, np.ones(len(velocities), np.int64), seconds
    results = []
    for row in work.rows():
        begun = thread_time()
        if kind == HEYOKA:
            run = taylor.TaylorApproach(*row, setting)
            end = run.solve()
            results.append((end.velocity, end.contacts, run.seconds[1] + (starts is None) * run.seconds[0]))
        elif kind == SCIPY:
            slow = reference.simulate(*row, setting, method)
            results.append((slow.object_velocity, len(slow.contacts), slow.contact_seconds))
        else:
            ours = ig.simulate(*row, setting)
            results.append((ours.object_velocity, len(ours.contacts), thread_time() - begun))
    found_velocities, counts, times = zip(*results, strict=True)
    return np.array(found_velocities), np.array(counts), sum(times)


def microseconds(solver: str, work: Work, setting: Any) -> float:
    """Return the processor time (µs) of an approach of `work`, or of its contact alone."""
    spent, calls = 0.0, 0
    while spent < LEAST and calls < LEAST / 1e-5:
        spent, calls = spent + solved(solver, work, setting)[2], calls + 1
        if work.starts is not None and solver in (SWEEP, PLAIN, CVODE):
            spent -= solved(solver, work._replace(durations=work.starts), setting)[2]
    return 1e6 * spent / calls / len(work.masses)


def judged(solver: str, setting: Any, work: Work, some: Work, truth: Floats, counts: NDArray[np.int64]) -> Row:
    """Return errors of V_p and over the trajectory (m/s), and how many of the approaches have a wrong contact count."""
    try:  # a batch of heyoka cannot end within a contact
        velocities, *_ = solved(solver, some.part(slice(JUDGED if solver == LANES else None)), setting)
        wrong = int((solved(solver, work, setting)[1] != counts).sum()) if solver in BATCHES else 0
    except Exception as problem:  # a solver's failure is a result
        return {"failure": f"{GAVE_UP}: {type(problem).__name__}: {problem}".replace("\n", " ")}
    errors = np.abs(velocities - truth[: len(velocities)])
    error, along = float(errors[:JUDGED].max()), float(errors[JUDGED:].max()) if len(errors) > JUDGED else None
    failure = "" if error <= TOO_WRONG else WRONG
    return {"velocity_error": error, "path_error": along, "miscounted": wrong, "failure": failure}


def timed(
    approach: str, what: str, settings: Sequence[tuple[str, Any]], rounds: int, rows: int = ROWS, programs: str = ""
) -> list[Row]:
    """Return a row of `judged` for each setting, with the median time (µs) of `rounds` rounds of all settings.

    `programs`: the digest of the C programs, so that kept rows are of these programs.
    """
    work, some, truth = problem(approach, what, rows)
    few, counts = work.part(slice(None, None, rows // JUDGED)), solved(SWEEP, work, TRUE_RTOL)[1]
    found = [judged(solver, setting, work, some, truth, counts) for solver, setting in settings]
    times: list[list[float]] = [[] for _ in settings]
    for _ in range(rounds):
        for (solver, setting), row, spent in zip(settings, found, times, strict=True):
            of = work if solver in BATCHES else few
            if row["failure"] == "" and (not spent or spent[0] * len(of.masses) <= 1e6 * SLOW):
                spent.append(microseconds(solver, of, setting))
    return [{"solver": solver, "setting": str(setting), "microseconds": median(spent) if spent else None, **row}
            for (solver, setting), spent, row in zip(settings, times, found, strict=True)]  # fmt: skip
