"""A try: what somebody did and what came of it, whole enough to be played again to the bit; a JSON file each."""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_gym as ig
from agents.provenance import circumstances, revision
from impact_gym.envs.batch import Batch
from impact_gym.files import parsed, write_file
from impact_gym.simulation import Outcome, Trace
from impact_gym.sources import compiled_from
from impact_gym.task import Task

FORMAT = "impact_gym try 1"
LATE, MOST_LATE = 4e-3, 0.02  # s, from which on a step is late; share of late steps from which on a try is invalid
TRACE_POINTS = 1 << 18
BEND = 1e-13  # m/s, by which a line may miss a velocity
_ALL = np.zeros(1, np.bool_)


@dataclass(frozen=True)
class Try:
    """What was done: the environment, who commanded, who assisted, and what came of it."""

    setup: str
    assist: str
    environment: dict[str, Any]  # its arguments but for the operator
    operator: dict[str, Any]  # a Replay of what a person commanded at each tick, m/s, or a scripted operator
    seed: int
    record: dict[str, float]  # all that the episode drew
    actions: list[list[float]]  # of the assistance, one for each step
    slow: float = 1.0  # times slower than life
    ages: list[float] = field(default_factory=list)  # s, from the arrival of the newest input to the state, each step
    late: list[float] = field(
        default_factory=list
    )  # s, by which each step came later after the one before than planned
    marks: list[str] = field(default_factory=list)  # why it does not count: interrupted, late
    study: dict[str, Any] = field(default_factory=dict)  # of a plan: person, condition, block, number
    motion: dict[str, list[float]] = field(default_factory=dict)  # what the flange executed: `ig.Motion`
    result: dict[str, float] = field(default_factory=dict)  # of `simulate` with it, and the times of the episode
    made: dict[str, Any] = field(default_factory=dict)

    @property
    def counts(self) -> bool:
        """Whether it may be analysed."""
        return not self.marks

    @property
    def person(self) -> bool:
        """Whether a person commanded."""
        return bool(self.operator["type"] == "Replay")


def replayed(this: Try) -> tuple[Trace, dict[str, Any], Task]:
    """Play a try again in the environment; return its trace to the end of the settling, its info and its task.

    Raises:
        RuntimeError: it does not end where it ended, so that it is another environment's.
    """
    batch = Batch(1, Task(**this.environment, operator=this.operator), threads=1, trace_points=TRACE_POINTS)
    batch.begin_seeded(this.seed, this.record)
    for action in this.actions:
        if batch.ended[0]:
            break
        batch.step(batch.commands(np.array(action), (batch.commanded,)), _ALL)
    if not batch.ended[0]:
        raise RuntimeError("the try does not end as it did: it was made with another version of the environment")
    return batch.trace(0), batch.info(0), batch.tasks[0].at(this.record)


def corners(trace: Trace) -> ig.Motion:
    """Return the motion that was imposed, by the corners of its velocity: straight lines that miss no point of it."""
    times, velocities = [0.0], [0.0]
    low, high, before = -math.inf, math.inf, (0.0, 0.0)
    for time, velocity in zip(trace.time.tolist(), trace.command_velocity.tolist(), strict=True):
        if time <= before[0]:
            continue
        least, most = ((velocity - velocities[-1] + side) / (time - times[-1]) for side in (-BEND, BEND))
        if least > high or most < low:  # no line from the last corner comes by all points since
            times.append(before[0])
            velocities.append(before[1])
            low, high = ((velocity - before[1] + side) / (time - before[0]) for side in (-BEND, BEND))
        else:
            low, high = max(low, least), min(high, most)
        before = time, velocity
    return ig.Motion((*times, before[0]), (*velocities, before[1]))


def simulated(this: Try) -> Outcome:
    """Return what `simulate` makes of the recorded motion: the same bits each time."""
    record = this.record
    task: Any = Task(**this.environment, operator=this.operator).at(record)
    scene = ig.Scene(
        ig.Tool(task.tool_mass), ig.Object(record["object_mass"], record["distance"], task.friction),
        ig.Contact(record["contact_stiffness"], record["restitution"], task.dissipation,
                   reference_velocity=task.reference_velocity),
        task.coupling, task.robot,
    )  # fmt: skip
    motion = ig.Motion(tuple(this.motion["times"]), tuple(this.motion["velocities"]))
    return ig.simulate(scene, motion, duration=motion.times[-1], rtol=task.rtol)


def completed(done: Try) -> Try:
    """Return a try with what came of it, after what was done."""
    trace, info, _ = replayed(done)
    motion = corners(trace)
    done.motion.update(times=list(motion.times), velocities=list(motion.velocities))
    outcome = simulated(done)
    done.result.update(
        object_velocity=outcome.peak_object_velocity, slide=outcome.slide or 0.0, peak_force=outcome.peak_force,
        **{name: float(info[name]) for name in ("touch_time", "done_time", "taken", "missed")},
    )  # fmt: skip
    if len(done.late) and np.mean(np.abs(done.late) > LATE) > MOST_LATE:
        done.marks.append("invalid: too many late steps")
    done.made.update(_made())
    return done


@cache
def _made() -> dict[str, Any]:
    """Return which code made a try; neither when nor where, which would tell of a person."""
    return revision() | {"solver": compiled_from(), "versions": circumstances("impact-gym", "numpy")["versions"]}


def write(path: Path, this: Try) -> Path:
    """Write a try, synced, whole or not at all."""
    return write_file(path, json.dumps({"format": FORMAT, **asdict(this)}, allow_nan=False))


def read(path: Path) -> Try:
    """Return what `write` wrote.

    Raises:
        ValueError: it is no try of this version; names the file.
    """

    def parse(text: str) -> Try:
        content = json.loads(text)
        if content.pop("format", None) != FORMAT:
            raise ValueError(f"its format is not {FORMAT!r}")
        return Try(**content)

    return parsed(path, "a try", parse)


def folder_of(folder: Path) -> Iterator[tuple[Path, Try]]:
    """Yield all tries in a folder in the order in which they were made, with their paths."""
    for path in sorted(folder.glob("*.json")):
        yield path, read(path)


def numbers(tries: list[Try], name: str) -> NDArray[np.float64]:
    """Return a number of the results of tries (n,)."""
    return np.array([this.result[name] for this in tries], np.float64)
