"""Choose a model: `advise` compares simplified models of scenes with the full model."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from time import perf_counter
from typing import Any, Literal, get_args

import numpy as np

from impact_gym.motion import Trapezoid
from impact_gym.outcome import Array
from impact_gym.robot import Arm, LineTable
from impact_gym.robot.line_table import Mass
from impact_gym.scene import RobotTable, Scene
from impact_gym.simulation import simulate
from impact_gym.support.validation import WrongTypeError, choice, number, shown

Advised = Literal["object_velocity", "peak_force", "impulse"]


@dataclass(frozen=True)
class Model:
    """A model that `advise` tried."""

    name: str
    simplify: Callable[[Scene], Scene]
    errors: Array  # (scenes,), -, error / full model's value; inf: a run failed, or only the full model's value is 0
    time_saved: float  # -, computing time saved, divided by the full model's computing time

    @property
    def bound(self) -> float:
        """Largest error in any scene."""
        return float(self.errors.max())


@dataclass(frozen=True)
class Advice:
    """What `advise` recommends: the fastest model in `tried` whose error is within the tolerance in every scene."""

    quantity: Advised
    tolerance: float  # -, relative error allowed
    model: Model
    tried: tuple[Model, ...]  # the full model first

    def __str__(self) -> str:
        head = f"{self.quantity} within {self.tolerance:g} in {len(self.model.errors)} scenes: {self.model.name}"
        lines = (f"  {m.name}: error at most {m.bound:.2g}, {m.time_saved:.0%} less time" for m in self.tried)
        return "\n".join([head, *lines])


ROUNDS = 3  # `advise` runs each model this many times (the one with all joints once); the shortest time counts


def advise(
    scenes: Scene | Sequence[Scene], motion: Trapezoid, tolerance: float = 1e-3, quantity: Advised = "object_velocity",
    duration: float = 1.5, arm: tuple[Arm, LineTable] | None = None,
) -> Advice:  # fmt: skip
    """Compare simplified models of `scenes` with the full model; recommend the fastest model within the tolerance.

    Args:
        scenes: a scene, or a sample of the scenes that are to be simulated; the advice holds for this sample.
        motion: imposed motion of the robot.
        tolerance: relative error allowed in `quantity`, in every scene.
        quantity: the result that is compared: final velocity of the object, largest contact force, or impulse of all
            contacts.
        duration: length of a run, s.
        arm: an arm and its line of approach, `(arm, arm.along(...))`, for scenes without a robot. Then the full model
            simulates all joints, see `impact_gym.robot.all_joints`. Simpler models have a rigid robot or a table
            from `LineTable.robot_table`. The table is used as it is, or only its values at the object's distance.

    Raises:
        RuntimeError: a run of the full model cannot finish.
    """
    sample = [scenes] if isinstance(scenes, Scene) else list(scenes)
    if not sample:
        raise ValueError("scenes must be a Scene or a sequence of them, got none")
    choice("quantity", quantity, get_args(Advised))
    tolerance = number("tolerance", tolerance, "(no unit)", above=0)
    if arm is not None and [type(each) for each in (arm if isinstance(arm, tuple) else ())] != [Arm, LineTable]:
        raise WrongTypeError(f"arm must be a pair, an Arm and its LineTable, got {shown(arm)}")
    run = partial(_timed, motion, duration, quantity)
    exact, seconds = run(sample, arm)
    tried = [Model("as it is" if arm is None else "all joints", lambda scene: scene, np.zeros(len(sample)), 0.0)]
    seen = [sample] if arm is None else []
    for name, simplify in _simpler_models(arm[1] if arm else None):
        simpler = [simplify(scene) for scene in sample]
        if simpler in seen:
            continue
        seen.append(simpler)
        try:
            values, taken = run(simpler)
        except (RuntimeError, ValueError):  # the simpler model is invalid or fails
            values, taken = np.full(len(sample), math.inf), seconds
        gap = np.abs(values - exact)
        errors = np.divide(gap, np.abs(exact), out=np.where(gap > 0, math.inf, 0.0), where=exact != 0)
        tried.append(Model(name, simplify, errors, 1.0 - taken / seconds))
    kept = [model for model in tried if model.bound <= tolerance]
    return Advice(quantity, tolerance, max(kept, key=lambda model: model.time_saved), tuple(tried))


FROZEN = "frozen where the object stands"


def _simpler_models(line: LineTable | None) -> Iterator[tuple[str, Callable[[Scene], Scene]]]:
    """Yield name and simplifying function of each simpler model; `line`: an arm's approach, not `Scene.robot`."""
    robots: dict[str, Any] = {"robot rigid": None}
    if line is None:
        robots = {"": "its own", f"robot {FROZEN}": "its own", **robots}
    else:
        for mass in get_args(Mass):
            robots[f"robot one mass, {mass}"] = robots[f"robot one mass, {mass}, {FROZEN}"] = line.robot_table(mass)
    for (name, robot), tool in product(robots.items(), ("", "tool fixed to the flange")):
        if name or tool:
            yield ", ".join(filter(None, (name, tool))), partial(_simplified, robot, name.endswith(FROZEN), tool != "")


def _simplified(robot: Any, frozen: bool, fixed: bool, scene: Scene) -> Scene:
    own = scene.robot if robot == "its own" else robot
    robot = own.at(scene.object.distance) if frozen and isinstance(own, RobotTable) else own
    return replace(scene, robot=robot, coupling=scene.coupling.simplified() if fixed else scene.coupling)


def _timed(
    motion: Trapezoid, duration: float, quantity: Advised, scenes: Sequence[Scene],
    arm: tuple[Arm, LineTable] | None = None,
) -> tuple[Array, float]:  # fmt: skip
    """Return the quantity for each scene, and the time (s) for all scenes, the shortest of ROUNDS (with `arm` one)."""
    from impact_gym.robot.all_joints import simulate as simulate_arm  # imported here, because this takes 40 ms

    times: list[float] = []
    for _ in range(1 if arm else ROUNDS):
        begun = perf_counter()
        outcomes: list[Any] = [
            simulate_arm(*arm, scene, motion, duration=duration) if arm else simulate(scene, motion, duration)
            for scene in scenes
        ]
        times.append(perf_counter() - begun)
    for outcome in outcomes:
        if outcome.status != "ok":
            raise RuntimeError(f"the whole arm: {outcome.status}")
    if quantity == "impulse" and not arm:
        values = [math.fsum(contact.impulse for contact in outcome.contacts) for outcome in outcomes]
    else:
        values = [float(getattr(outcome, quantity)) for outcome in outcomes]
    return np.array(values), min(times)
