"""The parts of a scene: tool, coupling of tool and flange, robot, object, and contact of tool and object.

The only axis, +x, points from the robot to the object. The classes check their numbers, and store them as floats in SI
units; `impact_gym.quantities` has the limits.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from scipy.interpolate import CubicSpline

from impact_gym.couplings import COUPLINGS, Coupling, Rigid
from impact_gym.parameters import Parameters
from impact_gym.quantities import BY_PATH
from impact_gym.support.validation import number, one_of

Dissipation = Literal[
    "hu-guo", "exact", "hunt-crossley", "lankarani-nikravesh", "herbert-mcwhannell", "gonthier", "flores", "fixed"
]
"""Laws that give the damping for a nominal restitution, see `Contact`."""
LAWS = get_args(Dissipation)


@dataclass(frozen=True, slots=True)
class Tool(Parameters, path="tool"):
    """The body that strikes."""

    mass: float  # kg


@dataclass(frozen=True, slots=True)
class Object(Parameters, path="object"):
    """The body that is struck; it is at rest before the first contact.

    With `friction` the object (mass m_p) sticks until the contact force exceeds mu m_p g, with g = 9.80665 m/s^2. Then
    the object slides to rest, and sticks again.
    """

    mass: float  # kg
    distance: float  # m, gap between the faces of tool and object at t = 0
    friction: float | None = None  # -, mu, coefficient of Coulomb friction between object and ground; None: no friction


@dataclass(frozen=True, slots=True)
class Contact(Parameters, path="contact"):
    """Contact of a plane tool with an object: F = max(k_c delta^m + chi delta^n delta_dot, 0) in N (paper, eq. 5).

    delta is the penetration in m, delta_dot its rate, k_c the stiffness, chi the hysteresis damping. The default, m = n
    = 3/2, is for a sphere; m = 1 and n = 0 give a linear spring and damper. `dissipation` names the law that gives chi
    for a nominal restitution of an isolated contact (no other force). With "exact" the contact has this restitution.
    With "hu-guo" (paper, eq. 7) and m = n it has 0.4877 for a nominal 0.5, and 0.0741 for 0.1 (docs/provenance.md). The
    other laws are in `physics.dissipation`. With all laws but "fixed" the restitution is the same for all approach
    velocities from 1e-6 m/s on. With "fixed" chi is constant: a contact that begins at `reference_velocity` has the
    nominal restitution; if m = n, a faster contact has a lower one, as in measurements.
    """

    checked_by_itself: ClassVar = ("stiffness",)  # checked below, because its unit depends on the exponent
    stiffness: float  # k_c, in N/m^stiffness_exponent
    restitution: float  # -, nominal restitution
    dissipation: Dissipation = "hu-guo"
    stiffness_exponent: float = 1.5  # -, exponent m of the penetration
    damping_exponent: float = 1.5  # -, exponent n of the penetration in the damping force; 0 or at least 1
    reference_velocity: float | None = None  # m/s, approach velocity, only with dissipation "fixed" (None: 1 m/s)

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        if self.dissipation == "fixed" and self.reference_velocity is None:
            object.__setattr__(self, "reference_velocity", 1.0)
        elif self.dissipation != "fixed" and self.reference_velocity is not None:
            raise ValueError(
                f'Contact.reference_velocity must be None unless dissipation is "fixed", got '
                f"{self.reference_velocity!r} m/s with {self.dissipation!r}"
            )
        if not self.fits():
            raise ValueError(
                f"Contact.damping_exponent must be 0 or at least 1, got {self.damping_exponent!r} (no unit)"
            )
        quantity, unit = BY_PATH["contact.stiffness"], f"N/m^{self.stiffness_exponent:g}"
        stiffness = number("Contact.stiffness", self.stiffness, unit, **quantity.limits._asdict())
        object.__setattr__(self, "stiffness", stiffness)

    def fits(self) -> Any:
        """Return whether the damping force is defined for the exponents; they may be arrays."""
        return (self.damping_exponent == 0) | (self.damping_exponent >= 1)


@dataclass(frozen=True, slots=True)
class Robot(Parameters, path="robot"):
    """A compliant robot, as one mass on a spring and damper (paper, eq. 8-9, Fig. 8), at rest and relaxed at t = 0.

    The imposed motion x_r drives the robot's mass through the spring and damper. With a `Rigid` coupling, robot and
    tool are one mass. With any other coupling the robot's mass is the flange.
    """

    mass: float  # kg, m_r
    stiffness: float  # N/m, k_r
    damping: float  # N s/m, c_r


@dataclass(frozen=True, slots=True)
class RobotTable(Parameters, path="robot"):
    """A compliant robot with parameters that vary along its imposed motion (paper, eq. 16, Fig. 12).

    Between the positions each parameter is a cubic spline (not-a-knot); outside them it is constant.
    """

    position: tuple[float, ...]  # m, distances along the imposed motion: at least 4 rising numbers
    mass: tuple[float, ...]  # kg; mass, stiffness and damping have one value per position
    stiffness: tuple[float, ...]  # N/m
    damping: tuple[float, ...]  # N s/m

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        if len(self.position) < 4 or not np.all(np.diff(self.position) > 0):
            raise ValueError(f"RobotTable.position must be at least 4 rising numbers in m, got {self.position!r}")
        for name in ("mass", "stiffness", "damping"):
            if len(getattr(self, name)) != len(self.position):
                raise ValueError(f"RobotTable.{name} must have one value for each of the {len(self.position)} "
                                 f"positions, got {len(getattr(self, name))}")  # fmt: skip
        lowest = self.splines.derivative().roots(extrapolate=False)
        for place, name in enumerate(("mass", "stiffness", "damping")):
            turns = lowest[place][np.isfinite(lowest[place])]
            values = self.splines(turns)[:, place]
            if np.any(values < 0) or (name != "damping" and np.any(values <= 0)):
                raise ValueError(
                    f"RobotTable.{name} must stay positive between positions (damping may be 0); its spline falls to "
                    f"{values.min():.6g} {BY_PATH[f'robot.{name}'].unit}: give more positions where it varies fast"
                )

    @property
    def splines(self) -> Any:
        """Mass, stiffness and damping as one `scipy.interpolate.CubicSpline` of the position."""
        return _splines(self)

    def at(self, position: float) -> Robot:
        """Return the robot with its parameters at `position` (m)."""
        x = number("position", position, "m")
        return Robot(*map(float, self.splines(min(max(x, self.position[0]), self.position[-1]))))


@lru_cache(maxsize=64)  # not of the property: Python 3.14 then refuses the slots of its class
def _splines(table: RobotTable) -> Any:
    return CubicSpline(table.position, np.array([table.mass, table.stiffness, table.damping]).T)


@dataclass(frozen=True, slots=True)
class Scene:
    """Tool, object, contact, coupling and robot, at rest at t = 0."""

    tool: Tool
    object: Object
    contact: Contact
    coupling: Coupling = field(default_factory=Rigid)
    robot: Robot | RobotTable | None = None  # None: rigid, the flange follows the imposed motion

    def __post_init__(self) -> None:
        one_of("Scene.tool", self.tool, Tool)
        one_of("Scene.object", self.object, Object)
        one_of("Scene.contact", self.contact, Contact)
        if not isinstance(self.coupling, Coupling):
            one_of("Scene.coupling", self.coupling, *COUPLINGS)
        one_of("Scene.robot", self.robot, Robot, RobotTable, type(None))
