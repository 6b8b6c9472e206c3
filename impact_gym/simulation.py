"""simulate(scene, motion) -> Outcome: one approach, from rest to `duration`."""

import math
from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_gym.kernels import CHAIN, CONTACT, STUCK, TRACE, approach_rows
from impact_gym.lowering import LOCAL_SHARE, STATUS_MESSAGES, approach_plan, packed
from impact_gym.motion import Motion, Trapezoid
from impact_gym.quantities import QUANTITIES
from impact_gym.scene import Scene, flange_moves_with_tool, warn_of_stroke
from impact_gym.validation import one_of

MAX_STEPS = 1_000_000
"""Integration steps after which `simulate` gives up; an ordinary approach takes about fifty."""

_CONTACT_ROWS, _SNAP_ROWS, _TRACE_ROWS = 4096, 64, 4096  # what does not fit costs a second run
_NO_TRACE, _NO_SNAPS = np.empty(0, TRACE), np.empty(0)
NOTHING_RECORDED = np.empty(0, CONTACT), _NO_TRACE, _NO_SNAPS, 1.0
"""What the kernels are given where nobody asks for contacts, a trace or passages of a slider."""


class ContactRecord(NamedTuple):
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


class Trace(NamedTuple):
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
    def of(cls, points: NDArray[Any], with_the_tool: bool) -> "Trace":
        """Return a copy of what was recorded (n, TRACE); `with_the_tool`: the flange moves so."""
        columns = {name: points[name].copy() for name in TRACE.names or ()}
        if with_the_tool:
            columns |= {f"flange_{of}": columns[f"tool_{of}"].copy() for of in ("position", "velocity")}
        return cls(**columns)


class Outcome(NamedTuple):
    """Result of one approach; velocities at `duration`."""

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
    peak_object_velocity: float  # m/s, the largest; without friction the object loses none
    slide: float | None  # m, to where the object rests if nothing touches it after `duration`; None without friction
    rest_time: float | None  # s, when it rests and the tool stays slower than 1 mm/s; likewise, inf if that never comes


def simulate(
    scene: Scene, motion: Trapezoid | Motion, duration: float = 1.5, rtol: float = 1e-8, trace: bool = False
) -> Outcome:
    """Run an approach and return its result.

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
    one_of("scene", scene, Scene)
    one_of("motion", motion, Trapezoid, Motion)
    duration = QUANTITIES["duration"].check(duration)
    rtol = QUANTITIES["rtol"].check(rtol)
    warn_of_stroke(scene.coupling, scene.tool.mass, motion.acceleration)
    plan, table = approach_plan(scene, motion, duration)
    plans, chains = packed(plan), np.empty(1, CHAIN)
    contacts, snaps = np.empty(_CONTACT_ROWS, CONTACT), np.empty(_SNAP_ROWS)
    points = np.empty(_TRACE_ROWS, TRACE) if trace else _NO_TRACE
    while True:
        recorder = contacts, points, snaps, max(1e-3, duration / 1e5)
        approach_rows(plans, table, chains, 0, 1, LOCAL_SHARE * rtol, MAX_STEPS, recorder)
        end = _End._make(chains.item())
        if end.logged <= len(contacts) and end.traced <= len(points) and end.snaps <= len(snaps):
            break
        contacts, points, snaps = np.empty(end.logged, CONTACT), np.empty(end.traced, TRACE), np.empty(end.snaps)
    if end.status < 0:  # what did not fit is found again by the same run: it repeats itself to the bit
        raise RuntimeError(f"the run stopped at t = {end.time:.6g} s: {STATUS_MESSAGES[end.status]}")
    with_the_tool = flange_moves_with_tool(scene.coupling, scene.robot)
    history = Trace.of(points[: end.traced], with_the_tool) if trace else None
    snap_through = tuple(snaps[: end.snaps].tolist())
    return _outcome(end, contacts[: end.logged], history, snap_through, with_the_tool, bool(scene.object.friction))


_record: Any = namedtuple  # whose fields mypy wants to read here
_End = _record("_End", CHAIN.names)
"""A chain at the end of a run, as Python's own numbers: one read instead of one for each field."""


def _outcome(
    end: Any, contacts: NDArray[Any], trace: Trace | None, snap_through: tuple[float, ...], with_the_tool: bool,
    rough: bool,
) -> Outcome:  # fmt: skip
    tool = end.flange_velocity + end.deflection_rate
    object_velocity = tool - end.penetration_rate if end.contacts and end.footing != STUCK else 0.0
    return Outcome(
        object_velocity,
        tool,
        tool if with_the_tool else end.flange_velocity + end.flange_offset_rate,
        end.peak_force,
        end.detection if end.detection < math.inf else None,
        tuple(ContactRecord(start, None if stop != stop else stop, *rest) for start, stop, *rest in contacts.tolist()),
        end.coupling_impulse,
        end.momentum_error,
        end.steps,
        "ok",
        trace,
        snap_through,
        end.top_speed if rough else object_velocity,
        end.slide if rough else None,
        end.rest_time if rough else None,
    )
