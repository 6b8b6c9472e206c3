"""Rules for a range sensor: a filter estimates the object's place from readings, and a profile uses the estimate.

The tool's position at the time of a reading, plus the reading without bias, is a measurement of the object's place. The
estimate starts at the middle of the range of distances, with the variance of a uniform distribution over this range.
The filter knows the task's range sensor, tool mass and coupling. If episodes draw one of their numbers, the filter uses
its median; `SelfCalibratingProfile` estimates the sensor's drawn bias and scale.
"""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from agents.baselines.profile import LEAST_SPREAD, StretchedProfile
from agents.baselines.rule import CLOCK, Floats, Parameter, View
from impact_gym.task.task import VELOCITY_RANGE

KEPT = 32  # number of the latest control steps that the filter remembers; a reading from an earlier step is not used
END = 4 + 3 * KEPT  # number of the state's entries before the estimate
BEYOND, GOING_ON = 0.003, 0.15  # m, m/s; with the tool farther than this behind the estimated place, the flange goes on
LIGHT, GENTLY = 0.25, 0.05  # N, m/s; the speed behind the place if force errors hide touches of this force
Flags = NDArray[np.bool_]


class FilteredProfile(StretchedProfile, tunable=True):
    """Follow a speed profile over the distance that a filter estimates from the range readings.

    Where readings are too short, the object is behind the estimated place. There the tool does not stop: until a force
    is felt, the flange goes on with at least GOING_ON, or with GENTLY if a light touch is not felt: the object would be
    pushed. A reading of 0 hides how large a negative error is; it is not used.
    """

    NEEDS: ClassVar[Mapping[str, Any]] = {"range_sensor": {"noise": 0.01}}
    KNOWS = ("range_sensor", "tool_mass", "coupling")
    READINGS = np.inf  # largest number of readings that the filter uses in an episode
    SPREAD = "spread"

    def profile(self, view: View) -> Callable[[Floats], Floats]:
        """Return the profile of `StretchedProfile`, but behind the estimated place at least the going-on speed."""
        follow, (begin, least) = super().profile(view), self.going_on()
        least = np.where(view["force_peak"] <= self.felt, least, 0.0)

        def speed(place: Floats) -> Floats:
            followed = follow(place)
            return np.where(place + view["swing"] > begin, np.maximum(followed, least), followed)

        return speed

    def going_on(self) -> tuple[float, Floats]:
        """Return how far (m) behind the estimated place the tool is when the flange goes on, and its speed (m/s)."""
        return BEYOND, np.asarray(GENTLY if self.felt > LIGHT else GOING_ON)

    @property
    def felt(self) -> float:
        """Force reading above which the tool touches: beyond four standard deviations of the errors, N."""
        return 1e-3 + 4.0 * (self.task.longest("force_noise") + self.task.longest("force_bias"))

    def see(self, view: View, state: Any, episode_start: Any) -> tuple[View, Any]:
        """Return the view and the next state.

        The view also has `distance_estimate` (m), its standard deviation `spread` (m) and the tool's `swing` (m).
        The state begins with the number of used readings, the time (s) of the last one, and the result of `swing`.
        Time, flange velocity and tool position (SI) of KEPT steps follow, and then the estimate, see `prior`.
        """
        time, position, velocity = view["time"], view["position"], view["velocity"]
        start = np.asarray(state is None or (episode_start is not None and episode_start))
        before = self.begun(state, start, np.shape(time)) if start.any() else state
        count, newest = before[:2]
        history = before[4:END].reshape(3, KEPT, *np.shape(time))
        gained = velocity - np.where(start, 0.0, history[1, 0])
        state = np.empty_like(before)
        state[2], state[3] = self.swing(before[2], before[3], gained)
        times, velocities, tools = state[4:END].reshape(history.shape)
        for newest_first, earlier, now in zip(
            (times, velocities, tools), history, (time, velocity, position + state[2]), strict=True
        ):
            newest_first[0], newest_first[1:] = now, earlier[:-1]
        read_at, reading = time - view["range_age"], view["range"]
        tool, apart = nearest_tool(times, tools, read_at)
        counts = (read_at > newest + CLOCK) & (apart < 1e-3) & (count < self.READINGS) & ~view.alarm
        counts &= (reading > 0.0) & (reading < self.spec.scale("range").high)
        state[0], state[1] = count + counts, np.where(counts, read_at, newest)
        state[END:] = self.updated(before[END:], reading, tool, counts)
        return self.with_estimate(view, state), state

    def begun(self, state: Floats | None, start: Flags, shape: tuple[int, ...]) -> Floats:
        """Return the state, with the values before the first step in rows (`shape`) of episodes that `start`."""
        prior = self.prior()
        fresh = np.zeros((END + len(prior), *shape))
        fresh[1], fresh[4 : 4 + KEPT] = -1.0, -np.inf
        fresh[END:] = prior.reshape(-1, *(1,) * len(shape))
        return fresh if state is None else np.where(start, fresh, state)

    def prior(self) -> Floats:
        """Return the estimate before the first reading: weight (1/m^2) and place (m)."""
        near, far = self.task.scenario.distance
        return np.array([12.0 / max(far - near, 1e-3) ** 2, 0.5 * (near + far)])

    def updated(self, estimate: Floats, reading: Floats, tool: Floats, counts: Flags) -> Floats:
        """Return the estimate after readings (m) at tool positions (m), in the rows whose reading `counts`."""
        (weight, place), sensor = estimate, self.task.range_sensor
        added = np.where(counts, 1.0 / np.maximum(sensor.noise + sensor.share * reading, LEAST_SPREAD) ** 2, 0.0)
        read = tool + reading - sensor.bias
        place = np.where(counts, (weight * place + added * read) / (weight + added), place)
        return np.stack([weight + added, place])

    def with_estimate(self, view: View, state: Floats) -> View:
        """Return the view with what `see` adds."""
        place, spread = self.place(state[END:])
        own = {"distance_estimate": place - view["position"], "spread": spread, "swing": state[2]}
        return View(view.observation, view.spec, **own)

    def place(self, estimate: Floats) -> tuple[Floats, Floats]:
        """Return an estimate's place (m) and standard deviation (m)."""
        weight, place = estimate
        return place, 1.0 / np.sqrt(weight)

    def swing(self, deflection: Floats, rate: Floats, gained: Floats) -> tuple[Floats, Floats]:
        """Return the next deflection (m) and rate (m/s); `gained`: rise of the flange velocity, m/s (paper, eq. 17)."""
        period, oscillator = self.task.control_period, self.task.coupling.oscillator(self.task.tool_mass)
        if oscillator is None:
            return deflection, rate
        square, damping = oscillator
        (a, b, c), (d, e, f) = expm(period * np.array([[0, 1, 0], [-square, -damping, -1 / period], [0, 0, 0]]))[:2]
        return a * deflection + b * rate + c * gained, d * deflection + e * rate + f * gained


