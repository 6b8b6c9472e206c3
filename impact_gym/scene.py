"""What a user describes: a tool, its coupling to the flange, an object, and the contact between tool and object.

One axis, +x from the robot to the object. All records are frozen, hold floats in SI units and check themselves when
they are made, so that everything behind them may rely on them.
"""

from dataclasses import dataclass, field
from typing import Literal, get_args

from impact_gym.validation import number

Dissipation = Literal["hu-guo"]


@dataclass(frozen=True, slots=True)
class Tool:
    """The body that strikes."""

    mass: float  # kg

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", number("Tool.mass", self.mass, "kg", above=0))


@dataclass(frozen=True, slots=True)
class Object:
    """The body that is struck; at rest until then, without friction."""

    mass: float  # kg
    distance: float  # m, gap between the faces at rest, t = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", number("Object.mass", self.mass, "kg", above=0))
        object.__setattr__(self, "distance", number("Object.distance", self.distance, "m", above=0))


@dataclass(frozen=True, slots=True)
class Contact:
    """Hertz contact of a plane tool with a spherical object, with hysteresis damping (paper, eq. 5 and 7).

    `dissipation` says how the damping follows from the restitution. Equation 7, "hu-guo", delivers a little less than
    the restitution it is given: 0.4877 for 0.5, 0.0741 for 0.1 (see docs/provenance.md).
    """

    stiffness: float  # N/m^1.5
    restitution: float  # -, nominal
    dissipation: Dissipation = "hu-guo"

    def __post_init__(self) -> None:
        object.__setattr__(self, "stiffness", number("Contact.stiffness", self.stiffness, "N/m^1.5", above=0))
        restitution = number("Contact.restitution", self.restitution, "(no unit)", above=0, at_most=1)
        object.__setattr__(self, "restitution", restitution)
        if self.dissipation not in get_args(Dissipation):
            raise ValueError(f"Contact.dissipation must be one of {get_args(Dissipation)}, got {self.dissipation!r}")


@dataclass(frozen=True, slots=True)
class Rigid:
    """Tool fixed to the flange: its motion is imposed, the robot is taken as infinitely heavy (paper, Fig. 4a)."""


@dataclass(frozen=True, slots=True)
class SpringDamper:
    """Tool behind a linear spring and damper (paper, eq. 17-18); c_t = 2 zeta sqrt(k_t m_t)."""

    stiffness: float  # N/m
    damping_ratio: float = 1.0  # -

    def __post_init__(self) -> None:
        object.__setattr__(self, "stiffness", number("SpringDamper.stiffness", self.stiffness, "N/m", above=0))
        ratio = number("SpringDamper.damping_ratio", self.damping_ratio, "(no unit)", at_least=0, at_most=1e6)
        object.__setattr__(self, "damping_ratio", ratio)


Coupling = Rigid | SpringDamper


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything that stands or moves, at rest at t = 0 with the coupling relaxed."""

    tool: Tool
    object: Object
    contact: Contact
    coupling: Coupling = field(default_factory=Rigid)
    robot: None = None  # a rigid robot; the compliant one has no model yet

    def __post_init__(self) -> None:
        kinds = {"tool": (Tool,), "object": (Object,), "contact": (Contact,), "coupling": get_args(Coupling)}
        for name, allowed in kinds.items():
            if not isinstance(getattr(self, name), allowed):
                wanted = " or ".join(kind.__name__ for kind in allowed)
                raise TypeError(f"Scene.{name} must be a {wanted}, got {getattr(self, name)!r}")
        if self.robot is not None:
            raise ValueError(f"Scene.robot must be None (a rigid robot), got {self.robot!r}")
