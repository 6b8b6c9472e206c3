"""Results of `simulate`, `sweep` and `advise`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_gym.scene import Scene

Array = NDArray[np.float64]
Advised = Literal["object_velocity", "peak_force", "impulse"]


class ContactRecord(NamedTuple):
    """One contact of tool and object."""

    start: float  # s
    end: float | None  # s, None if unfinished
    approach_velocity: float  # m/s, penetration rate at the start: v_in of the paper's eq. 7
    separation_velocity: float  # m/s, at which the surfaces part; at `duration` if unfinished
    peak_force: float  # N
    impulse: float  # N s, on the object
    object_velocity: float  # m/s, at the end of the contact
    coupling_impulse: float  # N s, of the coupling on the tool (paper, eq. 21)
    momentum_error: float  # -, residual of the paper's eq. 20 over the impulse


class Trace(NamedTuple):
    """Time histories, (n,) each, with denser points in contacts."""

    time: Array  # s
    flange_position: Array  # m; with a compliant robot and a rigid coupling the position of the tool
    flange_velocity: Array  # m/s
    tool_position: Array  # m
    tool_velocity: Array  # m/s
    object_position: Array  # m, of its face; the face of the tool is at 0 at t = 0
    object_velocity: Array  # m/s
    contact_force: Array  # N, on the object
    coupling_force: Array  # N, on the tool
    command_position: Array  # m, of the imposed motion; with a rigid robot equal to the flange position
    command_velocity: Array  # m/s, of the imposed motion

    @classmethod
    def of(cls, points: NDArray[Any]) -> "Trace":
        """Return a copy of recorded points (n,), TRACE."""
        return cls(*(points[name].copy() for name in cls._fields))


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
    snap_through: tuple[float, ...]  # s, times at which the slider of a mechanism passes its alignment
    peak_object_velocity: float  # m/s; without friction the object never loses velocity
    slide: float | None  # m, of the object until it rests, without contacts after `duration`; None without friction
    rest_time: float | None  # s, object at rest, tool below 1 mm/s from then on; inf if never; None without friction


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Results of a sweep, arrays of the broadcast shape of the varied parameters; see `Outcome`.

    If a run cannot finish, its numbers are nan and its status is the reason. Other runs are not affected.
    """

    object_velocity: Array  # m/s
    tool_velocity: Array  # m/s
    flange_velocity: Array  # m/s
    peak_force: Array  # N
    detection_time: Array  # s, nan if the threshold was never exceeded
    first_contact: Array  # s, nan if there was none
    contact_count: NDArray[np.int64]
    snap_count: NDArray[np.int64]  # passages of a slider through its alignment
    coupling_impulse: Array  # N s
    momentum_error: Array  # -
    peak_object_velocity: Array  # m/s
    slide: Array  # m, nan without friction
    rest_time: Array  # s, nan without friction or if tool and object never both rest
    steps: NDArray[np.int64]
    status: NDArray[np.object_]  # "ok", or a sentence


@dataclass(frozen=True)
class Model:
    """A model of the scenes, and its errors relative to the full model."""

    name: str
    simplify: Callable[[Scene], Scene]
    errors: Array  # (scenes,), -, relative; inf if a run did not finish
    time_saved: float  # -, as a share of the time of the full model

    @property
    def bound(self) -> float:
        """Largest error in the scenes."""
        return float(self.errors.max())


@dataclass(frozen=True)
class Advice:
    """The fastest model within a tolerance in all scenes."""

    quantity: Advised
    tolerance: float  # -, relative
    model: Model
    tried: tuple[Model, ...]  # the full model first

    def __str__(self) -> str:
        head = f"{self.quantity} within {self.tolerance:g} in {len(self.model.errors)} scenes: {self.model.name}"
        lines = (f"  {m.name}: error at most {m.bound:.2g}, {m.time_saved:.0%} less time" for m in self.tried)
        return "\n".join([head, *lines])
