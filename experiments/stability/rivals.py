"""Who else stands in the storm: SciPy's solvers and fixed steps on the same scenes, each with its time to run out.

A sample of the scenes that all can do: a contact with m = n = 3/2 and a rigid robot. What an answer is worth is judged
by the independent solver.
"""

import math
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import count, islice
from time import thread_time
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from agents.jobs import Result, digest_of
from experiments import reference
from experiments.lab.tables import Gather, Row, result_of, solver_and
from experiments.speed_vs_error import by_hand
from experiments.speed_vs_error.contenders import METHODS, OURS
from experiments.speed_vs_error.quantities import Solution
from experiments.speed_vs_error.scenes import Approach
from experiments.stability.scenes import draw, judging, known, labels, relative_error

SECONDS = 5.0  # of processor time for a run: a hundred times what ours may take
RTOL, ATOL = 1e-6, 1e-9
OUR_RTOL = 1e-8
CLOSE = 1e-3  # of V_p, relative
STEPS = (1e-4, 1e-5)  # s
PLAIN = ("RK45", "LSODA", "Radau")
State = NDArray[np.float64]
COMPARED = ("velocity", "contacts")
CLASSES = GOOD, MISCOUNTED, WRONG, NOT_FINITE, LATE, GAVE_UP = (
    "V_p within 1e-3, contacts right",
    "V_p within 1e-3, contacts miscounted",
    "V_p wrong",
    "not finite",
    "no answer in 5 s",
    "gave up",
)


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise TimeoutError once this process has used so much more processor time, s."""

    def late(*_: Any) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds, 0.01)  # more than once: a destructor swallows what is raised in it
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def event(function: Callable[[float, State], float], direction: float, terminal: bool = True) -> Any:
    """Return `function` as solve_ivp takes it."""
    found: Any = partial(function)
    found.direction, found.terminal = direction, terminal
    return found


class _PlainRun:
    """An approach by solve_ivp as people write it: SI units, tests of signs at ends of steps, restarts at each touch.

    The right-hand side is that of the hand-written integrators. The motion is cut where the commanded acceleration
    jumps and at touch, separation and alarm; what turns there and back within a step is not seen, and neither are the
    stops of a mechanism. Nobody asks for peak force, contact duration and snap-throughs.
    """

    def __init__(self, approach: Approach, method: str, rtol: float, atol: float) -> None:
        self.law, self.command = by_hand.law_of(approach.scene), by_hand.command_of(approach.motion)
        self.duration, self.options = approach.duration, {"method": method, "rtol": rtol, "atol": atol}
        self.v_in, self.brake, self.detection = 0.0, math.inf, math.nan
        self.contacts, self.evaluations = 0, 0

    def rates(self, t: float, y: State) -> list[float]:
        self.evaluations += 1
        x, v, y_p, w = y.tolist()
        x, v = by_hand.place(self.law, self.command, self.brake, t, x, v)
        a, b = by_hand.accelerations(self.law, self.command, self.brake, self.v_in, t, x, v, y_p, w)
        return [v, a, w, b]

    def penetration(self, t: float, y: State) -> tuple[float, float]:
        """Penetration (m) and its rate (m/s)."""
        x, v = by_hand.place(self.law, self.command, self.brake, t, y[0], y[1])
        return x - y[2], v - y[3]

    def over_threshold(self, t: float, y: State) -> float:
        return by_hand.contact_force(self.law, *self.penetration(t, y), self.v_in) - self.command.threshold

    def next_jump(self, t: float) -> float:
        """When the commanded acceleration jumps next, s."""
        ramp = self.command.speed / self.command.acceleration
        stopped = self.brake + self.command.speed / self.command.deceleration
        return min((at for at in (ramp, self.brake, stopped, self.duration) if at > t), default=self.duration)

    def piece(self, t: float, y: State) -> tuple[float, State]:
        """Integrate to the next jump or event."""
        found = [event(lambda t, y: self.penetration(t, y)[0], -1.0 if self.v_in else 1.0)]
        if self.v_in and math.isnan(self.detection):
            found.append(event(self.over_threshold, 1.0))
        run = solve_ivp(self.rates, (t, self.next_jump(t)), y, events=found, **self.options)
        if run.status < 0:
            raise RuntimeError(run.message)
        t, y = float(run.t[-1]), run.y[:, -1].copy()
        if len(run.t_events[0]):
            self.contacts += self.v_in == 0.0
            self.v_in = 0.0 if self.v_in else max(self.penetration(t, y)[1], by_hand.SLOWEST)
        elif len(found) > 1 and len(run.t_events[1]):
            self.detection, self.brake = t, t + self.command.delay
        return t, y


def plain(approach: Approach, method: str, rtol: float, atol: float) -> Solution:
    """solve_ivp as people write it.

    Raises:
        RuntimeError: the integrator gave up.
    """
    run = _PlainRun(approach, method, rtol, atol)
    t, y = 0.0, np.array([0.0, 0.0, approach.scene.object.distance, 0.0])
    while t < approach.duration:
        t, y = run.piece(t, y)
    return Solution(float(y[3]), math.nan, math.nan, run.detection, run.contacts, passes=0, steps=run.evaluations)


# of the reference: scaled contacts, exact flight, every event looked for with care
careful = partial(Approach.solved, simulate=reference.simulate, rtol=RTOL)
RIVALS: dict[str, Callable[[Approach], Solution]] = {
    OURS: partial(Approach.solved, rtol=OUR_RTOL),
    **{f"{method}, careful events": partial(careful, method=method) for method in METHODS},
    **{f"{method}, solve_ivp events": partial(plain, method=method, rtol=RTOL, atol=ATOL) for method in PLAIN},
    **{f"{method}, {h:g} s": partial(by_hand.solve, method, step=h) for method in by_hand.METHODS for h in STEPS},
}


def eligible(approach: Approach) -> bool:
    """Whether all of them can do it."""
    contact = approach.scene.contact
    return contact.stiffness_exponent == contact.damping_exponent == 1.5 and approach.scene.robot is None


def sample(size: int) -> list[int]:
    """Return the numbers of the first `size` scenes that all can do."""
    return list(islice((number for number in count() if eligible(draw(number))), size))


def grade(solution: Solution, truth: Mapping[str, float], speed: float) -> str:
    """Return one of CLASSES, at a commanded speed, m/s."""
    if not math.isfinite(solution.velocity):
        return NOT_FINITE
    if not relative_error(solution.velocity, truth["velocity"], speed) <= CLOSE:
        return WRONG
    return GOOD if solution.contacts == truth["contacts"] else MISCOUNTED


def judged(scene: int, contender: str, truth: Mapping[str, float]) -> Result:
    """Return the row of what a rival makes of a scene."""
    by_hand.compile_now()  # free of charge
    approach, begun = draw(scene), thread_time()
    row = labels(approach) | {"contender": contender, "velocity_error": math.nan, "contacts": math.nan}
    try:
        with limited(SECONDS):
            solution = RIVALS[contender](approach)
    except Exception as problem:  # of any kind: it is counted
        row["failure"] = LATE if isinstance(problem, TimeoutError) else GAVE_UP
    else:
        speed = approach.motion.speed
        row |= {"failure": grade(solution, truth, speed), "contacts": solution.contacts}
        row["velocity_error"] = relative_error(solution.velocity, truth["velocity"], speed)
    return result_of([row | {"true_contacts": truth["contacts"], "seconds": thread_time() - begun}])


def rows(gather: Gather, truths: Mapping[int, Row], names: Sequence[str]) -> list[Row]:
    """Return the rows of the rivals named on the scenes whose truth is known."""
    by_hand.compile_now()  # once, not in each process
    judges = "experiments.stability.scenes", by_hand.__name__, reference.__name__, __name__
    sure = judging(truths, COMPARED)
    found: list[Row] = []
    for ours, depends in ((True, solver_and(*judges)), (False, digest_of(*judges))):
        some = [name for name in names if (name == OURS) == ours]
        asked = [{"scene": n, "contender": name, "truth": true} for n, true in sure.items() for name in some]
        found += gather("rivals", judged, asked, depends, known, seconds=12 * SECONDS)
    return found


def table(rows: Sequence[Row]) -> list[Row]:
    """Return, by rival, the share in each class, of those that missed contacts, and the median time, s.

    Who was somewhere that it did not look at its time, and had to be ended, counts as late.
    """
    kind = pl.col("failure")
    return (
        pl.DataFrame(rows, infer_schema_length=None)
        .with_columns(pl.when(kind.is_in(CLASSES)).then(kind).otherwise(pl.lit(LATE)).alias("failure"))
        .group_by("contender", maintain_order=True)
        .agg(
            *((kind == name).mean().alias(name) for name in CLASSES),
            scenes=pl.len(),
            missed=(pl.col("contacts") < pl.col("true_contacts")).mean(),
            seconds=pl.col("seconds").fill_nan(math.inf).quantile(0.5, "higher"),
        )
        .to_dicts()
    )
