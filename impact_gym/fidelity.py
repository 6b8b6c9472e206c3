"""What a scene needs: `advise` runs simpler models beside the full one and names the cheapest that is as good."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from time import perf_counter
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from impact_gym.motion import Trapezoid
from impact_gym.robot import Approach, Arm
from impact_gym.robot.approach import Mass
from impact_gym.scene import Bistable, Rigid, RobotTable, Scene, SpringDamper
from impact_gym.simulation import Outcome, simulate
from impact_gym.validation import WrongTypeError, number, shown

if TYPE_CHECKING:
    from impact_gym.robot.all_joints import Blow

Quantity = Literal["object_velocity", "peak_force", "impulse"]
ROUNDS = 3  # runs of a model, of which the fastest counts
FULL, WHOLE_ARM = "as it is", "all joints"


def rigid_robot(scene: Scene) -> Scene:
    """Return the scene with a flange that yields to nothing."""
    return replace(scene, robot=None)


def _frozen_robot(scene: Scene) -> Scene:
    if not isinstance(scene.robot, RobotTable):
        return scene
    return replace(scene, robot=scene.robot.at(scene.object.distance))


def fixed_tool(scene: Scene) -> Scene:
    """Return the scene with the tool fixed to the flange, if a spring holds it."""
    return replace(scene, coupling=Rigid()) if isinstance(scene.coupling, SpringDamper) else scene


def _softer_stops(scene: Scene) -> Scene:
    mechanism = scene.coupling
    if not isinstance(mechanism, Bistable):
        return scene
    return replace(scene, coupling=replace(mechanism, stop_stiffness=0.1 * mechanism.stop_stiffness))


def _as_it_is(scene: Scene) -> Scene:
    return scene


def _both(of_robot: Callable[[Scene], Scene], of_tool: Callable[[Scene], Scene], scene: Scene) -> Scene:
    return of_tool(of_robot(scene))


ROBOTS = {FULL: _as_it_is, "robot frozen where the object stands": _frozen_robot, "robot rigid": rigid_robot}
TOOLS = {FULL: _as_it_is, "tool fixed to the flange": fixed_tool, "stops ten times softer": _softer_stops}


@dataclass(frozen=True)
class Model:
    """A simpler model, and how it did."""

    name: str
    simplify: Callable[[Scene], Scene]
    errors: NDArray[np.float64]  # (scenes,), -, relative, beside the full model; inf where it did not finish
    time_saved: float  # -, share of the full model's time

    @property
    def bound(self) -> float:
        """Largest error seen."""
        return float(self.errors.max())


@dataclass(frozen=True)
class Advice:
    """The cheapest model of scenes that kept a tolerance in all of them."""

    quantity: Quantity
    tolerance: float  # -, relative
    model: Model
    tried: tuple[Model, ...]  # the full one first

    def __str__(self) -> str:
        head = f"{self.quantity} within {self.tolerance:g} in {len(self.model.errors)} scenes: {self.model.name}"
        lines = (f"  {m.name}: error at most {m.bound:.2g}, {m.time_saved:.0%} less time" for m in self.tried)
        return "\n".join([head, *lines])


def advise(
    scenes: Scene | Sequence[Scene], motion: Trapezoid, tolerance: float = 1e-3, quantity: Quantity = "object_velocity",
    duration: float = 1.5, arm: tuple[Arm, Approach] | None = None,
) -> Advice:  # fmt: skip
    """Run every simpler model of `scenes` beside the full one; return the cheapest that keeps `tolerance` in all.

    Args:
        scenes: one, or a sample of those that will be run; what is advised holds for the sample.
        motion: imposed motion of the robot.
        tolerance: relative error allowed.
        quantity: the object's velocity at the end, the largest contact force, or the impulse of all contacts.
        duration: of a run, s.
        arm: an arm and the line it moves along, `(arm, arm.along(...))`, for scenes without a robot. The full model is
            then `impact_gym.robot.all_joints`, and the simpler ones put one mass in the arm's place: that of each
            kind, varying along the line or frozen where the object stands, or none that yields.

    Raises:
        TypeError, ValueError: an argument is none of these or out of range; names it.
        RuntimeError: a full run cannot finish; says why.
    """
    sample = [scenes] if isinstance(scenes, Scene) else list(scenes)
    if not sample:
        raise ValueError("scenes must be a Scene or some of them, got none")
    if quantity not in get_args(Quantity):
        raise ValueError(f"quantity must be one of {', '.join(get_args(Quantity))}, got {quantity!r}")
    tolerance = number("tolerance", tolerance, "(no unit)", above=0)
    if arm is not None and [type(each) for each in (arm if isinstance(arm, tuple) else ())] != [Arm, Approach]:
        raise WrongTypeError(f"arm must be a pair, an Arm and its Approach, got {shown(arm)}")
    true, seconds = _run(partial(_on_chain, motion, duration), sample, quantity) if arm is None else _run(
        partial(_on_arm, *arm, motion, duration), sample, quantity, rounds=1)  # fmt: skip
    full = Model(FULL if arm is None else WHOLE_ARM, _as_it_is, np.zeros(len(sample)), 0.0)
    tried, seen = [full], [sample] if arm is None else []
    for name, simplify in _models(ROBOTS if arm is None else _masses(arm[1])):
        simpler = [simplify(scene) for scene in sample]
        if simpler in seen:
            continue
        seen.append(simpler)
        try:
            values, taken = _run(partial(_on_chain, motion, duration), simpler, quantity)
        except (RuntimeError, ValueError):  # a model may be impossible where the scene is not
            tried.append(Model(name, simplify, np.full(len(sample), math.inf), 0.0))
            continue
        gap = np.abs(values - true)
        errors = np.divide(gap, np.abs(true), out=np.where(gap > 0, math.inf, 0.0), where=true != 0)
        tried.append(Model(name, simplify, errors, 1.0 - taken / seconds))
    kept = [model for model in tried if model.bound <= tolerance]
    return Advice(quantity, tolerance, max(kept, key=lambda model: model.time_saved), tuple(tried))


def _masses(approach: Approach) -> dict[str, Callable[[Scene], Scene]]:
    """Return the models with one mass for an arm, varying along the line and frozen where the object stands."""
    models: dict[str, Callable[[Scene], Scene]] = {"robot rigid": rigid_robot}
    for mass in get_args(Mass):
        models[f"robot one mass, {mass}"] = partial(replace, robot=approach.robot_table(mass))
        models[f"robot one mass, {mass}, frozen where the object stands"] = partial(_frozen_at, approach, mass)
    return models


def _frozen_at(approach: Approach, mass: Mass, scene: Scene) -> Scene:
    return replace(scene, robot=approach.at(scene.object.distance, mass))


def _models(robots: Mapping[str, Callable[[Scene], Scene]]) -> Iterator[tuple[str, Callable[[Scene], Scene]]]:
    for (robot, of_robot), (tool, of_tool) in product(robots.items(), TOOLS.items()):
        parts = [part for part in (robot, tool) if part != FULL]
        if parts:
            yield ", ".join(parts), partial(_both, of_robot, of_tool)


def _run(
    play: Callable[[Scene], "Outcome | Blow"], scenes: Sequence[Scene], quantity: Quantity, rounds: int = ROUNDS
) -> tuple[NDArray[np.float64], float]:
    """Return the quantity of each scene, and the time for all of them, s."""
    times = []
    for _ in range(rounds):
        begun = perf_counter()
        outcomes = [play(scene) for scene in scenes]
        times.append(perf_counter() - begun)
    return np.array([_read(outcome, quantity) for outcome in outcomes]), min(times)


def _on_chain(motion: Trapezoid, duration: float, scene: Scene) -> Outcome:
    return simulate(scene, motion, duration)


def _on_arm(arm: Arm, approach: Approach, motion: Trapezoid, duration: float, scene: Scene) -> "Blow":
    from impact_gym.robot import (
        all_joints,
    )  # its integrators take 40 ms to import, which every `import impact_gym` would pay

    blow = all_joints.simulate(arm, approach, scene, motion, duration=duration)
    if blow.status != "ok":
        raise RuntimeError(f"all joints of the arm: {blow.status}")
    return blow


def _read(outcome: "Outcome | Blow", quantity: Quantity) -> float:
    if quantity == "impulse" and isinstance(outcome, Outcome):
        return math.fsum(contact.impulse for contact in outcome.contacts)
    return float(getattr(outcome, quantity))
