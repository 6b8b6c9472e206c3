"""Who else stands in the storm: SciPy's solvers and fixed steps on the same scenes, each with its time to run out.

A sample of the scenes that all can do: a contact with m = n = 3/2 and a rigid robot. What an answer is worth is judged
by the independent solver.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import count as numbers_from
from itertools import islice
from pathlib import Path
from time import thread_time
from typing import Any

import impact_gym as ig
from experiments import reference
from experiments.reference.chain import System
from experiments.speed_vs_error import by_hand, records
from experiments.speed_vs_error.contenders import METHODS, OURS
from experiments.speed_vs_error.quantities import Answer, answer_of
from experiments.speed_vs_error.records import Row
from experiments.speed_vs_error.scenes import Approach
from experiments.stability import plain_ivp
from experiments.stability.agreement import relative_error
from experiments.stability.plain_ivp import OutOfTimeError
from experiments.stability.scenes import draw
from experiments.stability.storm import sources
from experiments.stability.workers import Job, answers

SECONDS = 5.0  # of processor time for a run: a hundred times what ours may take
RTOL, ATOL = 1e-6, 1e-9
OUR_RTOL = 1e-8
CLOSE = 1e-3  # of V_p, relative
STEPS = (1e-4, 1e-5)  # s
PLAIN = ("RK45", "LSODA", "Radau")
GOOD, MISCOUNTED, WRONG, NOT_FINITE, LATE, GAVE_UP = (
    "V_p within 1e-3, contacts right",
    "V_p within 1e-3, contacts miscounted",
    "V_p wrong",
    "not finite",
    "no answer in 5 s",
    "gave up",
)
CLASSES = (GOOD, MISCOUNTED, WRONG, NOT_FINITE, LATE, GAVE_UP)


@dataclass(frozen=True)
class Rival:
    """A way to compute an approach."""

    name: str
    solve: Callable[[Approach], Answer]


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Let the reference raise OutOfTimeError once it has used so much processor time, s."""
    plain, deadline = System.derivatives, thread_time() + seconds

    def derivatives(self: System, tau: float, y: list[float]) -> list[float]:
        if thread_time() > deadline:
            raise OutOfTimeError
        return plain(self, tau, y)

    System.derivatives = derivatives  # type: ignore[method-assign]
    try:
        yield
    finally:
        System.derivatives = plain  # type: ignore[method-assign]


def ours(approach: Approach) -> Answer:
    """By impact_gym."""
    return answer_of(ig.simulate(approach.scene, approach.motion, approach.duration, OUR_RTOL), approach.duration)


def careful(approach: Approach, method: str) -> Answer:
    """One of SciPy's integrators, driven by the reference: scaled contacts, exact flight, every event looked for."""
    with limited(SECONDS):
        found = reference.simulate(approach.scene, approach.motion, approach.duration, rtol=RTOL, method=method)
    return answer_of(found, approach.duration)


def plain(approach: Approach, method: str) -> Answer:
    """solve_ivp as people write it."""
    return plain_ivp.solve(approach, method, RTOL, ATOL, SECONDS)


def fixed(approach: Approach, method: str, step: float) -> Answer:
    """A fixed step, without events."""
    return by_hand.solve(method, approach, step)


def rivals() -> tuple[Rival, ...]:
    """Return all of them."""
    found = [Rival(OURS, ours)]
    found += [Rival(f"{method}, careful events", partial(careful, method=method)) for method in METHODS]
    found += [Rival(f"{method}, solve_ivp events", partial(plain, method=method)) for method in PLAIN]
    found += [
        Rival(f"{method}, {step:g} s", partial(fixed, method=method, step=step))
        for method in by_hand.METHODS
        for step in STEPS
    ]
    return tuple(found)


def eligible(approach: Approach) -> bool:
    """Whether all of them can do it."""
    contact = approach.scene.contact
    return contact.stiffness_exponent == contact.damping_exponent == 1.5 and approach.scene.robot is None


