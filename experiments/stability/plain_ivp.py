"""solve_ivp as people write it: SI units, default tests of signs at the ends of steps, restarts at each touch.

The right-hand side is that of the hand-written integrators. The motion is cut where the commanded acceleration jumps
and at touch, separation and alarm; what turns there and back within a step is not seen, and neither are the stops of a
mechanism.
"""

import math
from collections.abc import Callable
from time import thread_time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from experiments.speed_vs_error.by_hand import (
    BISTABLE,
    SLOWEST,
    accelerations,
    command_of,
    contact_force,
    law_of,
    place,
)
from experiments.speed_vs_error.quantities import Answer
from experiments.speed_vs_error.scenes import Approach

State = NDArray[np.float64]


class OutOfTimeError(Exception):
    """The time that a run is given has passed."""


def event(function: Callable[[float, State], float], direction: float, terminal: bool = True) -> Any:
    """Return `function` as solve_ivp takes it."""

    def wrapped(t: float, y: State) -> float:
        return function(t, y)

    wrapped.direction, wrapped.terminal = direction, terminal  # type: ignore[attr-defined]
    return wrapped


class _Run:
    """One approach."""

    def __init__(self, approach: Approach, method: str, rtol: float, atol: float, seconds: float) -> None:
        self.law, self.command = law_of(approach.scene), command_of(approach.motion)
        self.duration = approach.duration
        self.options: dict[str, Any] = {"method": method, "rtol": rtol, "atol": atol}
        self.deadline = thread_time() + seconds
        self.v_in, self.brake, self.detection = 0.0, math.inf, math.nan
        self.peak, self.touching, self.contacts, self.passes, self.evaluations = 0.0, 0.0, 0, 0, 0

    def rates(self, t: float, y: State) -> list[float]:
        self.evaluations += 1
        if thread_time() > self.deadline:
            raise OutOfTimeError
        x, v, y_p, w = y.tolist()
        x, v = place(self.law, self.command, self.brake, t, x, v)
        a, b = accelerations(self.law, self.command, self.brake, self.v_in, t, x, v, y_p, w)
        return [v, a, w, b]

    def penetration(self, t: float, y: State) -> float:
        return float(place(self.law, self.command, self.brake, t, y[0], y[1])[0] - y[2])

    def rate(self, t: float, y: State) -> float:
        return float(place(self.law, self.command, self.brake, t, y[0], y[1])[1] - y[3])

    def force(self, t: float, y: State) -> float:
        if self.v_in == 0.0:
            return 0.0
        return float(contact_force(self.law, self.penetration(t, y), self.rate(t, y), self.v_in))

    def slider(self, t: float, y: State) -> float:
        flange = place(self.law._replace(kind=0), self.command, self.brake, t, 0.0, 0.0)[0]
        return float(self.law.x0 + y[0] - flange)

    def next_jump(self, t: float) -> float:
        """When the commanded acceleration jumps next, s."""
        ramp = self.command.speed / self.command.acceleration
        stopped = self.brake + self.command.speed / self.command.deceleration
        return min((at for at in (ramp, self.brake, stopped, self.duration) if at > t), default=self.duration)

    def piece(self, t: float, y: State) -> tuple[float, State]:
        """Integrate to the next jump or event."""
        found = [event(self.penetration, -1.0 if self.v_in else 1.0)]
        if self.v_in and math.isnan(self.detection):
            found.append(event(lambda t, y: self.force(t, y) - self.command.threshold, 1.0))
        if self.law.kind == BISTABLE:
            found.append(event(self.slider, 0.0, terminal=False))
        run = solve_ivp(self.rates, (t, self.next_jump(t)), y, events=found, **self.options)
        if run.status < 0:
            raise RuntimeError(run.message)
        if self.v_in:
            self.peak = max(self.peak, *(self.force(at, y) for at, y in zip(run.t, run.y.T, strict=True)))
            self.touching += run.t[-1] - t
        if self.law.kind == BISTABLE:
            self.passes += len(run.t_events[-1])
        t, y = float(run.t[-1]), run.y[:, -1].copy()
        if len(run.t_events[0]):
            self.contacts += self.v_in == 0.0
            self.v_in = 0.0 if self.v_in else max(self.rate(t, y), SLOWEST)
        elif len(found) > 1 and found[1].terminal and len(run.t_events[1]):
            self.detection = t
            self.brake = t + self.command.delay
        return t, y


def solve(approach: Approach, method: str, rtol: float, atol: float, seconds: float) -> Answer:
    """Run an approach within `seconds` of processor time.

    Raises:
        OutOfTimeError: it would take longer.
        RuntimeError: the integrator gave up.
    """
    run = _Run(approach, method, rtol, atol, seconds)
    t, y = 0.0, np.array([0.0, 0.0, approach.scene.object.distance, 0.0])
    while t < approach.duration:
        t, y = run.piece(t, y)
    return Answer(
        velocity=float(y[3]),
        peak_force=run.peak,
        contact_duration=run.touching,
        detection_time=run.detection,
        contacts=run.contacts,
        passes=run.passes,
        steps=run.evaluations,
    )
