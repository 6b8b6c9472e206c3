"""A row of numbers for each scene of the storm, kept in files of CHUNK rows.

A row is not computed again while the solver's sources are what they were: a digest of them stands in it.
"""

import hashlib
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict
from functools import cache
from pathlib import Path
from time import thread_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_gym as ig
from experiments.speed_vs_error import records
from experiments.speed_vs_error.records import Row
from experiments.speed_vs_error.scenes import Approach
from experiments.stability import checks
from experiments.stability.scenes import COUPLINGS, EXPONENTS, ROBOTS, draw, kind
from experiments.stability.workers import Job, answers

CHUNK = 250  # rows in a file
LIMIT = 120.0  # s, without an answer: a hang
AGAIN_OVER = 20.0  # ms; the better of two, so that loading a kernel does not count
LONGEST_TRACE = 50_000  # steps, beyond which a trace would fill the memory
FINER = 1e-10  # rtol of a second run
SOURCES = ("solver", "physics", "lowering.py", "scene.py", "motion.py", "simulation.py", "kernels.pyx")


@cache
def sources() -> str:
    """Digest of the sources that a run of `simulate` depends on, and of those that judge it."""
    package, here = Path(ig.__file__).parent, Path(__file__).parent
    digest = hashlib.sha256()
    for name in SOURCES:
        path = package / name
        for file in [path] if path.is_file() else sorted(path.rglob("*.py")):
            digest.update(file.read_bytes())
    for name in ("scenes.py", "checks.py", "storm.py"):
        digest.update((here / name).read_bytes())
    return digest.hexdigest()[:12]


def run(approach: Approach) -> tuple[ig.Outcome | None, str, float]:
    """Return the outcome, or why there is none, and the processor time of one `simulate` in ms."""
    best, problem = math.inf, ""
    outcome = None
    for _ in range(2):
        begun = thread_time()
        try:
            outcome = ig.simulate(approach.scene, approach.motion, approach.duration)
        except Exception as error:  # a failure is a result here
            problem = f"{type(error).__name__}: {error}".replace("\n", " ")
        best = min(best, 1e3 * (thread_time() - begun))
        if best < AGAIN_OVER:
            break
    return outcome, problem, best


def row_of(approach: Approach, simulate: Callable[..., ig.Outcome] = ig.simulate) -> Row:
    """Return the row of a scene; `simulate` gives its trace."""
    outcome, problem, milliseconds = run(approach)
    row = blank(approach, problem) | {"milliseconds": milliseconds}
    if outcome is None:
        return row
    row |= {
        "steps": outcome.steps,
        "contacts": len(outcome.contacts),
        "passes": len(outcome.snap_through),
        "object_velocity": outcome.object_velocity,
        "slowest_contact": min((contact.approach_velocity for contact in outcome.contacts), default=math.nan),
        "finite": int(checks.finite(outcome)),
        "traced": int(outcome.steps <= LONGEST_TRACE),
    }
    if row["traced"]:
        outcome = simulate(approach.scene, approach.motion, approach.duration, trace=True)
        row["finite"] = int(bool(row["finite"]) and checks.finite(outcome))
        row["trace_change"] = abs(outcome.object_velocity - row["object_velocity"])
        row["finer_change"] = abs(finer(approach) - row["object_velocity"])
    return row | asdict(checks.examine(approach.scene, outcome))


def finer(approach: Approach) -> float:
    """V_p at a hundredth of the default tolerance, m/s; nan if there is none."""
    try:
        return ig.simulate(approach.scene, approach.motion, approach.duration, FINER).object_velocity
    except RuntimeError:
        return math.nan


def blank(approach: Approach, problem: str) -> Row:
    """Return the row of a scene of which nothing is known, but why."""
    numbers = ("steps", "contacts", "passes", "finite", "traced")
    values = ("milliseconds", "object_velocity", "slowest_contact", "trace_change", "finer_change")
    return {
        "scene": approach.name,
        "coupling": kind(approach.scene),
        "run": sources(),
        "failure": problem,
        **dict.fromkeys(numbers, 0),
        **dict.fromkeys(values, math.nan),
        **dict.fromkeys(checks.Findings.__dataclass_fields__, math.nan),
        "speed": approach.motion.speed,
        "description": approach.description,
    }


def one(number: int) -> Row:
    """Return the row of scene `number`."""
    return row_of(draw(number))


def silent(number: int, reason: str) -> Row:
    """Return the row of a scene whose process had to be ended."""
    return blank(draw(number), reason)


def load_kernels() -> None:
    """Compile, or load, what the first scenes need, one of each kind with either contact."""
    seen: set[tuple[str, bool]] = set()
    wanted = 2 * len(COUPLINGS) * len(ROBOTS)
    number = 0
    while len(seen) < wanted and number < 100 * len(EXPONENTS):
        approach = draw(number)
        contact = approach.scene.contact
        what = kind(approach.scene), contact.stiffness_exponent == contact.damping_exponent == 1.5
        if what not in seen:
            seen.add(what)
            run(approach)
        number += 1


def file_of(folder: Path, number: int) -> Path:
    """Return the file that scene `number` is in."""
    return folder / "storm" / f"{number // CHUNK * CHUNK:07d}.csv"


def known(folder: Path, count: int) -> Iterator[Row]:
    """Yield the rows on disk of the first `count` scenes that these sources computed, in order."""
    for start in range(0, count, CHUNK):
        for row in records.read(file_of(folder, start)):
            if row["run"] == sources() and int(row["scene"]) < count:
                yield row


def extend(folder: Path, count: int, processes: int | None = None) -> int:
    """Compute what `folder` does not have of the first `count` scenes; return how many those were."""
    there = {int(row["scene"]) for row in known(folder, count)}
    left = [number for number in range(count) if number not in there]
    if not left:
        return 0
    load_kernels()  # once, not in all processes at the same time
    fresh: dict[Path, dict[int, Row]] = {}

    def save(path: Path) -> None:
        rows = {int(row["scene"]): row for row in records.read(path) if row["run"] == sources()} | fresh.pop(path)
        records.write(path, [rows[number] for number in sorted(rows)])

    missing: dict[Path, int] = {}
    for number in left:
        path = file_of(folder, number)
        missing[path] = missing.get(path, 0) + 1
    try:
        for row in answers(Job(one, load_kernels), left, LIMIT, silent, "storm", processes):
            path = file_of(folder, int(row["scene"]))
            fresh.setdefault(path, {})[int(row["scene"])] = row
            if len(fresh[path]) == missing[path]:
                save(path)
    finally:  # what is done is kept
        for path in list(fresh):
            save(path)
    return len(left)


def columns(folder: Path, count: int) -> dict[str, NDArray[Any]]:
    """Return the rows as arrays by column, which take a tenth of the memory; texts but the failure are left out."""
    parts: dict[str, list[float | str]] = {}
    for row in known(folder, count):
        for name, value in row.items():
            if name not in ("run", "description"):
                parts.setdefault(name, []).append(int(value) if name == "scene" else value)
    return {name: np.array(values) for name, values in parts.items()}