def sample(size: int) -> list[int]:
    """Return the numbers of the first `size` scenes that all can do."""
    return list(islice((number for number in numbers_from() if eligible(draw(number))), size))


def grade(answer: Answer, truth: Row) -> str:
    """Return one of CLASSES."""
    if not math.isfinite(answer.velocity):
        return NOT_FINITE
    if not relative_error(answer.velocity, truth["velocity"], truth["speed"]) <= CLOSE:
        return WRONG
    return GOOD if answer.contacts == truth["contacts"] else MISCOUNTED


def row_of(rival: Rival, number: int, truth: Row) -> Row:
    """Return the row of a rival on a scene."""
    approach, begun = draw(number), thread_time()
    row = {"scene": str(number), "contender": rival.name, "run": sources() if rival.name == OURS else ""}
    empty = {"velocity_error": math.nan, "contacts": math.nan, "true_contacts": truth["contacts"]}
    try:
        answer = rival.solve(approach)
    except OutOfTimeError:
        return row | {"failure": LATE, "seconds": thread_time() - begun, **empty}
    except Exception:  # of any kind: it is counted
        return row | {"failure": GAVE_UP, "seconds": thread_time() - begun, **empty}
    empty |= {
        "velocity_error": relative_error(answer.velocity, truth["velocity"], truth["speed"]),
        "contacts": answer.contacts,
    }
    return row | {"failure": grade(answer, truth), "seconds": thread_time() - begun, **empty}


def rows_of(task: tuple[int, Row, tuple[str, ...]]) -> list[Row]:
    """Return the rows of the rivals named, on a scene."""
    number, truth, names = task
    return [row_of(rival, number, truth) for rival in rivals() if rival.name in names]


def _silent(task: tuple[int, Row, tuple[str, ...]], reason: str) -> list[Row]:
    """One of the rivals was somewhere that it did not look at its time: all of the task count as late, ours too."""
    number, truth, names = task
    blank: dict[str, Any] = {"seconds": math.nan, "velocity_error": math.nan, "contacts": math.nan}
    head = {"scene": str(number), "run": "", "failure": LATE, "true_contacts": truth["contacts"]}
    return [head | blank | {"contender": name} for name in names]


def extend(path: Path, truths: Mapping[int, Row], names: Sequence[str], processes: int | None = None) -> list[Row]:
    """Return the rows of the rivals named on the scenes whose truth is known; compute what the table has not."""
    rows = {(row["scene"], row["contender"]): row for row in records.read(path)}
    rows = {key: row for key, row in rows.items() if row["contender"] != OURS or row["run"] == sources()}
    known = {number: truth for number, truth in truths.items() if not truth["failure"]}
    tasks = [
        (number, truth, (name,)) for number, truth in known.items() for name in names if (str(number), name) not in rows
    ]
    order = [(str(number), name) for number in known for name in names]
    job = Job(rows_of, by_hand.compile_now)
    for done, new in enumerate(answers(job, tasks, 12 * SECONDS, _silent, "rivals", processes), start=1):
        rows |= {(row["scene"], row["contender"]): row for row in new}
        if done % 100 == 0 or done == len(tasks):
            records.write(path, [rows[key] for key in order if key in rows])
    return [rows[key] for key in order]


def table(rows: Sequence[Row], names: Sequence[str]) -> list[Row]:
    """Return, by rival, the share in each class, of those that missed contacts, and the median time, s."""
    found: list[Row] = []
    for name in names:
        here = [row for row in rows if row["contender"] == name]
        if here:
            shares: Row = {kind: sum(row["failure"] == kind for row in here) / len(here) for kind in CLASSES}
            missed = sum(row["contacts"] < row["true_contacts"] for row in here) / len(here)
            times = sorted(math.inf if math.isnan(row["seconds"]) else row["seconds"] for row in here)
            found.append({"contender": name, **shares, "missed": missed, "seconds": times[len(times) // 2]})
    return found
