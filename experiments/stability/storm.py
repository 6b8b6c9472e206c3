"""A row of numbers for each scene of the storm."""

import math
from collections.abc import Callable
from dataclasses import asdict
from time import thread_time

import impact_gym as ig
from agents.jobs import Result
from experiments.lab.tables import Gather, Row, result_of, solver_and
from experiments.speed_vs_error.scenes import Approach
from experiments.stability import checks
from experiments.stability.scenes import draw, labels, relative_error, velocity

LIMIT = 120.0  # s, without an answer: a hang
AGAIN_OVER = 20.0  # ms; the better of two, so that what is loaded at first use does not count
LONGEST_TRACE = 50_000  # steps, beyond which a trace would fill the memory
FINER = 1e-10  # rtol of a second run
COLUMNS = (
    *("milliseconds", "steps", "contacts", "passes", "object_velocity", "slowest_contact"),
    *("finite", "traced", "trace_change", "finer_change", *checks.Findings.__dataclass_fields__),
)
"""Columns of a row; the changes are relative."""


def run(approach: Approach) -> tuple[ig.Outcome | None, str, float]:
    """Return the outcome, or why there is none, and the processor time of one `simulate` in ms."""
    begun, outcome, problem = thread_time(), None, ""
    try:
        outcome = ig.simulate(*approach.run)
    except Exception as error:  # a failure is a result here
        problem = f"{type(error).__name__}: {error}".replace("\n", " ")
    return outcome, problem, 1e3 * (thread_time() - begun)


def row_of(approach: Approach, simulate: Callable[..., ig.Outcome] = ig.simulate) -> Row:
    """Return the row of a scene; `simulate` gives its trace."""
    outcome, problem, milliseconds = run(approach)
    if milliseconds >= AGAIN_OVER:
        milliseconds = min(milliseconds, run(approach)[2])
    row = blank(approach) | {"failure": problem, "milliseconds": milliseconds}
    if outcome is None:
        return row
    speed, v_p = approach.motion.speed, outcome.object_velocity
    row |= {
        "steps": outcome.steps,
        "contacts": len(outcome.contacts),
        "passes": len(outcome.snap_through),
        "object_velocity": v_p,
        "slowest_contact": min((contact.approach_velocity for contact in outcome.contacts), default=math.nan),
        "finite": int(checks.finite(outcome)),
        "traced": int(outcome.steps <= LONGEST_TRACE),
    }
    if row["traced"]:
        outcome = simulate(*approach.run, trace=True)
        row["finite"] = int(bool(row["finite"]) and checks.finite(outcome))
        row["trace_change"] = relative_error(outcome.object_velocity, v_p, speed)
        row["finer_change"] = relative_error(velocity(approach, FINER), v_p, speed)
    return row | asdict(checks.examine(approach.scene, outcome))


def blank(approach: Approach) -> Row:
    """Return the row of a scene of which no number is known."""
    return labels(approach) | dict.fromkeys(COLUMNS, math.nan)


def one(scene: int) -> Result:
    """Return the row of a scene, by its number."""
    return result_of([row_of(draw(scene))])


def rows(gather: Gather, count: int) -> list[Row]:
    """Return the rows of the first `count` scenes."""
    asked = [{"scene": number} for number in range(count)]
    depends = solver_and("experiments.stability.scenes", checks.__name__, __name__)
    return gather("storm", one, asked, depends, lambda hung: blank(draw(hung["scene"])), seconds=LIMIT)
