"""What a design must keep to, and how far the tool moves against the flange while a controller flies it.

Deflection counts until the first touch, over all distances at which objects stand: what the arm's own motion makes of a
tool that is held softly or swings. The stroke counts the blow and the retreat as well.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.baselines.rule import Floats
from agents.design.pads import Pad
from agents.evaluate import Episodes

MOST = 0.95
"""Peak force and transferred energy are kept to in this share of the episodes, deflection and stroke in all."""
WITHIN_STEP = (0.25, 0.5, 0.75, 1.0)
"""Shares of a control step at which the tool is looked for, on the cubic through both ends of it."""


class Limits(NamedTuple):
    """What a design must keep to; None: nothing is asked."""

    deflection: float | None = 0.05  # m, until the first touch
    stroke: float | None = None  # m, in the whole episode
    peak_force: float | None = None  # N
    release: float | None = None  # J, that a mechanism sets free where it snaps through
    energy: float | None = None  # J, that the object leaves with
    touched_once: float | None = None  # share of the episodes without a second blow, at least

    def excess(self, played: Episodes, travel: "Travel", release: Floats, pad: Pad | None = None) -> Floats:
        """Return how far each candidate is beyond the limits, as a share of each, all added; 0 within them.

        Args:
            played: as many episodes of each, one candidate after the other.
            travel: of their tools.
            release: J, of each candidate (n,).
            pad: what may be pressed in as far as its law holds, in as many episodes as the peak force is kept to.
        """
        copies = len(release)
        mass = played.scenario["object_mass"]
        energy = 0.5 * mass * played.object_velocity**2
        twice = (played.contact_count > 1).reshape(copies, -1).mean(axis=1)
        peak = np.quantile(played.peak_force.reshape(copies, -1), MOST, axis=1)
        shares = [
            (self.deflection, travel.deflection.reshape(copies, -1).max(axis=1)),
            (self.stroke, travel.stroke.reshape(copies, -1).max(axis=1)),
            (self.peak_force, peak),
            (pad and pad.deepest, pad and pad.pressed(peak)),
            (self.release, release),
            (self.energy, np.quantile(energy.reshape(copies, -1), MOST, axis=1)),
            (None if self.touched_once is None else max(1.0 - self.touched_once, 1e-3), twice),
        ]
        return sum((np.maximum(found / limit - 1.0, 0.0) for limit, found in shares if limit), np.zeros(copies))


UNITS = dict(zip(Limits._fields, ("m", "m", "N", "J", "J", "(no unit)"), strict=True))


class Travel:
    """How far the tool of each row went from its place on the flange, m, watched from control step to control step."""

    def __init__(self, rows: int) -> None:
        self.deflection, self.stroke = np.zeros(rows), np.zeros(rows)
        self._rest: Floats = np.zeros(0)
        self._before: tuple[NDArray[Any], ...] = ()

    def __call__(self, chains: NDArray[Any]) -> None:
        """Take in where everything is now; see `Stage.play`."""
        offset = chains["deflection"] - chains["flange_offset"]
        rate = chains["deflection_rate"] - chains["flange_offset_rate"]
        time, free = chains["time"].copy(), chains["contacts"] == 0
        if not self._before:
            self._rest = offset
        else:
            offset_before, rate_before, time_before = self._before
            step = time - time_before
            for u in WITHIN_STEP:
                there = (
                    (1.0 + 2.0 * u) * (1.0 - u) ** 2 * offset_before + u * (1.0 - u) ** 2 * step * rate_before
                    + u**2 * (3.0 - 2.0 * u) * offset - u**2 * (1.0 - u) * step * rate
                )  # fmt: skip
                away = np.abs(there - self._rest)
                self.stroke = np.maximum(self.stroke, away)
                self.deflection = np.where(free, np.maximum(self.deflection, away), self.deflection)
        self._before = offset, rate, time
