"""A contest: everyone who computes an approach, how long it takes them, and how wrong they are.

Times are processor times of the one thread that each contender uses: what else runs on the machine would lengthen long
calls, SciPy's, more than the best of many short ones.
"""

import math
import os
import signal
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from itertools import count, islice
from time import thread_time
from typing import Any

import numpy as np
import polars as pl
from tqdm import tqdm

import impact_gym as ig
from agents.jobs import Result, digest_of
from experiments import reference
from experiments.lab.tables import Gather, Row, result_of, solver_and
from experiments.solver import by_hand, solutions
from experiments.solver.approaches import Approach, approach_of, storm
from experiments.solver.solutions import ERRORS, OURS, SHARED, Solution, errors, failure, known

METHODS = ("RK45", "DOP853", "LSODA", "Radau")
CAREFUL, PLAIN = "SciPy", "solve_ivp"  # SciPy's integrators in the reference; as people write it
NAMES = (OURS, *(f"{CAREFUL} {method}" for method in METHODS), *by_hand.METHODS)
RTOLS = tuple(float(f"1e-{k}") for k in range(3, 13))
STEPS = tuple(float(f"{step:.2g}") for step in np.geomspace(1e-3, 1e-6, 10))  # s
TOO_WRONG = 1e-2  # m/s in V_p: then an answer is a failure
LEAST = 5e-3  # s, in a round, so that the clock's grain does not matter
MOST_CALLS = 10_000
SLOW = 0.2  # s, of a call that is made in the first round only
FINE = 1e-6  # m/s in V_p
RIVALS = {  # on the page about speed, and the error at which each is compared
    "scipy": ([name for name in NAMES if name.startswith(CAREFUL)], FINE),
    "by_hand": ([*by_hand.METHODS], FINE),
}
OUR_RTOL, RTOL, ATOL = 1e-8, 1e-6, 1e-9
CLOSE = 1e-3  # of V_p, relative: then a rival stands in a scene of the storm
SECONDS = 5.0  # of processor time for a run in the storm: a hundred times what ours may take
IN_THE_STORM = [
    (OURS, OUR_RTOL),
    *((f"{CAREFUL} {method}", RTOL) for method in METHODS),
    *((f"{PLAIN} {method}", RTOL) for method in ("RK45", "LSODA", "Radau")),
    *((method, step) for method in by_hand.METHODS for step in (1e-4, 1e-5)),
]
Settings = Sequence[tuple[str, float]]
"""Contenders, each with a tolerance or a step (s)."""


def settings(
    rtols: Sequence[float] = RTOLS, scipy_rtols: Sequence[float] = RTOLS, steps: Sequence[float] = STEPS
) -> Settings:  # fmt: skip
    """Return who is tried at which tolerance or step, ours first."""
    tried = {OURS: rtols, **{f"{CAREFUL} {method}": scipy_rtols for method in METHODS}}
    tried |= {method: steps for method in by_hand.METHODS}
    return [(name, setting) for name in tried for setting in tried[name]]


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
    """Return the solution of a contender at a tolerance or step (s), and the processor time that it is charged, s.

    Ours is charged all the way from the scene to the outcome. SciPy is charged the contacts alone: the reference,
    which drives it, flies by the matrix exponential, or at rtol 1e-12 where there is no closed form. Turning the scene
    into numbers is free of charge for a fixed step.
    """
    kind, _, method = name.partition(" ")
    if kind == CAREFUL:
        outcome = reference.simulate(*approach.run, rtol=setting, method=method)
        return Solution.of(outcome, approach.duration), outcome.contact_seconds
    begun = thread_time()
    if name == OURS:
        ours = ig.simulate(*approach.run, setting)
        seconds = thread_time() - begun
        return Solution.of(ours, approach.duration), seconds
    if kind == PLAIN:
        return by_hand.with_events(approach, method, setting, ATOL), thread_time() - begun
    return by_hand.fixed_step(approach, name, setting), thread_time() - begun


def averaged(approach: Approach, name: str, setting: float, least: float) -> tuple[Solution, float]:
    """Return what `solved` does, the time as the mean of so many calls as take at `least` s."""
    solution, spent = solved(approach, name, setting)
    calls = 1
    while spent < least and calls < MOST_CALLS:
        spent += solved(approach, name, setting)[1]
        calls += 1
    return solution, spent / calls


def timed(
    approach: Approach, truth: Solution, tried: Settings, rounds: int,
    allowed: float = TOO_WRONG, counted: Sequence[str] = ("contacts", "passes", "alarms"), limit: float | None = None,
) -> list[Row]:  # fmt: skip
    """Return a row for each contender that is tried on an approach.

    Its time is the best of `rounds` rounds in which all take turns. What has to be compiled or loaded is so before.
    With a `limit` (s) there is one call, which may take so long. What is `allowed` and `counted`, see `failure`.
    """
    circumstances = {"rounds": rounds, "load": os.getloadavg()[0], "run": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%S}"}
    nothing = dict.fromkeys((*ERRORS, "contacts", "passes"), math.nan) | {"steps": 0}
    rows = [
        approach.labels | {"contender": name, "setting": setting, "microseconds": math.inf} for name, setting in tried
    ]
    by_hand.compile_now()
    with suppress(Exception):
        solved(approach, OURS, OUR_RTOL)
    # not in a worker: what tqdm holds of the system is lost when its process is ended
    for number in range(rounds) if rounds == 1 else tqdm(range(rounds), desc=approach.name, leave=False):
        for row, (name, setting) in zip(rows, tried, strict=True):
            if number and row["microseconds"] > 1e6 * SLOW:
                continue
            try:
                with limited(limit):
                    solution, seconds = averaged(approach, name, setting, 0.0 if limit else LEAST)
            except Exception as problem:  # of any kind: a failure is a result here
                reason = f"{solutions.GAVE_UP}: {type(problem).__name__}: {problem}".replace("\n", " ")
                late = isinstance(problem, TimeoutError)
                row |= {"microseconds": math.inf, "failure": solutions.LATE if late else reason} | nothing
            else:
                row["microseconds"] = min(row["microseconds"], 1e6 * seconds)
                row |= errors(solution, truth)
                row |= {name: getattr(solution, name) for name in ("contacts", "passes", "steps")}
                row["failure"] = failure(solution, truth, allowed, counted)
    return [row | {"true_contacts": truth.contacts} | circumstances for row in rows]


