"""Rules for a range sensor: a filter estimates the object's place from readings, and a profile uses the estimate.

The tool's position at the time of a reading, plus the reading without bias, is a measurement of the object's place. The
estimate starts at the middle of the range of distances, with the variance of a uniform distribution over this range.
The filter knows the task's range sensor, tool mass and coupling. If episodes draw one of their numbers, the filter uses
its median.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import expm

from agents.baselines.profile import LEAST_SPREAD, StretchedProfile
from agents.baselines.rule import CLOCK, Floats, View

KEPT = 32  # number of the latest control steps that the filter remembers; a reading from an earlier step is not used


class FilteredProfile(StretchedProfile, tunable=True):
    """`StretchedProfile` with the distance that a filter estimates from the range readings."""

    NEEDS: ClassVar[Mapping[str, Any]] = {"range_sensor": {"noise": 0.01}}
    KNOWS = ("range_sensor", "tool_mass", "coupling")
    READINGS = np.inf  # largest number of readings that the filter uses in an episode
    SPREAD = "spread"

    def see(self, view: View, state: Any, episode_start: Any) -> tuple[View, Any]:
        """Return the view, with `distance_estimate` (m) and its standard deviation `spread` (m), and the next state.

        The state begins with the estimate's weight (1/m^2) and place (m), the number of used readings, the time (s) of
        the last one, and the result of `swing`. Time, flange velocity and tool position (SI) of KEPT steps follow.
        """
        time, position, velocity = view["time"], view["position"], view["velocity"]
        near, far = self.task.scenario.distance
        fresh = np.zeros((6 + 3 * KEPT, *np.shape(time)))
        fresh[0], fresh[1], fresh[3] = 12.0 / max(far - near, 1e-3) ** 2, 0.5 * (near + far), -1.0
        fresh[6 : 6 + KEPT] = -np.inf
        start = np.asarray(state is None or (episode_start is not None and episode_start))
        state = np.where(start, fresh, fresh if state is None else state)
        weight, place, count, newest, deflection, rate = state[:6]
        times, velocities, tools = state[6:].reshape(3, KEPT, *np.shape(time))
        deflection, rate = self.swing(deflection, rate, velocity - np.where(start, 0.0, velocities[0]))
        times, velocities, tools = (
            np.concatenate([now[None], kept[:-1]])
            for now, kept in ((time, times), (velocity, velocities), (position + deflection, tools))
        )
        read_at = time - view["range_age"]
        step = np.argmin(np.abs(times - read_at), axis=0)
        reading, sensor = view["range"], self.task.range_sensor
        counts = (read_at > newest + CLOCK) & (np.abs(np.take_along_axis(times, step[None], 0)[0] - read_at) < 1e-3)
        counts &= (count < self.READINGS) & (reading < self.spec.scale("range").high) & ~view.alarm
        added = np.where(counts, 1.0 / np.maximum(sensor.noise + sensor.share * reading, LEAST_SPREAD) ** 2, 0.0)
        measured = np.take_along_axis(tools, step[None], 0)[0] + reading - sensor.bias
        place = np.where(counts, (weight * place + added * measured) / (weight + added), place)
        weight, count, newest = weight + added, count + counts, np.where(counts, read_at, newest)
        state = np.concatenate([np.stack([weight, place, count, newest, deflection, rate]), times, velocities, tools])
        own = {"distance_estimate": place - position, "spread": 1.0 / np.sqrt(weight)}
        return View(view.observation, view.spec, **own), state

    def swing(self, deflection: Floats, rate: Floats, gained: Floats) -> tuple[Floats, Floats]:
        """Return the next deflection (m) and rate (m/s); `gained`: rise of the flange velocity, m/s (paper, eq. 17)."""
        period, oscillator = self.task.control_period, self.task.coupling.oscillator(self.task.tool_mass)
        if oscillator is None:
            return deflection, rate
        square, damping = oscillator
        (a, b, c), (d, e, f) = expm(period * np.array([[0, 1, 0], [-square, -damping, -1 / period], [0, 0, 0]]))[:2]
        return a * deflection + b * rate + c * gained, d * deflection + e * rate + f * gained


class FirstReadingProfile(FilteredProfile, tunable=True):
    """`FilteredProfile` whose filter uses only the first valid reading of an episode."""

    READINGS = 1
