"""The limits of a design, and how far the tool moves against the flange while a controller flies it.

The deflection counts until the first touch, over all distances at which objects stand: it is due to the arm's own
motion alone. The stroke counts the blow and the retreat as well.
"""

import math
from dataclasses import dataclass

import numpy as np

from agents.baselines.rule import Floats
from agents.evaluate import Episodes, Travel
from experiments.design.pads import Pad
from impact_gym.validation import number

WITHIN = 0.95
"""Share of the episodes that keep to the limits of peak force and energy; deflection and stroke hold in all."""
UNITS = {"deflection": "m", "stroke": "m", "peak_force": "N", "release": "J", "energy": "J", "touched_once": "-"}


@dataclass(frozen=True)
class Limits:
    """What a design must keep to; None: no limit."""

    deflection: float | None = 0.05
    """m, that the tool may move against the flange before the first touch."""
    stroke: float | None = None
    """m, likewise in the whole episode."""
    peak_force: float | None = None
    """N, of the contact."""
    release: float | None = None
    """J, that a mechanism may set free where it snaps through."""
    energy: float | None = None
    """J, that the object leaves with."""
    touched_once: float | None = None
    """Least share of the scenarios without a second blow, such as 0.95."""

    def __post_init__(self) -> None:
        for name, unit in UNITS.items():
            if getattr(self, name) is not None:
                number(name, getattr(self, name), unit, above=0, at_most=1.0 if name == "touched_once" else math.inf)

    def excess(self, played: Episodes, travel: Travel, release: Floats, pad: Pad | None = None) -> Floats:
        """Return how far each candidate is beyond the limits: shares of each limit, summed; 0 within them.

        Args:
            played: equally many episodes of each candidate, one candidate after the other.
            travel: of their tools.
            release: J, of each candidate (n,).
            pad: may be pressed in as far as its law holds, in the share WITHIN of the episodes.
        """
        count = len(release)
        loads = played.peak_force, kinetic(played)
        peak, energy = (np.quantile(values.reshape(count, -1), WITHIN, axis=1) for values in loads)
        repeated = None if self.touched_once is None else max(1.0 - self.touched_once, 1e-3)
        limited = [
            (self.deflection, travel.deflection.reshape(count, -1).max(axis=1)),
            (self.stroke, travel.stroke.reshape(count, -1).max(axis=1)),
            (self.peak_force, peak),
            (pad.deepest, pad.pressed(peak)) if pad else (None, peak),
            (self.release, release),
            (self.energy, energy),
            (repeated, (played.contact_count > 1).reshape(count, -1).mean(axis=1)),
        ]
        return sum((np.maximum(value / limit - 1.0, 0.0) for limit, value in limited if limit), np.zeros(count))


def kinetic(played: Episodes) -> Floats:
    """Return the energy that the object leaves with in each episode, J."""
    return 0.5 * played.scenario["object_mass"] * played.object_velocity**2
