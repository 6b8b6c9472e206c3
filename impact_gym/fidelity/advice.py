"""advise(scene, motion, tolerance) -> Advice: the cheapest chain that keeps V_p, and why each part went or stayed."""

import math
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from impact_gym.fidelity.aftermath import WATCHED
from impact_gym.fidelity.groups import CAUSES
from impact_gym.fidelity.prediction import (
    Inspection,
    Prediction,
    chain,
    closed_velocity,
    constants,
    inspect,
    predictions,
    softened,
)
from impact_gym.fidelity.situation import final
from impact_gym.motion import Trapezoid
from impact_gym.scene import Bistable, Rigid, RobotTable, Scene
from impact_gym.simulation import simulate
from impact_gym.validation import number

SOFTER = (100.0, 30.0, 10.0, 3.0)
"""Factors by which stops may be softened."""
TITLES = {
    "robot": "robot dropped",
    "frozen": "robot frozen at the impact",
    "free": "contact instantaneous, coupling ignored",
    "closed": "contact instantaneous, with the coupling's impulse",
    "stops": "stops softened",
}


@dataclass(frozen=True, slots=True)
class Reduction:
    """A part that could be left out."""

    name: str
    error: float  # -, predicted relative error of V_p; inf where nothing is known
    applied: bool
    reason: str  # a sentence


@dataclass(frozen=True, slots=True)
class Advice:
    """The cheapest model of an approach that is predicted to keep V_p within a tolerance."""

    scene: Scene  # as asked
    motion: Trapezoid
    tolerance: float  # -, relative error of V_p
    reduced: Scene  # what is left of it
    closed_form: float | None  # m/s, V_p if the contact is instantaneous: there is nothing to integrate then
    error: float  # -, predicted: sum over the reductions that are applied
    duration: float  # s, of a run, after which V_p is final
    reductions: tuple[Reduction, ...]

    def object_velocity(self, duration: float | None = None, rtol: float = 1e-8) -> float:
        """Final velocity of the object, m/s: in closed form, or by `simulate` of the reduced scene for `duration` (s).

        `duration` is that of the advice unless given.

        Raises:
            TypeError, ValueError: an argument is none of these or out of range; names it.
            RuntimeError: the run cannot finish; says why.
        """
        if duration is None:
            duration = self.duration
        if self.closed_form is None:
            return simulate(self.reduced, self.motion, duration, rtol).object_velocity
        number("duration", duration, "s", above=0)
        number("rtol", rtol, "(no unit)", at_least=1e-13, at_most=1e-2)
        return self.closed_form

    def __str__(self) -> str:
        lines = [f"V_p within {self.tolerance:g}, predicted {self.error:.2g}:"]
        return "\n".join([*lines, *(f"  {entry.reason}" for entry in self.reductions)])


@dataclass(frozen=True, slots=True)
class Choice:
    """One model of the approach among those possible."""

    used: dict[str, Prediction]  # by reduction
    reduced: Scene
    closed_form: float | None  # m/s
    cost: float  # -, of a run, relative

    @property
    def error(self) -> float:
        """Predicted, summed."""
        return sum((part.error for part in self.used.values()), 0.0)


