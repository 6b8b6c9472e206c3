"""The limits that a design must keep.

`deflection` is the largest deflection of the tool from the flange before the first touch, so only the arm's own motion
causes it. `stroke` is the largest deflection in the whole episode, contact and retreat included.
"""

import math
from dataclasses import dataclass

import numpy as np

from agents.baselines.rule import Floats
from agents.evaluate.scenario_batch import Episodes, Travel
from experiments.design.pads import Pad
from impact_gym.validation import number

WITHIN = 0.95
"""Share of the episodes that must keep the limits of peak force and energy; all must keep deflection and stroke."""
UNITS = {"deflection": "m", "stroke": "m", "peak_force": "N", "release": "J", "energy": "J", "touched_once": "-"}


@dataclass(frozen=True)
class Limits:
    """Limits that a design must keep; None: no limit."""

    deflection: float | None = 0.05
    """Largest deflection of the tool from the flange before the first touch, m."""
    stroke: float | None = None
    """Largest deflection of the tool from the flange in the whole episode, m."""
    peak_force: float | None = None
    """Largest contact force, N."""
    release: float | None = None
    """Largest energy that a bistable coupling may release when it snaps through, J."""
    energy: float | None = None
    """Largest kinetic energy of the object at the end of the episode, J."""
    touched_once: float | None = None
    """Smallest share of scenarios in which the tool touches the object only once, such as 0.95."""

    def __post_init__(self) -> None:
        for name, unit in UNITS.items():
            if getattr(self, name) is not None:
                number(name, getattr(self, name), unit, above=0, at_most=1.0 if name == "touched_once" else math.inf)

    def excess(self, played: Episodes, travel: Travel, release: Floats, pad: Pad | None = None) -> Floats:
        """Return for each candidate the sum of (value / limit - 1) over the limits that it exceeds; 0 if it keeps all.

        Args:
            played: episodes, the same number for each candidate, sorted by candidate.
            travel: deflection and stroke of the tool in these episodes.
            release: energy that the coupling of each candidate releases (n,), J.
            pad: pad on the tool. Hertz's law holds for small penetrations, so in the share WITHIN of the episodes the
                penetration of the pad may be at most half its radius.
        """
        count = len(release)
        loads = played.peak_force, kinetic(played)
        peak, energy = (np.quantile(values.reshape(count, -1), WITHIN, axis=1) for values in loads)
        repeated = None if self.touched_once is None else max(1.0 - self.touched_once, 1e-3)
        limited = [
            (self.deflection, travel.deflection.reshape(count, -1).max(axis=1)),
            (self.stroke, travel.stroke.reshape(count, -1).max(axis=1)),
            (self.peak_force, peak),
            (0.5 * pad.radius, (peak / pad.stiffness) ** (2.0 / 3.0)) if pad else (None, peak),
            (self.release, release),
            (self.energy, energy),
            (repeated, (played.contact_count > 1).reshape(count, -1).mean(axis=1)),
        ]
        return sum((np.maximum(value / limit - 1.0, 0.0) for limit, value in limited if limit), np.zeros(count))


def kinetic(played: Episodes) -> Floats:
    """Return the object's final kinetic energy in each episode, J."""
    return 0.5 * played.scenario["object_mass"] * played.object_velocity**2
