"""The state of a chain, one record for a single run and for each row of a batch, and the records that come out."""

from enum import IntEnum
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from impact_gym.physics.coupling import Law

Array = NDArray[Any]


def record(kind: type) -> np.dtype[Any]:
    """Return the NumPy record that has the fields of `kind`, floats and ints of 8 bytes."""
    return np.dtype([(name, np.dtype(of)) for name, of in kind.__annotations__.items()], align=True)


class Chain(Protocol):
    """What the kernels see of a row."""

    time: float  # s
    flange_position: float  # m
    flange_velocity: float  # m/s
    deflection: float  # m, tool minus flange
    deflection_rate: float  # m/s
    penetration: float  # m, tool minus object face: the gap is its negative
    penetration_rate: float  # m/s

    # the contact under way
    touching: int  # 0 or 1
    start: float  # s
    approach_velocity: float  # m/s
    start_tool_velocity: float  # m/s
    start_object_velocity: float  # m/s
    start_deflection: float  # m
    impulse: float  # N s, on the object
    deflection_integral: float  # m s
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


CHAIN = record(Chain)

CONTACT_COLUMNS = (
    "start", "end", "approach_velocity", "separation_velocity", "peak_force", "impulse", "object_velocity",
)  # fmt: skip

TRACE_COLUMNS = (
    "time", "flange_position", "flange_velocity", "tool_position", "tool_velocity",
    "object_position", "object_velocity", "contact_force", "coupling_force",
)  # fmt: skip


class Bodies(NamedTuple):
    """The object and the contact law, for the kernels."""

    object_mass: float  # kg
    stiffness: float  # N/m^1.5
    damping: float  # -, damping factor d


class Recorder(NamedTuple):
    """Where contacts and trace are written; arrays of no rows record nothing."""

    contacts: Array  # (n, 7), columns as in CONTACT_COLUMNS
    trace: Array  # (n, 9), columns as in TRACE_COLUMNS
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
    STEP_LIMIT = -1  # more integration steps than allowed
    NOT_FINITE = -2  # a state became inf or nan


SENTENCES = {
    Status.STEP_LIMIT: "more integration steps than allowed: the contact is too stiff for the explicit method",
    Status.NOT_FINITE: "the state overflowed: the scene's scales differ by more than floating point can hold",
}


def recorder(contact_rows: int = 0, trace_rows: int = 0, interval: float = 1e-3) -> Recorder:
    """Return a recorder with room for so many rows; it traces flights every `interval` (s)."""
    return Recorder(
        np.empty((contact_rows, len(CONTACT_COLUMNS))),
        np.empty((trace_rows, len(TRACE_COLUMNS))),
        interval,
    )
