"""The paper's model, and wrong models: each changes every scene and motion before they are simulated."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import impact_gym as ig
from experiments.lab.scenes import DURATION, MOTION, ROBOT, TOOL_MASS


@dataclass(frozen=True)
class Model:
    """A model that simulates the scenes of this study after a change of scene and motion."""

    scene: Callable[[ig.Scene], ig.Scene] = lambda scene: scene
    motion: Callable[[ig.Trapezoid], ig.Trapezoid] = lambda motion: motion

    def trace(
        self, scene: ig.Scene, motion: ig.Trapezoid = MOTION, duration: float = DURATION
    ) -> tuple[ig.Outcome, ig.Trace]:
        """Simulate one approach for `duration` (s); return outcome and time histories."""
        outcome = ig.simulate(self.scene(scene), self.motion(motion), duration, trace=True)
        assert outcome.trace is not None
        return outcome, outcome.trace

    def simulate(self, scene: ig.Scene, motion: ig.Trapezoid = MOTION, duration: float = DURATION) -> ig.Outcome:
        """Simulate one approach for `duration` (s)."""
        return ig.simulate(self.scene(scene), self.motion(motion), duration)

    def sweep(self, scene: ig.Scene, varied: Mapping[str, Any], duration: float) -> ig.Outcomes:
        """Simulate approaches for `duration` (s) that differ in the numbers of `varied`."""
        return ig.sweep(self.scene(scene), self.motion(MOTION), varied, duration)


PAPER = Model()


def _with(name: str, new: Any = None, only: type[Any] = object, **fields: Any) -> Model:
    """Return a model with a new part of the scene, or new fields of the part, if the part has the type `only`."""

    def changed(scene: ig.Scene) -> ig.Scene:
        part: Any = getattr(scene, name)
        parts: dict[str, Any] = {name: replace(part, **fields) if fields else new} if isinstance(part, only) else {}
        return replace(scene, **parts)

    return Model(changed)


WRONG = {
    "damping of Hunt and Crossley": _with("contact", dissipation="hunt-crossley"),
    "linear damper (n = 0)": _with("contact", dissipation="exact", damping_exponent=0.0),
    "linear spring (m = 1)": _with("contact", stiffness_exponent=1.0),
    "elastic contact (e = 1)": _with("contact", restitution=1.0),
    "e has no effect (0.1)": _with("contact", restitution=0.1),
    "k_c has no effect (1e4)": _with("contact", stiffness=1e4),
    "soft contact (10)": _with("contact", stiffness=10.0),
    "tool 4 times as heavy": _with("tool", mass=4.0 * TOOL_MASS),
    "no brake": Model(motion=lambda motion: replace(motion, brake=None)),
    "half the speed": Model(motion=lambda motion: replace(motion, speed=0.5 * motion.speed)),
    "rigid robot": _with("robot"),
    "robot 10 times as soft": _with("robot", only=ig.Robot, stiffness=0.1 * ROBOT.stiffness),
    "fixed tool": _with("coupling", ig.Rigid()),
    "spring nearly undamped": _with("coupling", only=ig.SpringDamper, damping_ratio=0.02),
    "mechanism for a spring": _with("coupling", ig.Bistable(), only=ig.SpringDamper),
    "spring for a mechanism": _with("coupling", ig.SpringDamper(50.0), only=ig.Bistable),
}  # by name; stiffnesses of the contact in N/m^1.5
