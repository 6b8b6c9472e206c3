"""From the records a user describes a scene with to the flat ones that the kernels read."""

import math
import struct
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from impact_gym.kernels import APPROACH, INTEGRATED, LAW, NOT_FINITE, RIGID, SPRING, STEP_LIMIT, bistable_force
from impact_gym.motion import Trapezoid
from impact_gym.physics.dissipation import damping_factor
from impact_gym.scene import Bistable, Contact, Coupling, Rigid, Robot, RobotTable, Scene, SpringDamper

Numbers = NDArray[np.float64]

EVERYWHERE = 1e9  # m; a lumped robot is a table of one interval, so much to either side
NO_TABLE: Numbers = np.zeros(1)
_MECHANISM = tuple(LAW["mechanism"].names or ())
_MECHANISM_AT = (LAW.names or ()).index("mechanism")


def _codes(record: np.dtype[Any]) -> str:
    """Return what `struct` calls the fields of a record."""
    inner = [record[name] for name in record.names or ()]
    return "".join(_codes(one) if one.names else "dq"[one.kind == "i"] for one in inner)


_APPROACH = struct.Struct(_codes(APPROACH))


LOCAL_SHARE = 0.2
"""Local error allowed in a step, as a share of the `rtol` a user asks of the whole run."""

SENTENCES = {
    STEP_LIMIT: "more integration steps than allowed: the motion has too many swings or contacts",
    NOT_FINITE: "the state overflowed: the scene's scales differ by more than floating point can hold",
}
"""What the statuses below zero mean."""


def approach_plan(
    scene: Scene, motion: Trapezoid, duration: float, table_at: int = 0
) -> tuple[tuple[Any, ...], Numbers]:
    """Lower an approach to the fields of the kernels' `Approach`, and its robot's table, which begins at `table_at`."""
    law, table = chain_law(scene.tool.mass, scene.coupling, scene.robot, table_at)
    brake = motion.brake
    threshold, delay = (brake.threshold, brake.delay) if brake else (math.inf, math.inf)
    target = scene.object
    profile = motion.speed, motion.acceleration, threshold, delay, motion.deceleration
    return (law, contact_law(scene.contact), target.mass, target.distance, *profile, duration, 0.0), table


def packed(plan: tuple[Any, ...]) -> bytes:
    """Return a plan as the bytes of one APPROACH: what an array of one would hold, at a tenth of its cost."""
    law, contact, *rest = plan
    at = _MECHANISM_AT
    return _APPROACH.pack(*law[:at], *law[at], *law[at + 1 :], *contact, *rest)


def contact_law(contact: Contact) -> tuple[Any, ...]:
    """Lower a contact to the fields of the kernels' `Contact`."""
    m, n = contact.stiffness_exponent, contact.damping_exponent
    damping = damping_factor(contact.dissipation, contact.restitution, m, n)
    return contact.stiffness, damping, m, n, _whole(2.0 * m), _whole(2.0 * n), 1.0


def _whole(number: float) -> int:
    return int(number) if number == int(number) else -1


def chain_law(
    tool_mass: float, coupling: Coupling, robot: Robot | RobotTable | None = None, table_at: int = 0
) -> tuple[tuple[Any, ...], Numbers]:
    """Lower what holds the tool to the simplest chain that describes it: fields of `Law`, and its robot's table."""
    if robot is None:
        if isinstance(coupling, Rigid):
            return _law(RIGID, tool_mass), NO_TABLE
        if isinstance(coupling, SpringDamper):
            return _spring(tool_mass, coupling.stiffness, coupling.damping_ratio), NO_TABLE
        return _integrated(tool_mass, **_coupled(tool_mass, coupling)), NO_TABLE
    if isinstance(coupling, Rigid) and isinstance(robot, Robot):
        mass = robot.mass + tool_mass
        return _spring(mass, robot.stiffness, 0.5 * robot.damping / math.sqrt(robot.stiffness * mass)), NO_TABLE
    breaks, values = _table(robot)
    stiffest = max(k / m for m, k, _ in _at_breaks(robot))
    parts = {} if isinstance(coupling, Rigid) else _coupled(tool_mass, coupling)
    law = _integrated(tool_mass, table=table_at, intervals=len(breaks) - 1, stiffest=stiffest, **parts)
    return law, np.concatenate([breaks, values.ravel()])


_NO_MECHANISM = (0.0,) * len(_MECHANISM)


def _law(kind: int, tool_mass: float, frequency: float = 0.0, damping_ratio: float = 0.0) -> tuple[Any, ...]:
    """Return the fields of a `Law` with a closed form."""
    return kind, tool_mass, frequency, damping_ratio, 0, 0, 0.0, 0.0, _NO_MECHANISM, 0, 0, 0.0


def _spring(mass: float, stiffness: float, damping_ratio: float) -> tuple[Any, ...]:
    return _law(SPRING, mass, math.sqrt(stiffness / mass), damping_ratio)


def _integrated(tool_mass: float, **parts: Any) -> tuple[Any, ...]:
    """Return the fields of a `Law` of which only some `parts` are there."""
    fields = dict(zip(LAW.names or (), _law(INTEGRATED, tool_mass), strict=True))
    return tuple((fields | parts).values())


def _coupled(tool_mass: float, coupling: SpringDamper | Bistable) -> dict[str, Any]:
    """Return the fields of a coupling that is integrated."""
    if isinstance(coupling, SpringDamper):
        damping = 2.0 * coupling.damping_ratio * math.sqrt(coupling.stiffness * tool_mass)
        return {"coupled": 1, "stiffness": coupling.stiffness, "damping": damping}
    fields = {name: getattr(coupling, name, 0.0) for name in _MECHANISM}
    fields["rest"] = rest_of(coupling)
    fields["stop_damping"] = 2.0 * coupling.stop_damping_ratio * math.sqrt(coupling.stop_stiffness * tool_mass)
    return {"coupled": 1, "bistable": 1, "mechanism": tuple(fields.values())}


@lru_cache(maxsize=256)
def rest_of(mechanism: Bistable) -> float:
    """Position of the slider where the front stop bears the preload, m."""
    front, k_s = mechanism.front_stop, mechanism.stop_stiffness

    def net(depth: float) -> float:
        force = bistable_force(mechanism.stiffness, mechanism.free_length, mechanism.height, front + depth)
        return float(force) - k_s * depth

    return front + float(brentq(net, 0.0, mechanism.stroke - front, xtol=1e-18, rtol=8.9e-16))


def _table(robot: Robot | RobotTable) -> tuple[Numbers, Numbers]:
    """Return the breaks (n + 1,) and coefficients (n, 3, 4), the constant first, of a robot's parameters."""
    if isinstance(robot, RobotTable):
        return robot.splines.x, robot.splines.c[::-1].transpose(1, 2, 0)
    values = np.zeros((1, 3, 4))
    values[0, :, 0] = robot.mass, robot.stiffness, robot.damping
    return np.array([-EVERYWHERE, EVERYWHERE]), values


def _at_breaks(robot: Robot | RobotTable) -> Any:
    if isinstance(robot, RobotTable):
        return robot.splines(robot.splines.x)
    return [(robot.mass, robot.stiffness, robot.damping)]
