"""A try under way: the native environment with a person at the stick, step by step, and its journal."""

import json
import math
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from agents.policies import Controller
from experiments.play.assistance import PERIOD, assistance, environment_of, playable, record_of
from experiments.play.tries import Try, completed
from impact_gym.envs.batch import Batch, Bodies
from impact_gym.files import writing
from impact_gym.task import Task

_ALL = np.zeros(1, np.bool_)
ROUNDING = 1e-6  # of a control period
INTERRUPTED = "interrupted: "


@dataclass(frozen=True)
class Asked:
    """What a try is to be."""

    setup: str
    assist: str
    chosen: dict[str, float]  # where the sliders stand
    seed: int
    slow: float = 1.0
    operator: dict[str, Any] = field(default_factory=lambda: {"type": "Person"})
    study: dict[str, Any] = field(default_factory=dict)


class Live:
    """One try, from the first step to the last; `step` after `step` while it has not `ended`."""

    def __init__(self, asked: Asked, journal: Path | None = None) -> None:
        """Begin a try.

        Args:
            asked: what it is to be.
            journal: file that has what was done so far at each moment, so that nothing is lost with this process.

        Raises:
            ValueError: there is no such set-up or assistance, or a number is out of its range.
        """
        self.asked, setup = asked, playable(asked.setup)
        self.environment, self.person = environment_of(setup), asked.operator["type"] == "Person"
        self.batch = Batch(1, Task(**self.environment, operator=asked.operator), threads=1)
        self.assistant: Controller = assistance(asked.assist, setup)
        self.batch.begin_seeded(asked.seed, record_of(asked.chosen))
        self.record: dict[str, float] = self.batch.info(0)["record"]
        self.commands, self.actions, self.marks = [0.0], list[list[float]](), list[str]()
        self.ages, self.late = list[float](), list[float]()
        self._start, self._state = np.ones(1, np.bool_), None
        self._journal, self._path = None, journal
        self.action = self._decided()
        if journal is not None:
            with writing(str(journal)):
                journal.parent.mkdir(parents=True, exist_ok=True)
                self._journal = journal.open("w", buffering=1)
                self._journal.write(json.dumps(vars(asked)) + "\n")

    def _decided(self) -> Any:
        """Return what the assistance does next."""
        seen = self.batch.observations.copy()
        action, self._state = self.assistant.predict(seen, state=self._state, episode_start=self._start)
        self._start = np.zeros(1, np.bool_)
        return np.asarray(action, np.float32)[0]

    @property
    def ended(self) -> bool:
        """Whether it is over."""
        return bool(self.batch.ended[0])

    @property
    def time(self) -> float:
        """How far it has come, s."""
        return float(self.batch.bodies().time[0])

    @property
    def next_tick(self) -> float:
        """When the next command is sent, s."""
        return (math.floor(self.time / PERIOD + ROUNDING) + 1) * PERIOD

    def step(self, velocity: float = 0.0, age: float = 0.0, late: float = 0.0) -> None:
        """Play a control step; a person's `velocity` (m/s) is sent at the tick in it, if there is one.

        Args:
            velocity: m/s.
            age: of what was put in, s.
            late: of the step, s.

        Raises:
            DiskFullError: the journal finds no room; the step is played all the same.
        """
        tick = self.next_tick
        if self.person:
            self.batch.command(velocity)
        self.batch.step(self.batch.commands(self.action, (self.batch.commanded,)), _ALL)
        self.actions.append(self.action.tolist())
        self.ages.append(round(age, 5))
        self.late.append(round(late, 5))
        if self.time >= tick - ROUNDING * PERIOD:
            self.commands.append(velocity)
        line = json.dumps([velocity, self.action.tolist()]) + "\n"
        if not self.ended:
            self.action = self._decided()
        if self._journal is not None:
            with writing(str(self._path)):
                self._journal.write(line)

    def ahead(self) -> Bodies:
        """Return where everything will be one step from now, as far as no further command arrives in it."""
        state = self.batch.get_state()
        self.batch.step(self.batch.commands(self.action, (self.batch.commanded,)), _ALL)
        bodies = self.batch.bodies()
        self.batch.set_state(state)
        return bodies

    def finished(self) -> Try:
        """Return the try, which has ended, with what came of it."""
        asked, operator = self.asked, self.asked.operator
        if self.person:
            ticks = (PERIOD * np.arange(len(self.commands))).tolist()
            operator = {"type": "Replay", "time": ticks, "velocity": self.commands}
        return completed(Try(
            asked.setup, asked.assist, self.environment, operator, asked.seed, self.record,
            self.actions, asked.slow, self.ages, self.late, self.marks, asked.study,
        ))  # fmt: skip

    def close(self) -> None:
        """Close the journal, which stays."""
        if self._journal is not None:
            with suppress(OSError):  # what is left of it finds no room
                self._journal.close()


def recovered(journal: Path) -> Try:
    """Return the try of a journal that a process left behind as it was killed: from there on nobody commands.

    Raises:
        ValueError, LookupError: the journal is not even begun.
    """
    head, *lines = journal.read_text().splitlines() or [""]
    live = Live(Asked(**json.loads(head)))
    for line in lines:
        try:
            velocity, action = json.loads(line)
        except ValueError:  # the last line is not whole
            break
        if not live.ended:
            live.action = np.array(action, np.float32)
            live.step(velocity)
    while not live.ended:
        live.step()
    live.marks.append(f"{INTERRUPTED}the server was killed")
    return live.finished()
