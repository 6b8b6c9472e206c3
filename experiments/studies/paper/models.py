"""The paper's model, and wrong models: each changes every scene and motion before they are simulated."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import impact_gym as ig
from experiments.lab.scenes import DURATION, MOTION, ROBOT, TOOL_MASS
from impact_gym.couplings import Coupling

Change = Callable[[ig.Scene, ig.Trapezoid], tuple[ig.Scene, ig.Trapezoid]]


@dataclass(frozen=True)
class Model:
    """A model that simulates the scenes of this study after a `change` of scene and motion."""

    change: Change = lambda scene, motion: (scene, motion)

    def simulate(
        self, scene: ig.Scene, motion: ig.Trapezoid = MOTION, duration: float = DURATION, trace: bool = False
    ) -> ig.Outcome:
        """Simulate one approach for `duration` (s)."""
        return ig.simulate(*self.change(scene, motion), duration, trace=trace)

    def trace(
        self, scene: ig.Scene, motion: ig.Trapezoid = MOTION, duration: float = DURATION
    ) -> tuple[ig.Outcome, ig.Trace]:
        """Simulate one approach for `duration` (s); return outcome and time histories."""
        outcome = self.simulate(scene, motion, duration, trace=True)
        assert outcome.trace is not None
        return outcome, outcome.trace

    def sweep(self, scene: ig.Scene, motion: ig.Trapezoid, varied: Mapping[str, Any], duration: float) -> ig.Outcomes:
        """Simulate approaches for `duration` (s) that differ in the numbers of `varied`."""
        return ig.sweep(*self.change(scene, motion), varied, duration)


PAPER = Model()


def _replaced(name: str, kind: type[Any] = object, **fields: Any) -> Model:
    def change(scene: ig.Scene, motion: ig.Trapezoid) -> tuple[ig.Scene, ig.Trapezoid]:
        part: Any = getattr(scene, name)
        changed: dict[str, Any] = {name: replace(part, **fields)} if isinstance(part, kind) else {}
        return replace(scene, **changed), motion

    return Model(change)


def _coupled(kind: type, coupling: Coupling) -> Model:
    return Model(lambda scene, motion: (
        replace(scene, coupling=coupling) if isinstance(scene.coupling, kind) else scene, motion
    ))  # fmt: skip


WRONG = {
    "damping of Hunt and Crossley": _replaced("contact", dissipation="hunt-crossley"),
    "linear damper (n = 0)": _replaced("contact", dissipation="exact", damping_exponent=0.0),
    "linear spring (m = 1)": _replaced("contact", stiffness_exponent=1.0),
    "elastic contact (e = 1)": _replaced("contact", restitution=1.0),
    "e has no effect (0.1)": _replaced("contact", restitution=0.1),
    "k_c has no effect (1e4)": _replaced("contact", stiffness=1e4),
    "soft contact (10)": _replaced("contact", stiffness=10.0),
    "tool 4 times as heavy": _replaced("tool", mass=4.0 * TOOL_MASS),
    "no brake": Model(lambda scene, motion: (scene, replace(motion, brake=None))),
    "half the speed": Model(lambda scene, motion: (scene, replace(motion, speed=0.5 * motion.speed))),
    "rigid robot": Model(lambda scene, motion: (replace(scene, robot=None), motion)),
    "robot 10 times as soft": _replaced("robot", ig.Robot, stiffness=0.1 * ROBOT.stiffness),
    "fixed tool": _coupled(object, ig.Rigid()),
    "spring nearly undamped": _replaced("coupling", ig.SpringDamper, damping_ratio=0.02),
    "mechanism for a spring": _coupled(ig.SpringDamper, ig.Bistable()),
    "spring for a mechanism": _coupled(ig.Bistable, ig.SpringDamper(50.0)),
}  # by name; stiffnesses of the contact in N/m^1.5
