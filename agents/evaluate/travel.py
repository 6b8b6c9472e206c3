"""How far tools move against their flanges while a controller flies them."""

import numpy as np
from numpy.typing import NDArray

from impact_gym.envs.batch import Bodies

Floats = NDArray[np.float64]
WITHIN_STEP = (0.25, 0.5, 0.75, 1.0)
"""Shares of a control step at which the tool is looked for, on the cubic through both ends of it."""


class Travel:
    """How far the tool of each row went from its place on the flange, m, watched from control step to control step."""

    def __init__(self, rows: int) -> None:
        self.deflection, self.stroke = np.zeros(rows), np.zeros(rows)
        self._rest: Floats = np.zeros(rows)
        self._before: Bodies | None = None

    def __call__(self, now: Bodies) -> None:
        """Take in the present motion of the tools; see `ScenarioBatch.play`."""
        before, self._before = self._before, now
        if before is None:
            self._rest = now.deflection
            return
        step = now.time - before.time
        for u in WITHIN_STEP:
            deflection = (
                (1.0 + 2.0 * u) * (1.0 - u) ** 2 * before.deflection
                + u * (1.0 - u) ** 2 * step * before.deflection_rate
                + u**2 * (3.0 - 2.0 * u) * now.deflection
                - u**2 * (1.0 - u) * step * now.deflection_rate
            )
            away = np.abs(deflection - self._rest)
            self.stroke = np.maximum(self.stroke, away)
            self.deflection = np.where(now.touched, self.deflection, np.maximum(self.deflection, away))