class FirstReadingProfile(FilteredProfile, tunable=True):
    """Follow a speed profile over the distance from the first valid range reading of an episode."""

    READINGS = 1


class SelfCalibratingProfile(FilteredProfile, tunable=True):
    """Follow a speed profile over a Kalman filter's estimate of place, bias and scale, then go on at a tuned speed.

    A reading at the tool position p is (1 + scale) (place - p) + bias + noise. The product's mean and variance are
    those of normal place and scale (Gaussian second-order filter, Jazwinski 1970). The arm's motion tells the scale.
    Place and bias have the same influence on all readings, so that the spread of the place keeps what the task's range
    of the bias says. The noise counts as independent, with its variance times (1 + r) / (1 - r) for a correlation r: so
    the variance of a mean of many readings is right. A force that is felt is a measurement of the place: the tool was
    there one reaction delay before.
    """

    PARAMETERS = (
        *FilteredProfile.PARAMETERS,
        Parameter("going-on speed", "m/s", GOING_ON, VELOCITY_RANGE[1], 0.3),
    )

    def going_on(self) -> tuple[float, Floats]:
        """Return a distance of 0, and the tuned speed (m/s)."""
        return 0.0, self["going-on speed"]

    def see(self, view: View, state: Any, episode_start: Any) -> tuple[View, Any]:
        """Return what `FilteredProfile.see` returns, with the place of a touch that is felt."""
        _, state = super().see(view, state, episode_start)
        (times, _, tools), estimate = np.split(state[4:END], 3), state[END:]
        late = slice(int(self.delay / self.task.control_period) + 3)  # the nearest step is one of these
        tool, _ = nearest_tool(times[late], tools[late], view["time"] - self.delay)
        touch = np.stack([np.ones_like(tool), *np.zeros((2, *tool.shape))])
        estimate[:] = measured(estimate, touch, tool - estimate[0], LEAST_SPREAD**2, view["force"] > self.felt)
        return self.with_estimate(view, state), state

    @property
    def delay(self) -> float:
        """Mean reaction delay, s."""
        return float(np.mean(self.task.reaction_delay))

    def prior(self) -> Floats:
        """Return the estimate before the first reading: place (m), bias (m), scale (-), and their covariances (9,)."""
        near, far = self.task.scenario.distance
        ends = [(near, max(far, near + 1e-3)), *(self.ends(name) for name in ("bias", "scale"))]
        return np.concatenate([np.mean(ends, axis=1), np.diag(np.ptp(ends, axis=1) ** 2 / 12.0).ravel()])

    def ends(self, name: str) -> tuple[float, float]:
        """Return the range of a number of the range sensor."""
        value = getattr(self.task.range_sensor, name)
        return self.task.ranges.get(f"range_sensor.{name}", (value, value))

    def updated(self, estimate: Floats, reading: Floats, tool: Floats, counts: Flags) -> Floats:
        """Return the estimate after readings (m) at tool positions (m), in the rows whose reading `counts`."""
        (place, bias, scale), sensor = estimate[:3], self.task.range_sensor
        variances, mixed = estimate[[3, 11]], estimate[5]  # of place and scale, and their covariance
        slope = np.stack([1.0 + scale, np.ones_like(place), place - tool])
        variance = np.maximum(sensor.noise + sensor.share * reading, LEAST_SPREAD) ** 2 * self.inflation
        variance += variances[0] * variances[1] + mixed**2
        return measured(estimate, slope, reading - slope[0] * slope[2] - bias - mixed, variance, counts)

    @property
    def inflation(self) -> float:
        """Factor of the variance of a reading, for the correlation of the noise."""
        return (1.0 + self.task.range_sensor.correlation) / (1.0 - self.task.range_sensor.correlation)

    def place(self, estimate: Floats) -> tuple[Floats, Floats]:
        """Return an estimate's place (m) and standard deviation (m)."""
        return estimate[0], np.sqrt(np.maximum(estimate[3], 0.0))


def nearest_tool(times: Floats, tools: Floats, moment: Floats) -> tuple[Floats, Floats]:
    """Return the tool position (m) at the step nearest to a `moment` (s), and the time between (s)."""
    step = np.argmin(np.abs(times - moment), axis=0)[None]
    found, when = (np.take_along_axis(table, step, 0)[0] for table in (tools, times))
    return found, np.abs(when - moment)


def measured(estimate: Floats, slope: Floats, surprise: Floats, variance: Floats | float, counts: Flags) -> Floats:
    """Return an estimate (3 means and 9 covariances, rows) after a measurement (Kalman 1960), where it `counts`.

    `slope` (3, rows): derivatives of the measured number with respect to the means; `surprise`: measured minus expected
    number; `variance`: of the measurement.
    """
    mean, covariance = estimate[:3], estimate[3:].reshape(3, 3, *estimate.shape[1:])
    joint = np.einsum("ij...,j...->i...", covariance, slope)
    gain = joint / (np.sum(slope * joint, axis=0) + variance)
    after = covariance - gain[:, None] * joint[None]
    return np.where(counts, np.concatenate([mean + gain * surprise, after.reshape(estimate[3:].shape)]), estimate)
