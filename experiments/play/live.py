"""A try under way: the native environment with a person in command, step by step, and its journal."""

import json
import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from agents.policies import Controller
from experiments.play import tries
from experiments.play.assistance import PERIOD, PERSON, assistance, environment_of, playable
from experiments.play.tries import Try
from impact_gym.envs.batch import Batch, Bodies
from impact_gym.files import DiskFullError, writing
from impact_gym.task import Task

ROUNDING = 1e-6  # of a control period
INTERRUPTED = "interrupted: "


class Live:
    """One try, from the first step to the last; `step` after `step` while it has not `ended`."""

    def __init__(self, wanted: Try, journal: Path | None = None) -> None:
        """Begin a try.

        Args:
            wanted: what is to be done.
            journal: file that holds what was done so far at each moment, so that a kill loses nothing.

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
        self._start, self._state = np.ones(1, np.bool_), None
        self._action = self._decided()
        self._journal, self._path = None, journal
        if journal is not None:
            with writing(str(journal)):
                journal.parent.mkdir(parents=True, exist_ok=True)
                self._journal = journal.open("w", buffering=1)
                self._journal.write(json.dumps(vars(wanted)) + "\n")

    def _decided(self) -> Any:
        """Return the next action of the assistance."""
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

        Raises:
            DiskFullError: the journal finds no room; the step is played all the same.
        """
        tick = self.next_tick
        if self.person:
            self.batch.command(velocity)
        tries.advance(self.batch, self._action)
        self.kept.actions.append(self._action.tolist())
        self.kept.late.append(round(late, 5))
        if self.person and self.time >= tick - ROUNDING * PERIOD:
            given = self.kept.operator
            given["time"].append(PERIOD * len(given["time"]))
            given["velocity"].append(velocity)
        if not self.ended:
            self._action = self._decided()
        if self._journal is not None:
            with writing(str(self._path)):
                self._journal.write(json.dumps([velocity]) + "\n")

    def ahead(self) -> Bodies:
        """Return where everything will be one step from now, as far as no further command arrives in it."""
        state = self.batch.get_state()
        tries.advance(self.batch, self._action)
        bodies = self.batch.bodies()
        self.batch.set_state(state)
        return bodies

    def finished(self) -> Try:
        """Return the try with its results; where it has not ended, a person commands nothing from now on."""
        while not self.ended:
            with suppress(DiskFullError):
                self.step()
        return tries.completed(self.kept)

    def close(self) -> None:
        """Close the journal, which stays."""
        if self._journal is not None:
            with suppress(OSError):  # the rest of it finds no room
                self._journal.close()


def recovered(journal: Path) -> Try:
    """Return the try of a journal that a killed process left: from its end on a person commands nothing.

    Raises:
        ValueError, LookupError, TypeError: the journal lacks its first line.
    """
    head, *lines = journal.read_text().splitlines() or [""]
    live = Live(Try(**json.loads(head)))
    live.kept.marks.append(f"{INTERRUPTED}the server was killed")
    with suppress(ValueError):  # the last line is not whole
        for line in lines:
            (velocity,) = json.loads(line)
            live.step(velocity)
    return live.finished()


def recover(folder: Path) -> None:
    """Turn the journals in a folder, which a killed process left, into tries; one without a first line is removed."""
    for journal in sorted(folder.glob("*.journal")):
        with suppress(ValueError, LookupError, TypeError, RuntimeError):
            tries.write(journal.with_suffix(".json"), recovered(journal))
        journal.unlink()
