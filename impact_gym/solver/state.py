"""The state of a chain, one record for a single run and for each row of a batch, and the records that come out."""

from enum import IntEnum
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from impact_gym.physics.contact import Force
from impact_gym.physics.coupling import Law

Array = NDArray[Any]


def record(kind: type) -> np.dtype[Any]:
    """Return the NumPy record that has the fields of `kind`, floats and ints of 8 bytes."""
    return np.dtype([(name, np.dtype(of)) for name, of in kind.__annotations__.items()], align=True)


class Chain(Protocol):
    """What the kernels see of a row."""

    time: float  # s
    flange_position: float  # m, of the imposed motion: where the flange is if the robot is rigid
    flange_velocity: float  # m/s, likewise
    deflection: float  # m, tool minus imposed motion
    deflection_rate: float  # m/s
    penetration: float  # m, tool minus object face: the gap is its negative
    penetration_rate: float  # m/s
    flange_offset: float  # m, flange minus imposed motion; 0 but for a flange of its own behind a coupling
    flange_offset_rate: float  # m/s
    pressed: int  # which stop of a mechanism pushes: 1 front, -1 rear, 0 none
    side: int  # of the alignment the slider of a mechanism is on, 1 in front

    # the contact under way
    touching: int  # 0 or 1
    start: float  # s
    approach_velocity: float  # m/s
    start_tool_velocity: float  # m/s
    start_object_velocity: float  # m/s
    start_deflection: float  # m
    start_flange_position: float  # m
    impulse: float  # N s, on the object
    deflection_integral: float  # m s
    pull_impulse: float  # N s, of the coupling on the tool, where no closed form gives it
    joined: float  # N s, momentum of the mass that has joined the moving part
    contact_peak_force: float  # N
    step: float  # next trial step of the variable s of physics.contact

    # what has happened so far
    contacts: int
    first_contact: float  # s, inf if none yet
    detection: float  # s, inf if none yet
    peak_force: float  # N
    coupling_impulse: float  # N s, over the finished contacts (paper, eq. 21)
    momentum_error: float  # -, largest over the finished contacts (paper, eq. 20)
    steps: int  # integration steps, rejected ones included
    logged: int  # rows of the contact log, those that did not fit included
    traced: int  # rows of the trace, likewise
    snaps: int  # passages of the slider through the alignment, likewise


CHAIN = record(Chain)

CONTACT_COLUMNS = (
    "start", "end", "approach_velocity", "separation_velocity", "peak_force", "impulse", "object_velocity",
    "coupling_impulse", "momentum_error",
)  # fmt: skip

TRACE_COLUMNS = (
    "time", "flange_position", "flange_velocity", "tool_position", "tool_velocity",
    "object_position", "object_velocity", "contact_force", "coupling_force", "command_position", "command_velocity",
)  # fmt: skip


class Bodies(NamedTuple):
    """The object and the contact law, for the kernels."""

    object_mass: float  # kg
    contact: Force


class Recorder(NamedTuple):
    """Where contacts and trace are written; arrays of no rows record nothing."""

    contacts: Array  # (n, 9), columns as in CONTACT_COLUMNS
    trace: Array  # (n, 11), columns as in TRACE_COLUMNS
    snaps: Array  # (n,), s, times at which a slider passes its alignment
    interval: float  # s, between two points of a trace in flight


class Tolerance(NamedTuple):
    """What the integrator may do."""

    relative: float  # -, local error of a contact step in the contact's scales
    max_steps: int  # integration steps of one run


class Run(NamedTuple):
    """What stays as it is while a chain moves."""

    law: Law  # the coupling; its type chooses the kernels
    bodies: Bodies
    threshold: float  # N, of the contact alarm; inf if there is none
    tolerance: Tolerance
    recorder: Recorder
    work: Array  # scratch of the integrator


LOCAL_SHARE = 0.1
"""Local error allowed in a step, as a share of the `rtol` a user asks of the whole run."""


class Status(IntEnum):
    """Why a kernel came back."""

    ARRIVED = 0  # at the time asked for
    DETECTED = 1  # the contact force has just exceeded the threshold for the first time
    SEPARATED = 2  # the contact has ended
    TOUCHED = 3  # a contact begins
    SWITCHED = 4  # a stop has begun or ceased to push, or the slider has passed its alignment
    STEP_LIMIT = -1  # more integration steps than allowed
    NOT_FINITE = -2  # a state became inf or nan


SENTENCES = {
    Status.STEP_LIMIT: "more integration steps than allowed: the motion has too many swings or contacts",
    Status.NOT_FINITE: "the state overflowed: the scene's scales differ by more than floating point can hold",
}


def recorder(contact_rows: int = 0, trace_rows: int = 0, snap_rows: int = 0, interval: float = 1e-3) -> Recorder:
    """Return a recorder with room for so many rows; it traces flights every `interval` (s)."""
    return Recorder(
        np.empty((contact_rows, len(CONTACT_COLUMNS))),
        np.empty((trace_rows, len(TRACE_COLUMNS))),
        np.empty(snap_rows),
        interval,
    )
