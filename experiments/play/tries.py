"""A try: under way, step by step, and what came of it, whole enough to be played again to the bit; a JSON file each."""

import fcntl
import json
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike

import impact_gym as ig
from agents.policies import Controller
from agents.provenance import circumstances, revision
from experiments.play.assistance import NAMES, PERIOD, PERSON, SLIDERS, assistance, environment_of, playable
from impact_gym.envs.batch import Batch, Bodies
from impact_gym.files import parsed, write_file
from impact_gym.operators import KINDS
from impact_gym.outcome import Outcome, Trace
from impact_gym.sources import compiled_from
from impact_gym.task import Task
from impact_gym.validation import choice, number, numbers, one_of

RESULTS = "object_velocity", "slide", "peak_force", "touch_time", "done_time", "taken", "missed"
SLOWEST = 16.0  # times slower than real time
LONGEST, LARGEST, FILE_BYTES = 4096, 2.0**64, 1 << 23  # letters of a text, size of a number, of a file
FORMAT = "impact_gym try 2"
LATE, MOST_LATE = 4e-3, 0.02  # s, from which on a step is late; share of late steps from which on a try is invalid
TRACE_POINTS = 1 << 18
BEND = 1e-13  # m/s, by which a line may miss a velocity
SPARE = 3  # ticks between the horizon and the next recording of an operator
ROUNDING = 1e-6  # of a control period
_ALL = np.zeros(1, np.bool_)


@dataclass(frozen=True)
class Try:
    """What is to be done, which is the first six fields, what was done, and what came of it."""

    setup: str
    assist: str
    seed: int
    record: dict[str, float]  # numbers of the episode's record that are not drawn by the seed; once begun, all numbers
    operator: dict[str, Any] = field(default_factory=PERSON.copy)  # of a person, once begun: a Replay of the commands
    slow: float = 1.0  # times slower than real time
    environment: dict[str, Any] = field(default_factory=dict)  # its arguments but for the operator
    actions: list[list[float]] = field(default_factory=list)  # of the assistance, one for each step
    late: list[float] = field(default_factory=list)  # s, by which a step followed the one before later than planned
    marks: list[str] = field(default_factory=list)  # why it does not count: interrupted, late
    motion: dict[str, list[float]] = field(default_factory=dict)  # what the flange executed: `ig.Motion`
    result: dict[str, float] = field(default_factory=dict)  # of `simulate` with it, and the times of the episode
    made: dict[str, Any] = field(default_factory=dict)  # which code made it; neither when nor where


def advance(batch: Batch, action: ArrayLike) -> None:
    """Play a control step of the one episode in a batch."""
    batch.step(batch.commands(np.array(action), (batch.commanded,)), _ALL)


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
        advance(batch, action)
    if not batch.ended[0]:
        raise RuntimeError("the try does not end as it did: it was made with another version of the environment")
    return batch.trace(0), batch.info(0), batch.tasks[0].at(this.record)


def corners(trace: Trace) -> ig.Motion:
    """Return the imposed motion by the corners of its velocity: straight lines through every point of the trace."""
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
    law = {"dissipation": task.dissipation, "reference_velocity": task.reference_velocity}
    contact = ig.Contact(record["contact_stiffness"], record["restitution"], **law)
    struck = ig.Object(record["object_mass"], record["distance"], task.friction)
    scene = ig.Scene(ig.Tool(task.tool_mass), struck, contact, task.coupling, task.robot)
    motion = ig.Motion(tuple(this.motion["times"]), tuple(this.motion["velocities"]))
    return ig.simulate(scene, motion, duration=motion.times[-1], rtol=task.rtol)


def completed(done: Try) -> Try:
    """Fill in the executed motion, the results, the mark of late steps and the code's version; return the try."""
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
    return revision() | {"solver": compiled_from(), "versions": circumstances("impact-gym", "numpy")["versions"]}


