"""Classes of the results that `simulate` and `sweep` return."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ContactRecord(NamedTuple):
    """One contact of tool and object."""

    start: float  # s
    end: float | None  # s; None if tool and object still touch at the end of the run
    approach_velocity: float  # m/s, penetration rate at the start: v_in of the paper's eq. 7
    separation_velocity: float  # m/s, minus the penetration rate at the end of the contact or of the run
    peak_force: float  # N
    impulse: float  # N s, on the object
    object_velocity: float  # m/s, at the end of the contact or of the run
    coupling_impulse: float  # N s, of the coupling on the tool (paper, eq. 21)
    momentum_error: float  # -, numerical error of the momentum balance (paper, eq. 20), divided by the impulse


class Trace(NamedTuple):
    """Time histories of a run, each (n,)."""

    time: Array  # s
    flange_position: Array  # m; with a rigid coupling it equals the tool position
    flange_velocity: Array  # m/s
    tool_position: Array  # m
    tool_velocity: Array  # m/s
    object_position: Array  # m, from the tool's face at t = 0 to the object's face; other positions start at 0
    object_velocity: Array  # m/s
    contact_force: Array  # N, on the object
    coupling_force: Array  # N, on the tool
    command_position: Array  # m, of the imposed motion; with a rigid robot it equals the flange position
    command_velocity: Array  # m/s, of the imposed motion

    @classmethod
    def of(cls, points: NDArray[Any]) -> "Trace":
        """Return a trace with copies of `points` (n,), an array of the dtype `kernels.TRACE`."""
        return cls(*(points[name].copy() for name in cls._fields))


class Outcome(NamedTuple):
    """Result of one approach; the first three fields are velocities at the end of the run."""

    object_velocity: float  # m/s
    tool_velocity: float  # m/s
    flange_velocity: float  # m/s; with a rigid coupling it equals the tool velocity
    peak_force: float  # N, largest contact force
    detection_time: float | None  # s, first time of a force above the brake's threshold; None: no such time or no brake
    contacts: tuple[ContactRecord, ...]
    coupling_impulse: float  # N s, of the coupling on the tool, summed over the contacts (paper, eq. 21)
    momentum_error: float  # -, largest `momentum_error` of the contacts
    steps: int  # number of integration steps, rejected steps included
    status: str  # always "ok", because `simulate` raises an error for a failed run
    trace: Trace | None
    snap_through: tuple[float, ...]  # s, times at which the slider of a `Bistable` coupling passes the alignment
    peak_object_velocity: float  # m/s, largest velocity of the object; without friction the final velocity
    slide: float | None  # m, slide of the object until it rests, as if no contact followed the run; None: no friction
    rest_time: float | None  # s, when object and tool (< 1 mm/s) have come to rest; inf: tool moves; None: no friction


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Results of a sweep, see `Outcome`. Each array has the broadcast shape of the varied values and durations."""

    object_velocity: Array  # m/s
    tool_velocity: Array  # m/s
    flange_velocity: Array  # m/s
    peak_force: Array  # N
    detection_time: Array  # s, nan if the contact force never exceeded the threshold, or without a brake
    first_contact: Array  # s, nan if there was no contact
    contact_count: NDArray[np.int64]
    snap_count: NDArray[np.int64]  # how often the slider of a `Bistable` coupling passed the alignment
    coupling_impulse: Array  # N s
    momentum_error: Array  # -
    peak_object_velocity: Array  # m/s
    slide: Array  # m, nan without friction
    rest_time: Array  # s, nan without friction, or if the tool is not at rest at the end of the run
    steps: NDArray[np.int64]
    status: NDArray[np.object_]  # "ok", or why the run could not finish; all floats of such a run are nan
