"""From groups to a predicted error: a sum with calibrated constants, and the group that weighs most in it."""

import json
import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from impact_gym.fidelity import groups
from impact_gym.fidelity.groups import Groups
from impact_gym.fidelity.situation import Situation, situation
from impact_gym.fidelity.swing import Swing, drift, swing
from impact_gym.motion import Trapezoid
from impact_gym.physics import impact
from impact_gym.scene import Rigid, Robot, RobotTable, Scene, SpringDamper, Tool

CONSTANTS = Path(__file__).parent / "constants.json"
NAMES = {"Rigid": "rigid", "SpringDamper": "spring", "Bistable": "bistable"}


@dataclass(frozen=True, slots=True)
class Prediction:
    """What a reduction is predicted to cost."""

    kind: str  # reduction and coupling, "robot/spring"
    quiet: bool  # see `Situation.quiet`: which of two sets of constants holds
    groups: Groups  # -, as in `groups`

    @property
    def parts(self) -> Groups:
        """Contribution of each group to the error, -; none where no constants are known."""
        return weighed(self.kind, self.quiet, self.groups, constants())

    @property
    def error(self) -> float:
        """Predicted relative error of V_p, exceeded in under 1 % of scenes; calibrated, see experiments/fidelity."""
        return predicted(self.parts)

    @property
    def largest(self) -> str:
        """Name of the group that contributes most."""
        parts = self.parts or self.groups
        return max(parts, key=lambda name: parts[name])


def weighed(kind: str, quiet: bool, groups: Groups, known: dict[str, Any]) -> Groups:
    """Return `groups` times the constants in `known`; nothing if there are none for this kind of reduction."""
    weights = known["quiet" if quiet else "loud"].get(kind)
    return {} if weights is None else {name: weights.get(name, 0.0) * value for name, value in groups.items()}


def predicted(parts: Groups) -> float:
    """Return the sum of what groups contribute; inf if nothing is known."""
    total = sum(parts.values())
    return total if parts and math.isfinite(total) else math.inf


@lru_cache(maxsize=1)
def constants() -> dict[str, Any]:
    """Return the calibrated constants and their provenance."""
    found: dict[str, Any] = json.loads(CONSTANTS.read_text(encoding="utf-8"))
    return found


def chain(scene: Scene) -> str:
    """Name of the couplings in `scene` among the costs: "spring", "spring+robot", "spring+table"."""
    robot = "" if scene.robot is None else "+table" if isinstance(scene.robot, RobotTable) else "+robot"
    return NAMES[type(scene.coupling).__name__] + robot


def lumped(scene: Scene) -> Scene:
    """Return the scene of one mass on a spring that a tool fixed to a `Robot` is (paper, eq. 8)."""
    robot = scene.robot
    assert isinstance(robot, Robot)
    m = robot.mass + scene.tool.mass
    ratio = 0.5 * robot.damping / math.sqrt(robot.stiffness * m)
    return Scene(Tool(m), scene.object, scene.contact, SpringDamper(robot.stiffness, ratio))


def closed_velocity(now: Situation, coupled: bool = True) -> float:
    """Final velocity of the object after an instantaneous impact, m/s (paper, eq. 1-4 and 22).

    `coupled`: with the impulse of the coupling, and with the restitution that its push leaves, e - s phi.
    """
    v, e = now.velocity, now.contact.restitution
    if isinstance(now.scene.coupling, Rigid):
        return float(impact.rigid_tool(v, 0.0, e))
    m_t, push = now.scene.tool.mass, now.push if coupled else 0.0
    e = min(max(e - now.contact.sensitivity * push * now.contact.time / v, 0.0), 1.0)
    impulse = m_t * push * now.contact.duration
    return float(impact.free_tool(m_t, now.scene.object.mass, v, 0.0, e, impulse)[1])


@dataclass(frozen=True, slots=True)
class Inspection:
    """A scene and what is known about it before any run."""

    scene: Scene
    now: Situation  # with a rigid robot
    robot: Robot | None  # frozen at the impact if it is a table
    swing: Swing | None
    one: Situation | None  # of tool and robot as one mass, where the tool is fixed to a robot

    @property
    def coupling(self) -> str:
        """Its name among the constants."""
        return NAMES[type(self.scene.coupling).__name__]


def inspect(scene: Scene, motion: Trapezoid) -> Inspection:
    """Return what is known about `scene` under `motion`."""
    now = situation(replace(scene, robot=None), motion)
    if scene.robot is None:
        return Inspection(scene, now, None, None, None)
    robot = scene.robot.at(scene.object.distance) if isinstance(scene.robot, RobotTable) else scene.robot
    one = None
    if isinstance(scene.coupling, Rigid):
        one = situation(lumped(replace(scene, robot=robot)), motion)
    return Inspection(scene, now, robot, swing(now, robot), one)


def predictions(seen: Inspection) -> dict[str, Prediction]:
    """Return what each reduction but that of the stops is predicted to cost, by name.

    "closed" and "free" hold for a rigid robot, "lumped" for a tool fixed to a robot that is or was made constant.
    """
    now, coupling = seen.now, seen.coupling
    found = {"closed": Prediction(f"closed/{coupling}", now.quiet, groups.closed(now))}
    if coupling != "rigid":
        found["free"] = Prediction(f"free/{coupling}", now.quiet, found["closed"].groups)
    if seen.swing is not None:
        table = seen.scene.robot if isinstance(seen.scene.robot, RobotTable) else None
        drifting = drift(now, seen.swing, table) if table else None
        found["robot"] = Prediction(f"robot/{coupling}", now.quiet, groups.robot(now, seen.swing, drifting))
        if drifting is not None:
            found["frozen"] = Prediction(f"frozen/{coupling}", now.quiet, groups.frozen(now, seen.swing, drifting))
    if seen.one is not None:
        found["lumped"] = Prediction("closed/lumped", seen.one.quiet, groups.closed(seen.one))
    return found


def softened(seen: Inspection, stiffness: float) -> Prediction:
    """Return what stops of `stiffness` (N/m) are predicted to cost."""
    return Prediction("stops/bistable", seen.now.quiet, groups.stops(seen.now, stiffness))
