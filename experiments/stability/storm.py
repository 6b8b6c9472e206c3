"""A row of numbers for each scene of the storm.

A row is not computed again while the solver's sources are what they were: a digest of them stands in it.
"""

import hashlib
import math
from collections.abc import Callable
from dataclasses import asdict
from functools import cache
from pathlib import Path
from time import thread_time

from impact_gym.kernels import COMPILED_FROM

import impact_gym as ig
from experiments.lab.tables import Row
from experiments.speed_vs_error.scenes import Approach
from experiments.stability import checks
from experiments.stability.scenes import draw, labels, relative_error, velocity
from experiments.stability.workers import filled

LIMIT = 120.0  # s, without an answer: a hang
AGAIN_OVER = 20.0  # ms; the better of two, so that what is loaded at first use does not count
LONGEST_TRACE = 50_000  # steps, beyond which a trace would fill the memory
FINER = 1e-10  # rtol of a second run
SOURCES = ("physics/dissipation.py", "lowering.py", "scene.py", "motion.py", "simulation.py")
COLUMNS = (
    *("milliseconds", "steps", "contacts", "passes", "object_velocity", "slowest_contact"),
    *("finite", "traced", "trace_change", "finer_change", *checks.Findings.__dataclass_fields__),
)
"""Columns of a row; the changes are relative."""


@cache
def sources() -> str:
    """Digest of the sources that a run of `simulate` depends on, and of those that judge it."""
    package, here = Path(ig.__file__).parent, Path(__file__).parent
    files = [*(package / name for name in SOURCES), *(here / f"{name}.py" for name in ("scenes", "checks", "storm"))]
    return hashlib.sha256(COMPILED_FROM.encode() + b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def run(approach: Approach) -> tuple[ig.Outcome | None, str, float]:
    """Return the outcome, or why there is none, and the processor time of one `simulate` in ms."""
    begun, outcome, problem = thread_time(), None, ""
    try:
        outcome = ig.simulate(approach.scene, approach.motion, approach.duration)
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
        outcome = simulate(approach.scene, approach.motion, approach.duration, trace=True)
        row["finite"] = int(bool(row["finite"]) and checks.finite(outcome))
        row["trace_change"] = relative_error(outcome.object_velocity, v_p, speed)
        row["finer_change"] = relative_error(velocity(approach, FINER), v_p, speed)
    return row | asdict(checks.examine(approach.scene, outcome))


def blank(approach: Approach) -> Row:
    """Return the row of a scene of which no number is known."""
    return labels(approach) | {"run": sources()} | dict.fromkeys(COLUMNS, math.nan)


def one(row: Row) -> Row:
    """Fill the row of a scene."""
    return row_of(draw(int(row["scene"])))


def rows(folder: Path, count: int, processes: int | None = None) -> tuple[list[Row], int]:
    """Return the rows of the first `count` scenes, and how many of them `folder` did not have."""
    tasks = [(blank(draw(number)),) for number in range(count)]
    return filled(folder / "storm.csv", one, tasks, LIMIT, processes=processes)
