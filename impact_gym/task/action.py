"""The numbers of an action: conversion from [-1, 1] to SI units and back."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.kernels import ACTION, FASTEST_WITHDRAWAL
from impact_gym.support.validation import Range

RESOLUTION = 1e-6  # m/s or m/s^2; values are rounded to multiples of this, so a float32 action can give exactly 8 m/s^2


class Action(NamedTuple):
    """One number of the action."""

    id: str
    unit: str
    low: float  # value at the action -1
    high: float  # value at the action 1
    words: str
    resolution: float = RESOLUTION  # 0: values are not rounded


class ActionSpec:
    """The numbers of an action, and their conversion."""

    def __init__(self, velocities: Range, accelerations: Range, *, operated: bool) -> None:
        """Describe the action for ranges of velocity (m/s) and acceleration (m/s^2); `operated`: by an operator."""
        velocity = Action("velocity", "m/s", *velocities, "velocity to go to")
        acceleration = Action("acceleration", "m/s^2", *accelerations, "acceleration to use for it")
        gain = Action("gain", "-", 0.0, 1.0, "share of the operator's command", 0.0)
        withdrawal = Action("withdrawal", "m/s", 0.0, FASTEST_WITHDRAWAL, "withdrawal after an alarm", 0.0)
        self.entries = (gain, acceleration, withdrawal) if operated else (velocity, acceleration)
        self._low, self._high = np.array([(entry.low, entry.high) for entry in self.entries]).T

    def __len__(self) -> int:
        return len(self.entries)

    def decode(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Clip actions (..., n) to [-1, 1] and return their values (..., n), each in its unit."""
        share = 0.5 * (np.clip(np.asarray(actions, np.float64), -1.0, 1.0) + 1.0)
        values = self._low + share * (self._high - self._low)
        steps = np.array([entry.resolution for entry in self.entries])
        return np.where(steps > 0.0, np.rint(values / np.where(steps > 0.0, steps, 1.0)) * steps, values)

    def encode(self, *values: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., n), not clipped, from an array (...) of values for each number, in the number's unit."""
        stacked = np.stack(np.broadcast_arrays(*values), axis=-1)
        return (2.0 * (stacked - self._low) / (self._high - self._low) - 1.0).astype(np.float32)

    def pack(self) -> NDArray[Any]:
        """Return the entries as an array (3,) of ACTION, for the compiled program; unused rows are zeros."""
        rows = np.zeros(3, ACTION)
        rows[: len(self)] = [(entry.low, entry.high, entry.resolution) for entry in self.entries]
        return rows
