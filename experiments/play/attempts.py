"""Attempts (episodes that a person steers): functions that play, replay, evaluate, write and read them."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.play.assistance import NAMES, PERIOD, PERSON, RANGES, assistance, environment_of, playable
from impact_gym.envs.batch import Batch, Bodies
from impact_gym.envs.single import TRACE_POINTS
from impact_gym.render.film import History
from impact_gym.support.files import parsed, write_file
from impact_gym.support.provenance import machine_and_versions, revision
from impact_gym.support.sources import compiled_from
from impact_gym.support.validation import choice, number, numbers, one_of
from impact_gym.task import Task

AGREES = 0.01  # largest relative difference that late steps may make in an attempt that counts, see `timed_right`
BUSY = "this computer was late, and this changed the result: close other programs, or take a slower clock"  # the mark
RESULTS = "object_velocity", "slide", "peak_force", "touch_time", "done_time", "withheld_share", "missed"
ROUNDING = 1e-6  # allowed rounding error of times, as a fraction of a control period
SLOWEST = 16.0  # largest `Attempt.slow`
MAX_TEXT, MAX_NUMBER = 4096, 2.0**64  # limits: characters of set-up and marks together; absolute value of a number
FORMAT = "impact_gym try 3"
NO_ROW = np.zeros(1, np.bool_)  # rows of a batch of one episode that a step leaves out: none
SPARE = 3  # control periods that each recording lasts beyond the horizon of an episode


@dataclass(frozen=True)
class Attempt:
    """A steered episode. The first six fields define the episode; playing it fills the other fields."""

    setup: str
    assist: str
    seed: int
    record: dict[str, float]  # numbers of the episode's record; before the attempt only the chosen ones, then all
    operator: dict[str, Any] = field(default_factory=PERSON.copy)  # PERSON becomes a Replay of the person's commands
    slow: float = 1.0  # ratio of the duration in real time to the simulated time
    environment: dict[str, Any] = field(default_factory=dict)  # arguments of the environment, without the operator
    actions: list[list[float]] = field(default_factory=list)  # actions of the assistance, one for each step
    marks: list[str] = field(default_factory=list)  # reasons for which the attempt does not count
    result: dict[str, float] = field(default_factory=dict)  # numbers RESULTS of the episode's info
    made: dict[str, Any] = field(default_factory=dict)  # commit and versions


def replayed(this: Attempt) -> History:
    """Play an attempt again, and return its history; RuntimeError: the actions end before the episode."""
    batch = Batch(1, Task(**this.environment, operator=this.operator), threads=1, trace_points=8 * TRACE_POINTS)
    batch.begin_seeded(this.seed, this.record)
    for action in this.actions:
        if batch.ended[0]:
            break
        batch.step([action], NO_ROW)
    if not batch.ended[0]:
        raise RuntimeError("the try does not end at its last action: the environment has changed since it was recorded")
    return batch.history(0)


class Live:
    """An attempt in progress. Call `step` until `ended` is true, then `finished`."""

    def __init__(self, wanted: Attempt) -> None:
        """Begin an attempt; ValueError: set-up or assistance is unknown or unfit, see `playable` and `assistance`."""
        setup, self.person = playable(wanted.setup), wanted.operator == PERSON
        environment = environment_of(setup)
        self.batch = Batch(1, Task(**environment, operator=wanted.operator), threads=1)
        self.assistant = assistance(wanted.assist, setup)
        self.batch.begin_seeded(wanted.seed, wanted.record)
        recording = {"type": "Replay", "time": [0.0], "velocity": [0.0]} if self.person else wanted.operator
        record = self.batch.info(0)["record"]
        self.kept = Attempt(wanted.setup, wanted.assist, wanted.seed, record, recording, wanted.slow, environment)
        self._state = None
        self._decide()

    def _decide(self) -> None:
        action, self._state = self.assistant.predict(self.batch.observations.copy(), state=self._state)
        self._action = np.asarray(action, np.float32)

    @property
    def ended(self) -> bool:
        """Whether the episode has ended."""
        return bool(self.batch.ended[0])

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return float(self.batch.bodies().time[0])

    @property
    def next_tick(self) -> float:
        """Time of the next command, s."""
        return (math.floor(self.time / PERIOD + ROUNDING) + 1) * PERIOD

    def step(self, velocity: float = 0.0) -> None:
        """Play a control step. `velocity` (m/s): a person's command at `next_tick`."""
        tick = self.next_tick
        if self.person:
            self.batch.set_operator_velocity(velocity)
        self.batch.step(self._action, NO_ROW)
        self.kept.actions.append(self._action[0].tolist())
        if self.person and self.time >= tick - ROUNDING * PERIOD:
            given = self.kept.operator
            given["time"].append(PERIOD * len(given["time"]))
            given["velocity"].append(velocity)
        if not self.ended:
            self._decide()

    def ahead(self) -> Bodies:
        """Predict the bodies after the next step if no new command comes; the attempt is not changed."""
        state = self.batch.get_state()
        self.batch.step(self._action, NO_ROW)
        bodies = self.batch.bodies()
        self.batch.set_state(state)
        return bodies

    def finished(self) -> Attempt:
        """Play what is left of the episode (a person commands 0 m/s); return the attempt with its `result`."""
        while not self.ended:
            self.step()
        info = self.batch.info(0)
        self.kept.result.update({name: float(info[name]) for name in RESULTS})
        versions = machine_and_versions("impact-gym", "numpy")["versions"]
        self.kept.made.update(revision() | {"solver": compiled_from(), "versions": versions})
        return self.kept


