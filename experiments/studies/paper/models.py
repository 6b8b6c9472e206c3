"""The paper's model, and wrong models: each changes every scene and motion before they are simulated."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import impact_gym as ig
from experiments.lab.scenes import DURATION, MOTION

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


def _part(name: str, change: Callable[[Any], Any], kind: type = object) -> Model:
    def changed(scene: ig.Scene, motion: ig.Trapezoid) -> tuple[ig.Scene, ig.Trapezoid]:
        part = getattr(scene, name)
        return (replace(scene, **{name: change(part)}) if isinstance(part, kind) else scene), motion

    return Model(changed)


def _motion(change: Callable[[ig.Trapezoid], ig.Trapezoid]) -> Model:
    return Model(lambda scene, motion: (scene, change(motion)))


def _scaled(name: str, field: str, factor: float, kind: type = object) -> Model:
    return _part(name, lambda part: replace(part, **{field: factor * getattr(part, field)}), kind)


WRONG = {
    "damping of Hunt and Crossley": _part("contact", lambda law: replace(law, dissipation="hunt-crossley")),
    "linear damper (n = 0)": _part("contact", lambda law: replace(law, dissipation="exact", damping_exponent=0.0)),
    "linear spring (m = 1)": _part("contact", lambda law: replace(law, stiffness_exponent=1.0)),
    "elastic contact (e = 1)": _part("contact", lambda law: replace(law, restitution=1.0)),
    "e has no effect (0.5)": _part("contact", lambda law: replace(law, restitution=0.5)),
    "e has no effect (0.1)": _part("contact", lambda law: replace(law, restitution=0.1)),
    "k_c has no effect (1e4)": _part("contact", lambda law: replace(law, stiffness=1e4)),
    "contact 100 times as stiff": _scaled("contact", "stiffness", 100.0),
    "contact 100 times as soft": _scaled("contact", "stiffness", 0.01),
    "object 100 times as heavy": _scaled("object", "mass", 100.0),
    "tool 4 times as heavy": _scaled("tool", "mass", 4.0),
    "no brake": _motion(lambda motion: replace(motion, brake=None)),
    "half the speed": _motion(lambda motion: replace(motion, speed=0.5 * motion.speed)),
    "4 times as fast": _motion(
        lambda motion: replace(motion, speed=4.0 * motion.speed, acceleration=16.0 * motion.acceleration)
    ),
    "rigid robot": _part("robot", lambda _: None),
    "robot 10 times as soft": _scaled("robot", "stiffness", 0.1, ig.Robot),
    "gantry": _part("robot", lambda table: replace(table, **{
        name: (getattr(table, name)[-1],) * len(table.position) for name in ("mass", "stiffness", "damping")
    }), ig.RobotTable),
    "fixed tool": _part("coupling", lambda _: ig.Rigid()),
    "spring nearly undamped": _part("coupling", lambda spring: replace(spring, damping_ratio=0.02), ig.SpringDamper),
    "spring 1000 times as soft": _scaled("coupling", "stiffness", 0.001, ig.SpringDamper),
    "mechanism for a spring": _part("coupling", lambda _: ig.Bistable(), ig.SpringDamper),
    "spring for a mechanism": _part("coupling", lambda _: ig.SpringDamper(50.0), ig.Bistable),
}  # fmt: skip
"""Wrong models by name; a "gantry" keeps its pose along the line."""