def timed_rows(approach: str | int, truth: Mapping[str, Any], **options: Any) -> Result:
    """Return the rows of `timed`, as a job; `options` are its others."""
    return result_of(timed(approach_of(approach), Solution(**truth), **options))


JUDGES = (by_hand.__name__, reference.__name__, __name__, *SHARED)


def in_turns(gather: Gather, truths: Mapping[str, Solution], tried: Settings, rounds: int) -> list[Row]:
    """Return the rows of all approaches whose truth is given, measured one after the other, here."""
    about = {"tried": [list(setting) for setting in tried], "rounds": rounds}
    jobs = [{"approach": name, "truth": truth.numbers} | about for name, truth in truths.items()]
    return gather("named", timed_rows, jobs, solver_and(*JUDGES), processes=0)


def eligible(scene: ig.Scene) -> bool:
    """Whether all rivals can do it: a contact with m = n = 3/2 and a rigid robot."""
    return scene.contact.stiffness_exponent == scene.contact.damping_exponent == 1.5 and scene.robot is None


def sample(size: int) -> list[int]:
    """Return the numbers of the first `size` scenes of the storm that all can do."""
    return list(islice((number for number in count() if eligible(storm(number).scene)), size))


def in_storm(gather: Gather, truths: Mapping[int, Row], tried: Settings) -> list[Row]:
    """Return the rows of rivals on the scenes of the storm whose truth is known; who hangs, hangs alone."""
    jobs: list[Mapping[str, Any]] = []
    for scene, true in truths.items():
        if not true["failure"]:
            allowed = CLOSE * max(abs(true["velocity"]), 1e-6 * true["speed"])
            judged = {"truth": Solution.of_row(true).numbers, "allowed": allowed, "counted": ["contacts"]}
            about = {"approach": scene, "rounds": 1, "limit": SECONDS} | judged
            jobs += [about | {"tried": [[name, setting]]} for name, setting in tried]
    rows: list[Row] = []
    for ours, depends in ((True, solver_and(*JUDGES)), (False, digest_of(*JUDGES))):  # others not on our solver
        asked = [job for job in jobs if (job["tried"][0][0] == OURS) == ours]
        rows += gather("rivals", timed_rows, asked, depends, failed=_known, seconds=12 * SECONDS)
    return rows


def _known(job: Mapping[str, Any]) -> Row:
    """Return the row of a job of one rival that has no result."""
    ((contender, setting),) = job["tried"]
    return known(job) | {"contender": contender, "setting": setting}


def shares(rows: Sequence[Row]) -> list[Row]:
    """Return, by rival, the share in each class, of those that missed contacts, and the median time, s.

    Who was somewhere that it did not look at its time, and had to be ended, counts as late.
    """
    kind = pl.col("failure").str.split(":").list.first().replace("", solutions.GOOD)
    name = pl.when(pl.col("contender").is_in(by_hand.METHODS)).then(pl.format("{}, {} s", "contender", "setting"))
    return (
        pl.DataFrame(rows, infer_schema_length=None)
        .with_columns(
            pl.when(kind.is_in(solutions.CLASSES)).then(kind).otherwise(pl.lit(solutions.LATE)).alias("failure"),
            contender=name.otherwise("contender"),
        )
        .group_by("contender", maintain_order=True)
        .agg(
            *((pl.col("failure") == name).mean().alias(name) for name in solutions.CLASSES),
            scenes=pl.len(),
            missed=(pl.col("contacts") < pl.col("true_contacts")).mean(),
            seconds=1e-6 * pl.col("microseconds").fill_nan(math.inf).quantile(0.5, "higher"),
        )
        .to_dicts()
    )


def cheapest(rows: pl.DataFrame, names: Sequence[str], error: float) -> Row | None:
    """Return the row with the least time that keeps `error` (m/s in V_p), at it and at every finer setting there is.

    An error that is small at one setting by the chance of its sign does not count.
    """
    keeps = (pl.col("velocity_error") <= error).cast(pl.Int8).cum_min().over("contender") == 1
    kept = rows.filter(pl.col("contender").is_in(names)).sort("setting").filter(keeps).sort("microseconds")
    return kept.row(0, named=True) if kept.height else None


def beside_ours(rows: pl.DataFrame, names: Sequence[str], error: float) -> Row | None:
    """Return the row of the cheapest of `names` with the `ratio` of its time to ours, empty where none gets there.

    None where ours does not get there.
    """
    ours, theirs = cheapest(rows, [OURS], error), cheapest(rows, names, error)
    if ours is None or rows.filter(pl.col("contender").is_in(names)).is_empty():
        return None
    return theirs | {"ratio": theirs["microseconds"] / ours["microseconds"]} if theirs else {}
