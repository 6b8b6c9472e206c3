"""Rules for a range sensor: a filter makes an estimate of the object's place from all readings, a profile follows it.

Each reading, with the flange's position and the tool's deflection at the time it was taken, says where the object
stands. The filter weighs these by the inverse of their variance, beginning with the range of distances of the set-up.
It knows the set-up's sensor and coupling; where episodes draw their numbers, the middle of the range.
"""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import expm

from agents.baselines.profile import RangedProfile
from agents.baselines.rule import Floats, Parameter, View
from impact_gym.scene import SpringDamper
from impact_gym.task.task import VELOCITY_RANGE

USUAL_SPREAD, LEAST_SPREAD = 1e-2, 1e-3  # m, of an estimate
KEPT = 32  # control steps whose positions are remembered: readings may be so old
CLOCK = 1e-6  # s, resolution of the observed time


class EstimateView(View):
    """A view with the filter's estimate: the object's place minus the flange's position, and its standard deviation."""

    def __init__(self, view: View, estimate: Floats, spread: Floats) -> None:
        super().__init__(view.observation, view.spec)
        self._own = {"distance_estimate": estimate, "spread": spread}

    def __getitem__(self, name: str) -> Floats:
        """The number with this id, in its unit."""
        return self._own[name] if name in self._own else super().__getitem__(name)


class FilteredProfile(RangedProfile):
    """`RangedProfile` over the estimate of a filter; the less certain that is, the longer and slower the profile."""

    NEEDS: ClassVar[Mapping[str, Any]] = {"range_sensor": {"noise": 0.01}}
    PARAMETERS = (
        *RangedProfile.PARAMETERS,
        Parameter("stretch", "-", -0.5, 1.5, 0.3),
        Parameter("slowing", "-", -0.5, 1.5, 0.0),
    )
    READINGS = np.inf  # how many count

    def see(self, view: View, state: Any, episode_start: Any) -> tuple[View, Any]:
        """Return a view with the estimate, and what is remembered.

        That is the weight (1/m^2) and the place (m) of the estimate, how many readings are in it, when the newest was
        taken (s), the tool's deflection (m) and its rate (m/s) as the coupling's equation has them, and for the last
        KEPT control steps the time (s), the flange's velocity (m/s) and the tool's position (m).
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
        taken = time - view["range_age"]
        step = np.argmin(np.abs(times - taken), axis=0)
        read, sensor = view["range"], self.task.range_sensor
        counts = (taken > newest + CLOCK) & (np.abs(np.take_along_axis(times, step[None], 0)[0] - taken) < 1e-3)
        counts &= (count < self.READINGS) & (read < self.spec.scale("range").high) & ~view.alarm
        added = np.where(counts, 1.0 / np.maximum(sensor.noise + sensor.share * read, LEAST_SPREAD) ** 2, 0.0)
        says = np.take_along_axis(tools, step[None], 0)[0] + read - sensor.bias
        place = np.where(counts, (weight * place + added * says) / (weight + added), place)
        weight, count, newest = weight + added, count + counts, np.where(counts, taken, newest)
        state = np.concatenate([np.stack([weight, place, count, newest, deflection, rate]), times, velocities, tools])
        return EstimateView(view, place - position, 1.0 / np.sqrt(weight)), state

    def swing(self, deflection: Floats, rate: Floats, gained: Floats) -> tuple[Floats, Floats]:
        """Return deflection (m) and rate (m/s) a control step later, in which the flange gained so much velocity (m/s).

        The equation of the coupling, with an even acceleration of the flange (paper, eq. 17); 0 without a spring.
        """
        coupling, period = self.task.coupling, self.task.control_period
        if not isinstance(coupling, SpringDamper):
            return deflection, rate
        square = coupling.stiffness / self.task.tool_mass
        damping = 2.0 * coupling.damping_ratio * np.sqrt(square)
        (a, b, c), (d, e, f) = expm(period * np.array([[0, 1, 0], [-square, -damping, -1 / period], [0, 0, 0]]))[:2]
        return a * deflection + b * rate + c * gained, d * deflection + e * rate + f * gained

    def profile(self, view: View) -> Callable[[Floats], Floats]:
        """Return `RangedProfile`'s, with its places stretched and its speeds divided by powers of the uncertainty."""
        spread = np.maximum(view["spread"], LEAST_SPREAD) / USUAL_SPREAD
        stretch, slowing = spread ** self["stretch"], spread ** self["slowing"]
        return lambda place: np.clip(self.speed(place / stretch) / slowing, 0.01, VELOCITY_RANGE[1])


class FirstReadingProfile(FilteredProfile):
    """The same with the first reading alone."""

    READINGS = 1
