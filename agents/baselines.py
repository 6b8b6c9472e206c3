"""Controllers without learning, called as a policy of stable-baselines3 is: `action, state = predict(observation)`."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.envs.task import ACCELERATION_RANGE, VELOCITY_RANGE
from impact_gym.validation import number

ALARM = 3  # place of the alarm in the observation


def encode(velocity: float, acceleration: float) -> NDArray[np.float32]:
    """Return the action that commands `velocity` (m/s) at `acceleration` (m/s^2)."""
    low = np.array([VELOCITY_RANGE[0], ACCELERATION_RANGE[0]])
    high = np.array([VELOCITY_RANGE[1], ACCELERATION_RANGE[1]])
    return (2.0 * (np.array([velocity, acceleration]) - low) / (high - low) - 1.0).astype(np.float32)


class ConstantSpeed:
    """Go at one speed until the alarm, then brake to rest."""

    def __init__(self, speed: float, acceleration: float = 8.0, deceleration: float | None = None) -> None:
        """Make a controller.

        Args:
            speed: m/s, above 0, at most 1.5.
            acceleration: m/s^2, 1 ... 20.
            deceleration: m/s^2, 1 ... 20; None: as the acceleration.
        """
        low, high = ACCELERATION_RANGE
        self.speed = number("speed", speed, "m/s", above=0, at_most=VELOCITY_RANGE[1])
        self.acceleration = number("acceleration", acceleration, "m/s^2", at_least=low, at_most=high)
        braking = self.acceleration if deceleration is None else deceleration
        self.deceleration = number("deceleration", braking, "m/s^2", at_least=low, at_most=high)
        self._go = encode(self.speed, self.acceleration)
        self._stop = encode(0.0, self.deceleration)

    def predict(
        self,
        observation: NDArray[np.float32],
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for an observation (n_obs,) or the actions for a batch of them (n, n_obs)."""
        alarm = np.asarray(observation)[..., ALARM, None] > 0.5
        return np.where(alarm, self._stop, self._go), state


class PaperTrapezoid(ConstantSpeed):
    """The paper's rule: 1 m/s at 8 m/s^2, braked at 8 m/s^2 from the alarm, 16 ms after 1 N (section 3.2)."""

    def __init__(self) -> None:
        super().__init__(speed=1.0, acceleration=8.0)
