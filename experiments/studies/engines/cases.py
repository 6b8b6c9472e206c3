"""The cases, each a blow of a tool on an object along one line, and their answers; cases.json has them as data."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import impact_gym as ig
from impact_gym.physics.dissipation import damping_factor
from impact_gym.support.dotted_paths import record_from
from impact_gym.support.files import parsed
from impact_gym.support.validation import number

SHIPPED = Path(__file__).with_suffix(".json")
LEAST = 1e-3  # restitution that laws of damping are asked for in place of 0, which none of them reaches
RADIUS = 0.05  # m, of the spheres in engines
AS_FAST = 100.0  # m/s^2, acceleration of the rigid tool that stands for two free bodies


@dataclass(frozen=True)
class Case:
    """A blow. Without a spring the tool flies freely; with one, a flange that starts at rest carries it."""

    name: str
    about: str
    tool_mass: float  # kg
    object_mass: float  # kg
    stiffness: float  # k_c of the Hertz contact, N/m^1.5
    restitution: float  # -, of an isolated contact
    speed: float  # m/s, of a free tool at the start, or of the flange after its acceleration
    distance: float  # m, from the tool to the object at the start
    duration: float  # s
    answers: Mapping[str, Any]  # of the exact law, SI; None: no damping gives the law a restitution of 0
    spring: float | None = None  # N/m, stiffness between flange and tool, critically damped; None: free tool
    acceleration: float | None = None  # m/s^2, of the flange
    brake: Mapping[str, float] | None = None  # threshold (N) of the contact force, delay (s), deceleration (m/s^2)

    def __post_init__(self) -> None:
        for name in ("tool_mass", "object_mass", "stiffness", "speed", "distance", "duration"):
            number(f"case {self.name}: {name}", getattr(self, name), "SI", above=0.0)
        number(f"case {self.name}: restitution", self.restitution, "-", at_least=0.0, at_most=1.0)

    @property
    def start_speed(self) -> float:
        """Speed of the tool at the start, m/s."""
        return 0.0 if self.spring else self.speed

    @property
    def bodies(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Tool and object as spheres of RADIUS: position of the centre (m), speed (m/s), mass (kg) at the start."""
        return (0.0, self.start_speed, self.tool_mass), (2 * RADIUS + self.distance, 0.0, self.object_mass)

    @property
    def reduced_mass(self) -> float:
        """Reduced mass of tool and object, kg."""
        return self.tool_mass * self.object_mass / (self.tool_mass + self.object_mass)

    @property
    def linear_stiffness(self) -> float:
        """Stiffness (N/m) of a linear spring with the same peak force as the Hertz contact, if both are elastic.

        The energy M v^2 / 2 compresses the Hertz contact by (5 M v^2 / 4 k_c)^0.4, and the spring by F / K.
        """
        energy = self.reduced_mass * self.speed**2
        return float((self.stiffness * (1.25 * energy / self.stiffness) ** 0.6) ** 2 / energy)

    @property
    def asked_restitution(self) -> float:
        """Restitution that laws of damping are asked for, at least LEAST."""
        return max(self.restitution, LEAST)

    def linear_damping(self, restitution: float) -> float:
        """Damping (N s/m) that gives the spring `linear_stiffness` a restitution: 2 zeta sqrt(K M)."""
        doubled_ratio = damping_factor("exact", restitution, 1.0, 0.0)
        return float(doubled_ratio * (self.linear_stiffness * self.reduced_mass) ** 0.5)

    @property
    def motion(self) -> ig.Trapezoid:
        """Motion of the flange, or of the rigid tool that stands for a free one."""
        return ig.Trapezoid(self.speed, self.acceleration or AS_FAST, ig.Brake(**self.brake) if self.brake else None)

    def solved(self, solver: Any = ig.simulate, exponents: tuple[float, float] = (1.5, 1.5), **options: Any) -> Any:
        """Return the numbers of `answers` by a solver: `ig.simulate`, or the independent `reference.simulate`.

        A rigid tool has an infinite mass, so it strikes a reduced mass as two free bodies strike each other.
        `exponents` other than those of Hertz have the stiffness `linear_stiffness`.
        """
        k = self.stiffness if exponents == (1.5, 1.5) else self.linear_stiffness
        contact = ig.Contact(k, self.asked_restitution, "exact", *exponents)
        spring, mass = self.spring, self.object_mass if self.spring else self.reduced_mass
        distance, ramp = (self.distance, 0.0) if spring else (self.speed**2 / AS_FAST, self.speed / AS_FAST)
        coupling = ig.SpringDamper(spring) if spring else ig.Rigid()
        scene = ig.Scene(ig.Tool(self.tool_mass), ig.Object(mass, distance), contact, coupling)
        found = solver(scene, self.motion, self.duration + 2 * ramp, **options)
        ends = [self.duration if each.end is None else each.end for each in found.contacts]
        lasted = sum(end - each.start for end, each in zip(ends, found.contacts, strict=True))
        impulse = sum(each.impulse for each in found.contacts)
        return {"object_velocity": impulse / self.object_mass, "impulse": impulse, "peak_force": found.peak_force,
                "contact_duration": lasted, "contacts": len(found.contacts)}  # fmt: skip


def read(path: Path = SHIPPED) -> dict[str, Case]:
    """Return the cases of a file by name; ValueError: it cannot be read, or a case lacks a field."""

    def listed(text: str) -> dict[str, Case]:
        return {each["name"]: record_from(f"case {each['name']}", each, (Case,)) for each in json.loads(text)["cases"]}

    return parsed(path, "cases", listed)
