"""simulate(scene, motion) -> Outcome: one approach, from rest to `duration`."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_gym.motion import Trapezoid
from impact_gym.physics import dissipation
from impact_gym.physics.coupling import RigidLaw, SpringDamperLaw
from impact_gym.scene import Coupling, Scene, SpringDamper
from impact_gym.solver.approach import Profile, approach
from impact_gym.solver.state import (
    CHAIN,
    LOCAL_SHARE,
    SENTENCES,
    Bodies,
    Recorder,
    Status,
    Tolerance,
    recorder,
)
from impact_gym.validation import number

MAX_STEPS = 1_000_000
"""Integration steps after which `simulate` gives up; an ordinary approach takes about fifty."""

_CONTACT_ROWS, _TRACE_ROWS = 16, 4096


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


@dataclass(frozen=True, slots=True)
class Trace:
    """Time histories, (n,) each; points lie closer together inside contacts."""

    time: NDArray[np.float64]  # s
    flange_position: NDArray[np.float64]  # m
    flange_velocity: NDArray[np.float64]  # m/s
    tool_position: NDArray[np.float64]  # m
    tool_velocity: NDArray[np.float64]  # m/s
    object_position: NDArray[np.float64]  # m, its face; the tool's face is at 0 when t = 0
    object_velocity: NDArray[np.float64]  # m/s
    contact_force: NDArray[np.float64]  # N, on the object
    coupling_force: NDArray[np.float64]  # N, on the tool

    @classmethod
    def of(cls, log: Recorder, rows: int) -> "Trace":
        """Return a copy of the first `rows` of what was recorded."""
        return cls(*log.trace[:rows].T.copy())


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of an approach; velocities at `duration`."""

    object_velocity: float  # m/s
    tool_velocity: float  # m/s
    flange_velocity: float  # m/s
    peak_force: float  # N, largest contact force
    detection_time: float | None  # s, contact force first exceeds the threshold; None if never or without a brake
    contacts: tuple[ContactRecord, ...]
    coupling_impulse: float  # N s, of the coupling on the tool over the contacts (paper, eq. 21)
    momentum_error: float  # -, largest residual of the paper's eq. 20 over the momentum exchanged
    steps: int  # integration steps in contact, rejected ones included
    status: str  # "ok"
    trace: Trace | None


def coupling_law(coupling: Coupling, tool_mass: float) -> RigidLaw | SpringDamperLaw:
    """Lower a coupling to the record that the kernels read and are chosen by."""
    if isinstance(coupling, SpringDamper):
        return SpringDamperLaw(tool_mass, math.sqrt(coupling.stiffness / tool_mass), coupling.damping_ratio)
    return RigidLaw(tool_mass)


def simulate(
    scene: Scene, motion: Trapezoid, duration: float = 1.5, rtol: float = 1e-8, trace: bool = False
) -> Outcome:
    """Run an approach and return what came of it.

    Args:
        scene: tool, object, contact and coupling; at rest at t = 0.
        motion: imposed motion of the flange.
        duration: length of the run, s.
        rtol: relative error aimed at for what comes of the contacts; flight is exact.
        trace: also return time histories, in flight a point a millisecond (or 1e5 of them, if that is fewer). They
            are read off the same motion, which they do not change.

    Raises:
        TypeError, ValueError: an argument is none of these or out of range; names it.
        RuntimeError: the run cannot finish; says why.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, got {scene!r}")
    if not isinstance(motion, Trapezoid):
        raise TypeError(f"motion must be a Trapezoid, got {motion!r}")
    duration = number("duration", duration, "s", above=0)
    rtol = number("rtol", rtol, "(no unit)", at_least=1e-13, at_most=1e-2)
    tolerance = Tolerance(LOCAL_SHARE * rtol, MAX_STEPS)
    law = coupling_law(scene.coupling, scene.tool.mass)
    bodies = Bodies(scene.object.mass, scene.contact.stiffness, float(dissipation.hu_guo(scene.contact.restitution)))
    brake = motion.brake
    profile = Profile(
        motion.speed,
        motion.acceleration,
        brake.threshold if brake else math.inf,
        brake.delay if brake else math.inf,
        motion.deceleration,
    )
    chains = np.zeros(1, CHAIN)
    rows = [_CONTACT_ROWS, _TRACE_ROWS if trace else 0]
    while True:
        log = recorder(rows[0], rows[1], interval=max(1e-3, duration / 1e5))
        status = Status(approach(law, bodies, chains, scene.object.distance, profile, duration, tolerance, log))
        chain = chains[0]
        if chain["logged"] <= rows[0] and chain["traced"] <= rows[1]:
            break
        rows = [int(chain["logged"]), int(chain["traced"])]  # the run repeats itself to the bit
    if status < 0:
        raise RuntimeError(f"the run stopped at t = {chain['time']:.6g} s: {SENTENCES[status]}")
    return _outcome(chain, log, trace)


def _outcome(chain: np.void, log: Recorder, trace: bool) -> Outcome:
    contacts = tuple(
        ContactRecord(start, None if math.isnan(end) else end, *rest)
        for start, end, *rest in log.contacts[: chain["logged"]].tolist()
    )
    flange, deflection, penetration = (
        float(chain[name]) for name in ("flange_velocity", "deflection_rate", "penetration_rate")
    )
    detection = float(chain["detection"])
    return Outcome(
        object_velocity=flange + deflection - penetration,
        tool_velocity=flange + deflection,
        flange_velocity=flange,
        peak_force=float(chain["peak_force"]),
        detection_time=detection if math.isfinite(detection) else None,
        contacts=contacts,
        coupling_impulse=float(chain["coupling_impulse"]),
        momentum_error=float(chain["momentum_error"]),
        steps=int(chain["steps"]),
        status="ok",
        trace=Trace.of(log, chain["traced"]) if trace else None,
    )
