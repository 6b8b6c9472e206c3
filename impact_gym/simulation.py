"""simulate(scene, motion) -> Outcome: one approach, from rest to `duration`."""

import math
from collections import namedtuple
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.kernel import require_compiled
from impact_gym.lowering import chain_law, contact_law
from impact_gym.motion import Trapezoid
from impact_gym.scene import Rigid, Scene
from impact_gym.solver.approach import Profile, approach
from impact_gym.solver.state import (
    CHAIN,
    LOCAL_SHARE,
    SENTENCES,
    TRACE_COLUMNS,
    Bodies,
    Recorder,
    Status,
    Tolerance,
    recorder,
)
from impact_gym.validation import WrongTypeError, number

MAX_STEPS = 1_000_000
"""Integration steps after which `simulate` gives up; an ordinary approach takes about fifty."""

_CONTACT_ROWS, _TRACE_ROWS, _SNAP_ROWS = 16, 4096, 4


@dataclass(frozen=True, slots=True)
class ContactRecord:
    """One contact of tool and object."""

    start: float  # s
    end: float | None  # s, None if unfinished
    approach_velocity: float  # m/s, penetration rate at the start: v_in of the paper's eq. 7
    separation_velocity: float  # m/s, at which the surfaces part; at `duration` if unfinished
    peak_force: float  # N
    impulse: float  # N s, on the object
    object_velocity: float  # m/s, at the end
    coupling_impulse: float  # N s, on the tool of what holds it (paper, eq. 21)
    momentum_error: float  # -, residual of the paper's eq. 20 over the impulse


@dataclass(frozen=True, slots=True)
class Trace:
    """Time histories, (n,) each; points lie closer together inside contacts."""

    time: NDArray[np.float64]  # s
    flange_position: NDArray[np.float64]  # m, with a compliant robot and a rigid coupling that of the tool
    flange_velocity: NDArray[np.float64]  # m/s
    tool_position: NDArray[np.float64]  # m
    tool_velocity: NDArray[np.float64]  # m/s
    object_position: NDArray[np.float64]  # m, its face; the tool's face is at 0 when t = 0
    object_velocity: NDArray[np.float64]  # m/s
    contact_force: NDArray[np.float64]  # N, on the object
    coupling_force: NDArray[np.float64]  # N, on the tool
    command_position: NDArray[np.float64]  # m, of the imposed motion; the flange's if the robot is rigid
    command_velocity: NDArray[np.float64]  # m/s, likewise

    @classmethod
    def of(cls, log: Recorder, rows: int, one_mass: bool = False) -> "Trace":
        """Return a copy of the first `rows` of what was recorded; `one_mass`: the flange moves with the tool."""
        columns = dict(zip(TRACE_COLUMNS, log.trace[:rows].T.copy(), strict=True))
        if one_mass:
            columns |= {f"flange_{of}": columns[f"tool_{of}"].copy() for of in ("position", "velocity")}
        return cls(**columns)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of an approach; velocities at `duration`."""

    object_velocity: float  # m/s
    tool_velocity: float  # m/s
    flange_velocity: float  # m/s; with a compliant robot and a rigid coupling the flange moves with the tool
    peak_force: float  # N, largest contact force
    detection_time: float | None  # s, contact force first exceeds the threshold; None if never or without a brake
    contacts: tuple[ContactRecord, ...]
    coupling_impulse: float  # N s, of the coupling on the tool over the contacts (paper, eq. 21)
    momentum_error: float  # -, largest residual of the paper's eq. 20 over the momentum exchanged
    steps: int  # integration steps in contact, rejected ones included
    status: str  # "ok"
    trace: Trace | None
    snap_through: tuple[float, ...]  # s, when the slider of a mechanism passes its alignment, first backwards


def simulate(
    scene: Scene, motion: Trapezoid, duration: float = 1.5, rtol: float = 1e-8, trace: bool = False
) -> Outcome:
    """Run an approach and return what came of it.

    Args:
        scene: tool, object, contact, coupling and robot; at rest at t = 0.
        motion: imposed motion of the robot.
        duration: length of the run, s.
        rtol: relative error aimed at for what comes of the contacts; flight is
            exact where it has a closed form, integrated to the same tolerance where not (bistable, robot).
        trace: also return time histories, in flight a point a millisecond (or 1e5 of them, if that is fewer). They
            are read off the same motion, which they do not change.

    Raises:
        TypeError, ValueError: an argument is none of these or out of range; names it.
        RuntimeError: the run cannot finish; says why.
    """
    require_compiled()
    if not isinstance(scene, Scene):
        raise WrongTypeError(f"scene must be a Scene, got {scene!r}")
    if not isinstance(motion, Trapezoid):
        raise WrongTypeError(f"motion must be a Trapezoid, got {motion!r}")
    duration = number("duration", duration, "s", above=0)
    rtol = number("rtol", rtol, "(no unit)", at_least=1e-13, at_most=1e-2)
    tolerance = Tolerance(LOCAL_SHARE * rtol, MAX_STEPS)
    law = chain_law(scene.tool.mass, scene.coupling, scene.robot)
    bodies = Bodies(scene.object.mass, contact_law(scene.contact))
    profile = profile_of(motion)
    chains = _BLANK.copy()
    rows = [_CONTACT_ROWS, _TRACE_ROWS if trace else 0, _SNAP_ROWS]
    while True:
        log = recorder(rows[0], rows[1], rows[2], interval=max(1e-3, duration / 1e5))
        status = approach(law, bodies, chains, scene.object.distance, profile, duration, tolerance, log)
        end = _End._make(chains.item())
        if end.logged <= rows[0] and end.traced <= rows[1] and end.snaps <= rows[2]:
            break
        rows = [end.logged, end.traced, end.snaps]  # the run repeats itself to the bit
    if status < 0:
        raise RuntimeError(f"the run stopped at t = {end.time:.6g} s: {SENTENCES[Status(status)]}")
    one_mass = scene.robot is not None and isinstance(scene.coupling, Rigid)
    return _outcome(end, log, trace, one_mass)


def profile_of(motion: Trapezoid) -> Profile:
    """Lower a motion to the record that the kernels read."""
    brake = motion.brake
    return Profile(
        motion.speed,
        motion.acceleration,
        brake.threshold if brake else math.inf,
        brake.delay if brake else math.inf,
        motion.deceleration,
    )


_BLANK = np.zeros(1, CHAIN)
_record: Any = namedtuple  # whose fields mypy wants to read here
_End = _record("_End", CHAIN.names)
"""A chain at the end of a run, as Python's own numbers: one read instead of one for each field."""


def _outcome(end: Any, log: Recorder, trace: bool, one_mass: bool) -> Outcome:
    contacts = [
        ContactRecord(start, None if stop != stop else stop, *rest)
        for start, stop, *rest in log.contacts[: end.logged].tolist()
    ]
    tool = end.flange_velocity + end.deflection_rate
    return Outcome(
        tool - end.penetration_rate if end.contacts else 0.0,
        tool,
        tool if one_mass else end.flange_velocity + end.flange_offset_rate,
        end.peak_force,
        end.detection if end.detection < math.inf else None,
        tuple(contacts),
        end.coupling_impulse,
        end.momentum_error,
        end.steps,
        "ok",
        Trace.of(log, end.traced, one_mass) if trace else None,
        tuple(log.snaps[: end.snaps].tolist()),
    )
