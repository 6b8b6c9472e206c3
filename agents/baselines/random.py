"""Commands at random, for scale."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


class RandomActions:
    """Draw every action evenly from the action space."""

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)

    def predict(
        self,
        observation: NDArray[np.float32],
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return an action (2,), or the actions (n, 2) of a batch."""
        shape = (*np.shape(observation)[:-1], 2)
        return self._rng.uniform(-1.0, 1.0, shape).astype(np.float32), state
