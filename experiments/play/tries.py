"""Functions that play, replay and evaluate tries: episodes that a person steers."""

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from agents.policies import Controller
from experiments.play.assistance import PERIOD, PERSON, assistance, environment_of, playable
from impact_gym.envs.batch import Batch, Bodies
from impact_gym.outcome import Trace
from impact_gym.support.provenance import circumstances, revision
from impact_gym.support.sources import compiled_from
from impact_gym.task import Task
from impact_gym.task.episodes import EpisodeState

AGREES = 0.01  # largest relative difference that late steps may make in a try that counts, see `timed_right`
BUSY = "this computer was too busy; the try was not timed right: close other programs"  # mark of the other tries
RESULTS = "object_velocity", "slide", "peak_force", "touch_time", "done_time", "taken", "missed"
TRACE_POINTS = 1 << 18
ROUNDING = 1e-6  # allowed rounding error of times, as a fraction of a control period


@dataclass(frozen=True)
class Try:
    """A steered episode. The first six fields define the episode; playing it fills the other fields."""

    setup: str
    assist: str
    seed: int
    record: dict[str, float]  # numbers of the episode's record; before the try only the chosen ones, then all
    operator: dict[str, Any] = field(default_factory=PERSON.copy)  # PERSON becomes a Replay of the person's commands
    slow: float = 1.0  # ratio of the duration in real time to the simulated time
    environment: dict[str, Any] = field(default_factory=dict)  # arguments of the environment, without the operator
    actions: list[list[float]] = field(default_factory=list)  # actions of the assistance, one for each step
    marks: list[str] = field(default_factory=list)  # reasons for which the try does not count
    result: dict[str, float] = field(default_factory=dict)  # numbers RESULTS of the episode's info
    made: dict[str, Any] = field(default_factory=dict)  # commit and versions


def advance(batch: Batch, action: ArrayLike) -> None:
    """Play a control step in a batch of one episode."""
    batch.step(action, np.zeros(1, np.bool_), (len(batch.action_spec),))


def replayed(this: Try) -> tuple[Trace, dict[str, Any], Task, EpisodeState]:
    """Play a try again; return trace, info, task, episode state; RuntimeError: the actions end before the episode."""
    batch = Batch(1, Task(**this.environment, operator=this.operator), threads=1, trace_points=TRACE_POINTS)
    batch.begin_seeded(this.seed, this.record)
    for action in this.actions:
        if batch.ended[0]:
            break
        advance(batch, action)
    if not batch.ended[0]:
        raise RuntimeError("the try does not end at its last action: the environment has changed since it was recorded")
    return batch.trace(0), batch.info(0), batch.tasks[0].at(this.record), batch.episode_state(0)


@cache
def _made() -> dict[str, Any]:
    return revision() | {"solver": compiled_from(), "versions": circumstances("impact-gym", "numpy")["versions"]}


class Live:
    """A try in progress. Call `step` until `ended` is true, then `finished`."""

    def __init__(self, wanted: Try) -> None:
        """Begin a try; ValueError: set-up or assistance is unknown or unfit, see `playable` and `assistance`."""
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
        action, self._state = self.assistant.predict(self.batch.observations.copy(), state=self._state)
        self._action = np.asarray(action, np.float32)[0]

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
        advance(self.batch, self._action)
        self.kept.actions.append(self._action.tolist())
        if self.person and self.time >= tick - ROUNDING * PERIOD:
            given = self.kept.operator
            given["time"].append(PERIOD * len(given["time"]))
            given["velocity"].append(velocity)
        if not self.ended:
            self._decide()

    def ahead(self) -> Bodies:
        """Predict the bodies after the next step if no new command comes; the try is not changed."""
        state = self.batch.get_state()
        advance(self.batch, self._action)
        bodies = self.batch.bodies()
        self.batch.set_state(state)
        return bodies

    def finished(self) -> Try:
        """Play what is left of the episode (a person commands 0 m/s); return the try with its `result`."""
        while not self.ended:
            self.step()
        info = self.batch.info(0)
        self.kept.result.update({name: float(info[name]) for name in RESULTS})
        self.kept.made.update(_made())
        return self.kept


def timed_right(this: Try, exact: Callable[[float], float]) -> bool:
    """Return whether late steps have left the result of a person's try as it is with exact times.

    `exact(t)`: the person's command (m/s) at the moment when an exact clock reaches the simulated time t (s). If late
    steps have changed a command, the try is played again with the exact ones. It must then touch or miss as before, and
    slide and duration may change by at most AGREES.
    """
    given = this.operator
    if this.marks or all(map(operator.eq, map(exact, given["time"][1:]), given["velocity"][1:])):
        return True
    live = Live(replace(this, operator=PERSON.copy()))
    while not live.ended:
        live.step(exact(live.next_tick))
    info = live.batch.info(0)
    near = (math.isclose(info[name], this.result[name], rel_tol=AGREES) for name in ("slide", "done_time"))
    return info["missed"] == this.result["missed"] and all(near)