def advise(scene: Scene, motion: Trapezoid, tolerance: float = 1e-3) -> Advice:
    """Return which parts of `scene` matter for V_p, and the cheapest scene without those that do not.

    The error of each reduction is a sum of dimensionless groups times constants (calibrated, see
    experiments/fidelity); of several together, the sum of theirs. No part of this runs `scene`.

    Args:
        scene: tool, object, contact, coupling and robot.
        motion: imposed motion of the robot.
        tolerance: relative error allowed in V_p, the object's velocity after its last contact.

    Raises:
        TypeError, ValueError: an argument is none of these or out of range; names it.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, got {scene!r}")
    if not isinstance(motion, Trapezoid):
        raise TypeError(f"motion must be a Trapezoid, got {motion!r}")
    tolerance = number("tolerance", tolerance, "(no unit)", above=0)
    try:
        with np.errstate(all="ignore"):
            seen = inspect(scene, motion)
            known = predictions(seen)
            choices = _choices(seen, known)
    except (ArithmeticError, ValueError):  # scales that floating point cannot hold side by side
        whole = Choice({}, scene, None, 0.0)
        slow = scene.object.distance / motion.speed + motion.speed / motion.acceleration
        return _advice(scene, motion, tolerance, whole, {}, slow + WATCHED)
    allowed = [choice for choice in choices if choice.error <= tolerance]
    best = min(allowed, key=lambda choice: (choice.cost, choice.error))
    if isinstance(scene.coupling, Bistable) and "stops" not in best.used:
        stiffness = scene.coupling.stop_stiffness / SOFTER[-1]
        known["stops"] = softened(seen, stiffness)
    if "lumped" in known and best.reduced.robot is not None:  # what "closed" means as long as the robot stays
        known["closed"] = known["lumped"]
    return _advice(scene, motion, tolerance, best, known | best.used, final(seen.now))


def cost(scene: Scene) -> float:
    """Time of a run of `scene` over that of a rigid tool on a rigid robot; measured, see experiments/fidelity."""
    return float(constants()["cost"][chain(scene)])


def _choices(seen: Inspection, known: dict[str, Prediction]) -> list[Choice]:
    """Return every combination of reductions that there is."""
    scene, found = seen.scene, []
    for name, contact in product(("", "frozen", "robot"), ("", "free", "closed")):
        if name and name not in known:
            continue
        used = {name: known[name]} if name else {}
        left = scene.robot if not name else seen.robot if name == "frozen" else None
        reduced = replace(scene, robot=left)
        if not contact:
            found.append(Choice(used, reduced, None, cost(reduced)))
            if isinstance(scene.coupling, Bistable):
                found += _softer(seen, found[-1], scene.coupling)
        elif left is None and contact in known:
            velocity = closed_velocity(seen.now, contact == "closed")
            found.append(Choice(used | {contact: known[contact]}, reduced, velocity, 0.0))
        elif contact == "closed" and seen.one is not None and not isinstance(left, RobotTable):
            found.append(Choice(used | {contact: known["lumped"]}, reduced, closed_velocity(seen.one), 0.0))
    return found


def _softer(seen: Inspection, whole: Choice, coupling: Bistable) -> list[Choice]:
    """Return `whole` with softer stops; the softer, the cheaper (measured, see experiments/fidelity)."""
    found, saved = [], float(constants()["saved by stops ten times softer"])
    for factor in SOFTER:
        stiffness = coupling.stop_stiffness / factor
        used = whole.used | {"stops": softened(seen, stiffness)}
        reduced = replace(whole.reduced, coupling=replace(coupling, stop_stiffness=stiffness))
        found.append(Choice(used, reduced, None, whole.cost * (1.0 - saved) ** math.log10(factor)))
    return found


def _advice(
    scene: Scene,
    motion: Trapezoid,
    tolerance: float,
    best: Choice,
    known: dict[str, Prediction],
    duration: float,
) -> Advice:
    entries = []
    for name, title in TITLES.items():
        if name not in known:
            continue
        if name == "closed" and isinstance(best.reduced.coupling, Rigid) and best.reduced.robot is None:
            title = "contact instantaneous"
        prediction = known[name]
        applied = name in best.used
        worth = f"{100.0 * prediction.error:.2g} % of V_p" if math.isfinite(prediction.error) else "an unknown error"
        cause = CAUSES[prediction.largest]
        verdict = "yes" if applied else "no"
        reason = f"{title}: {verdict}, predicted {worth}, mostly by the {cause}."
        if not applied and prediction.error <= tolerance:
            reason = f"{title}: not needed, predicted {worth}; another choice is cheaper or the sum would be too large."
        entries.append(Reduction(title, prediction.error, applied, reason))
    if not known:
        reason = "Nothing is left out: the scales of this scene lie too far apart for a prediction."
        entries.append(Reduction("none", math.inf, False, reason))
    return Advice(scene, motion, tolerance, best.reduced, best.closed_form, best.error, duration, tuple(entries))