class Live:
    """A try under way, from the first step to the last; `step` after `step` while it has not `ended`."""

    def __init__(self, wanted: Try) -> None:
        """Begin the try that is `wanted`.

        Raises:
            ValueError: there is no such set-up or assistance.
        """
        setup, self.person = playable(wanted.setup), wanted.operator == PERSON
        environment = environment_of(setup)
        self.batch = Batch(1, Task(**environment, operator=wanted.operator), threads=1)
        self.assistant: Controller = assistance(wanted.assist, setup)
        self.batch.begin_seeded(wanted.seed, wanted.record)
        operator = {"type": "Replay", "time": [0.0], "velocity": [0.0]} if self.person else wanted.operator
        record = self.batch.info(0)["record"]
        self.kept = Try(wanted.setup, wanted.assist, wanted.seed, record, operator, wanted.slow, environment)
        self._state = None
        self._decide()

    def _decide(self) -> None:
        """Have the assistance choose its next action."""
        action, self._state = self.assistant.predict(self.batch.observations.copy(), state=self._state)
        self._action = np.asarray(action, np.float32)[0]

    @property
    def ended(self) -> bool:
        """Whether it is over."""
        return bool(self.batch.ended[0])

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return float(self.batch.bodies().time[0])

    @property
    def next_tick(self) -> float:
        """When the next command is sent, s."""
        return (math.floor(self.time / PERIOD + ROUNDING) + 1) * PERIOD

    def step(self, velocity: float = 0.0, late: float = 0.0) -> None:
        """Play a control step; a person's `velocity` is sent at the tick in it, if there is one.

        Args:
            velocity: m/s.
            late: by which the step comes too late, s.
        """
        tick = self.next_tick
        if self.person:
            self.batch.command(velocity)
        advance(self.batch, self._action)
        self.kept.actions.append(self._action.tolist())
        self.kept.late.append(round(late, 5))
        if self.person and self.time >= tick - ROUNDING * PERIOD:
            given = self.kept.operator
            given["time"].append(PERIOD * len(given["time"]))
            given["velocity"].append(velocity)
        if not self.ended:
            self._decide()

    def ahead(self) -> Bodies:
        """Return where everything will be one step from now, as far as no further command arrives in it."""
        state = self.batch.get_state()
        advance(self.batch, self._action)
        bodies = self.batch.bodies()
        self.batch.set_state(state)
        return bodies

    def finished(self) -> Try:
        """Return the try with its results; where it has not ended, a person commands nothing from now on."""
        while not self.ended:
            self.step()
        return completed(self.kept)


def from_text(text: str, ended: bool = True) -> Try:
    """Return the try that `to_text` put into a line; of one that has not `ended` there are no results.

    Raises:
        ValueError, TypeError, LookupError: it is no try of this version, or one that no clock could have made.
    """
    content = json.loads(text, parse_float=_finite, parse_constant=_finite, parse_int=lambda text: int(_finite(text)))
    if content.pop("format", None) != FORMAT:
        raise ValueError(f"its format is not {FORMAT!r}")
    this = Try(**content)
    for name, sample in vars(Try("", "", 0, {})).items():
        one_of(name, getattr(this, name), type(sample))
    texts = "".join([this.setup, *this.marks])
    if len(texts) > LONGEST or not texts.isprintable() or "<" in texts:
        raise ValueError(f"setup and marks must be at most {LONGEST} printable letters without <")
    choice("assist", this.assist, list(NAMES))
    choice("type of its operator", this.operator["type"], [kind.__name__ for kind in KINDS])
    number("slow", this.slow, "(times)", at_least=1.0, at_most=SLOWEST)
    number("uplink.delay", this.record["uplink.delay"], "s", at_least=0.0, at_most=0.5 * SLIDERS["delay"][2])
    numbers("late", this.late, "s")
    for action in this.actions:
        numbers("action", action, "-")
    if {*this.result} != {*(RESULTS if ended else ())}:
        raise ValueError(f"its results are not {', '.join(RESULTS)}")
    for name, value in this.result.items():
        number(name, value, "-", at_least=-1.0, at_most=1e3 if name.endswith("time") else 1e9)
    return this


def _finite(text: str) -> float:
    return number("each number", float(text), "-", at_least=-LARGEST, at_most=LARGEST)


def to_text(this: Try) -> str:
    """Return a try in one line of JSON."""
    return json.dumps({"format": FORMAT, **asdict(this)}, allow_nan=False)


