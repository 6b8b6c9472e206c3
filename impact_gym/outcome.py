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
    object_velocity: float  # m/s, at the end
    coupling_impulse: float  # N s, of the coupling on the tool (paper, eq. 21)
    momentum_error: float  # -, residual of the paper's eq. 20 over the impulse


class Trace(NamedTuple):
    """Time histories, (n,) each; points lie closer together inside contacts."""

    time: Array  # s
    flange_position: Array  # m, with a compliant robot and a rigid coupling that of the tool
    flange_velocity: Array  # m/s
    tool_position: Array  # m
    tool_velocity: Array  # m/s
    object_position: Array  # m, its face; the tool's face is at 0 when t = 0
    object_velocity: Array  # m/s
    contact_force: Array  # N, on the object
    coupling_force: Array  # N, on the tool
    command_position: Array  # m, of the imposed motion; the flange's if the robot is rigid
    command_velocity: Array  # m/s, likewise

    @classmethod
    def of(cls, points: NDArray[Any]) -> "Trace":
        """Return a copy of recorded points (n, TRACE)."""
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
    snap_through: tuple[float, ...]  # s, when the slider of a mechanism passes its alignment, first backwards
    peak_object_velocity: float  # m/s; without friction the object never loses velocity
    slide: float | None  # m, to where the object rests without contacts after `duration`; None without friction
    rest_time: float | None  # s, from when on it rests and the tool stays below 1 mm/s, inf if never; None likewise


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Results of a sweep, arrays of the shape that the varied parameters broadcast to; see `Outcome`.

    A row whose run cannot finish has nan for its numbers and the reason as its status; it does not affect other rows.
    """

    object_velocity: Array  # m/s
    tool_velocity: Array  # m/s
    flange_velocity: Array  # m/s
    peak_force: Array  # N
    detection_time: Array  # s, nan if the threshold was never exceeded
    first_contact: Array  # s, nan if there was none
    contact_count: NDArray[np.int64]
    snap_count: NDArray[np.int64]  # passages of the slider of a mechanism through its alignment
    coupling_impulse: Array  # N s
    momentum_error: Array  # -
    peak_object_velocity: Array  # m/s
    slide: Array  # m, nan without friction
    rest_time: Array  # s, nan without friction or if tool and object never both rest
    steps: NDArray[np.int64]
    status: NDArray[np.object_]  # "ok", or a sentence


@dataclass(frozen=True)
class Model:
    """A model of the scenes and its errors beside the full one."""

    name: str
    simplify: Callable[[Scene], Scene]
    errors: Array  # (scenes,), -, relative; inf where a run did not finish
    time_saved: float  # -, share of the full model's time

    @property
    def bound(self) -> float:
        """Largest error seen."""
        return float(self.errors.max())


@dataclass(frozen=True)
class Advice:
    """The fastest model that keeps a tolerance in all scenes."""

    quantity: Advised
    tolerance: float  # -, relative
    model: Model
    tried: tuple[Model, ...]  # the full one first

    def __str__(self) -> str:
        head = f"{self.quantity} within {self.tolerance:g} in {len(self.model.errors)} scenes: {self.model.name}"
        lines = (f"  {m.name}: error at most {m.bound:.2g}, {m.time_saved:.0%} less time" for m in self.tried)
        return "\n".join([head, *lines])