def timed_right(this: Attempt, exact: Callable[[float], float]) -> bool:
    """Return whether late steps have left the result of a person's attempt as it is with exact times.

    `exact(t)`: the person's command (m/s) at the moment when an exact clock reaches the simulated time t (s). If late
    steps have changed a command, the attempt is played again with the exact ones. It must then touch or miss as before,
    and slide and duration may change by at most AGREES.
    """
    given = this.operator
    if this.marks or list(map(exact, given["time"][1:])) == given["velocity"][1:]:
        return True
    live = Live(replace(this, operator=PERSON.copy()))
    while not live.ended:
        live.step(exact(live.next_tick))
    info = live.batch.info(0)
    near = (math.isclose(info[name], this.result[name], rel_tol=AGREES) for name in ("slide", "done_time"))
    return info["missed"] == this.result["missed"] and all(near)


def write(path: Path, this: Attempt) -> Path:
    """Write an attempt atomically as JSON and return its path."""
    return write_file(path, json.dumps({"format": FORMAT, **asdict(this)}, allow_nan=False))


def read(path: Path) -> Attempt:
    """Return the attempt in a file; ValueError: the file is no attempt of this version."""
    return parsed(path, "a try", _from_text)


def _from_text(text: str) -> Attempt:
    content = json.loads(text, parse_float=_finite, parse_constant=_finite, parse_int=lambda text: int(_finite(text)))
    if content.pop("format", None) != FORMAT:
        raise ValueError(f"its format is not {FORMAT!r}")
    this = Attempt(**content)
    for name, sample in vars(Attempt("", "", 0, {})).items():
        one_of(name, getattr(this, name), type(sample))
    texts = "".join([this.setup, *this.marks])
    if len(texts) > MAX_TEXT or not texts.isprintable() or "<" in texts:
        raise ValueError(f"setup and marks must have at most {MAX_TEXT} printable characters in total, without <")
    choice("assist", this.assist, list(NAMES))
    choice("type of its operator", this.operator["type"], ["Replay"])
    number("slow", this.slow, "(times)", at_least=1.0, at_most=SLOWEST)
    number("uplink.delay", this.record["uplink.delay"], "s", at_least=0.0, at_most=0.5 * RANGES["delay"][2])
    for action in this.actions:
        numbers("action", action, "-")
    if {*this.result} != {*RESULTS}:
        raise ValueError(f"its results are not {', '.join(RESULTS)}")
    for name, value in this.result.items():
        number(name, value, "-", at_least=-1.0, at_most=1e3 if name.endswith("time") else 1e9)
    return this


def _finite(text: str) -> float:
    return number("each number", float(text), "-", at_least=-MAX_NUMBER, at_most=MAX_NUMBER)


def of_persons(folder: Path, marked: bool = False) -> list[Attempt]:
    """Return the attempts in a folder, in the order of the files' names; `marked`: also marked ones.

    ValueError: there is none, a file is bad, or the environments differ.
    """
    every = [read(path) for path in sorted(folder.glob("*.json"))]
    found = [this for this in every if marked or not this.marks]
    if not found:
        allowed = "" if marked else f" to use: {len(every)} marked tries need --include-marked"
        raise ValueError(f"{folder} has no try of a person{allowed}")
    if any(this.environment != found[0].environment for this in found):
        raise ValueError(f"{folder} has tries of several set-ups or couplings: move each kind to its own folder")
    return found


def operator_of(found: Sequence[Attempt]) -> dict[str, Any]:
    """Return the arguments of an operator `Replay` that draws one of the attempts for each episode."""
    ticks = round(Task(**found[0].environment, operator=PERSON).horizon / PERIOD) + SPARE
    times, velocities = list[float](), list[float]()
    for index, this in enumerate(found):
        given = this.operator["velocity"][: ticks - 1]
        begin = index * (ticks * PERIOD)
        times += [begin + k * PERIOD for k in (*range(len(given)), ticks - 1)]
        velocities += [*given, given[-1]]
    drawn = {"length": ticks * PERIOD, "recording": [0, len(found)]}
    return {"type": "Replay", "time": times, "velocity": velocities} | drawn