def write(path: Path, this: Try) -> Path:
    """Write a try, synced, whole or not at all."""
    return write_file(path, to_text(this))


def recovered(journal: Path) -> Try:
    """Return the interrupted try of a journal that a killed clock left; a person commands nothing from its end on.

    The first line is the try that was wanted, with its environment; each further one the velocity (m/s) of a step.

    Raises:
        ValueError: it cannot be played again; names the file.
    """

    def parse(text: str) -> Try:
        head, *lines = text.split("\n")
        wanted = from_text(head, ended=False)
        live = Live(wanted)
        if live.kept.environment != wanted.environment:
            raise ValueError(f"set-up {wanted.setup} has changed since")
        live.kept.marks.append("interrupted: the server was killed")
        for line in lines[:-1]:  # what stands behind the last line break is no whole line
            if live.ended:
                raise ValueError("it goes on behind the end")
            live.step(number("velocity", float(line), "m/s"))
        return live.finished()

    return parsed(_small(journal), "the journal of a try", parse)


def recover(folder: Path) -> list[str]:
    """Turn the journals in a folder into tries; return what is to be said of each that stays, as it makes none."""
    problems = []
    for journal in sorted(folder.glob("*.journal")):
        try:
            if not journal.with_suffix(".json").exists():  # killed before the journal was removed
                write(journal.with_suffix(".json"), recovered(journal))
            journal.unlink()
        except (OSError, RuntimeError, ValueError) as problem:
            problems.append(str(problem))
    return problems


def read(path: Path) -> Try:
    """Return what `write` wrote.

    Raises:
        ValueError: it is no try of this version; names the file.
    """
    return parsed(_small(path), "a try", from_text)


def _small(path: Path) -> Path:
    """Return the path of a regular file that is not too large, or refuse it."""
    if path.exists() and not (path.is_file() and path.stat().st_size <= FILE_BYTES):
        raise ValueError(f"{path} is not read as a try: it must be a file of at most {FILE_BYTES} bytes")
    return path


def locked(folder: Path) -> IO[str]:
    """Return the lock of a folder, made if need be; it is held until this process and those it forked have closed it.

    Raises:
        ValueError: another server plays in the folder; names both.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = os.fdopen(os.open(folder / ".lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600), "r+")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        with lock:
            wrong = f"out must be a folder of no other server, got {folder}: process {lock.read(20)} has it"
        raise ValueError(wrong) from None
    lock.truncate(0)
    lock.write(str(os.getpid()))
    lock.flush()
    return lock


def folder_of(folder: Path) -> Iterator[tuple[Path, Try]]:
    """Return all tries in a folder in the order in which they were made, with their paths, as they are read."""
    return ((path, read(path)) for path in sorted(folder.glob("*.json")))


def of_persons(folder: Path, marked: bool = False) -> list[Try]:
    """Return the tries of persons in a folder that count, or with `marked` all of them.

    Raises:
        ValueError: there is none, or they are of several environments.
    """
    every = [this for _, this in folder_of(folder) if this.operator["type"] == "Replay"]
    found = [this for this in every if marked or not this.marks]
    if not found:
        raise ValueError(f"{folder} has no try of a person that counts, and {len(every)} that are marked")
    if any(this.environment != found[0].environment for this in found):
        raise ValueError(f"{folder} has tries with several couplings or set-ups: take those of one, a folder each")
    return found


def operator_of(found: Sequence[Try]) -> dict[str, Any]:
    """Return a `Replay` that draws one of the tries for each episode: for `operator` of a set-up or an environment."""
    ticks = round(found[0].environment["horizon"] / PERIOD) + SPARE
    times, velocities = list[float](), list[float]()
    for place, this in enumerate(found):
        given = this.operator["velocity"][: ticks - 1]
        begin = place * (ticks * PERIOD)
        times += [begin + k * PERIOD for k in (*range(len(given)), ticks - 1)]  # the last is held
        velocities += [*given, given[-1]]
    drawn = {"length": ticks * PERIOD, "recording": [0, len(found)]}
    return {"type": "Replay", "time": times, "velocity": velocities} | drawn
