"""The limits of a design.

The deflection of the tool from the flange counts until the first touch, so only the arm's own motion causes it. The
stroke is the deflection of the whole episode, with contact and retreat.
"""

import math
from dataclasses import dataclass

import numpy as np

from agents.baselines.rule import Floats
from agents.evaluate import Episodes, Travel
from experiments.design.pads import Pad
from impact_gym.validation import number

WITHIN = 0.95
"""Share of the episodes that keep the limits of peak force and energy. Deflection and stroke are kept in all."""
UNITS = {"deflection": "m", "stroke": "m", "peak_force": "N", "release": "J", "energy": "J", "touched_once": "-"}


@dataclass(frozen=True)
class Limits:
    """Limits that a design must keep; None: no limit."""

    deflection: float | None = 0.05
    """m, largest deflection of the tool from the flange before the first touch."""
    stroke: float | None = None
    """m, largest deflection in the whole episode."""
    peak_force: float | None = None
    """N, of the contact."""
    release: float | None = None
    """J, energy that a mechanism releases when it snaps through."""
    energy: float | None = None
    """J, kinetic energy of the object in the end."""
    touched_once: float | None = None
    """Least share of the scenarios without a second touch, such as 0.95."""

    def __post_init__(self) -> None:
        for name, unit in UNITS.items():
            if getattr(self, name) is not None:
                number(name, getattr(self, name), unit, above=0, at_most=1.0 if name == "touched_once" else math.inf)

    def excess(self, played: Episodes, travel: Travel, release: Floats, pad: Pad | None = None) -> Floats:
        """Return the excess of each candidate over the limits, as shares of the limits, summed; 0 within them.

        Args:
            played: episodes of all candidates, equally many of each, one candidate after the other.
            travel: of their tools.
            release: energy released by each candidate (n,), J.
            pad: Hertz's law holds for small penetrations, so the pad's may be at most half its radius, in the share
                WITHIN of the episodes.
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
