"""A rival that looks ahead: at each control step, a simple model of what follows chooses how to shift the profile."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm

from agents.baselines.filtered import END, KEPT, SelfCalibratingProfile
from agents.baselines.rule import Floats, View

SHIFTS = np.array([0.0, 0.004, -0.004, 0.01, -0.01, 0.02, -0.02])[:, None]  # m, of the profile towards the tool
MARGIN = 0.003  # m/s; the profile is shifted only if the cost falls by more
QUANTILES = (np.arange(24) + 0.5) / 24  # of the particles, which are places of the object
ERRORS = np.random.default_rng(0).permutation(norm.ppf(QUANTILES))  # of what the filter will learn, standard deviations
STEPS = 30  # largest number of control steps in a prediction
LEAST, RISE = 0.008, 0.09  # m, -: at the gap g, the filter's standard deviation is LEAST + RISE g on average
TOUCH = np.array([0.024, 0.118, 0.038, 0.166])
"""V_p (m/s) fitted to touches with the shipped profile: a + b v + c v^2 + d u, with the velocities v of the tool and u
of the flange. The fit explains 33 % of the variance: the rest depends on the object."""


class LookAhead(SelfCalibratingProfile):
    """`SelfCalibratingProfile` that shifts its profile by one of SHIFTS, which costs least in a prediction.

    The particles are quantiles of the filter's normal distribution, given that the object is in the range of distances
    and that the tool has not touched it. In a prediction, the spread falls with the gap (LEAST, RISE), and the error
    of the place falls with the variance; what the filter learns in addition is random (ERRORS).
    """

    def with_estimate(self, view: View, state: Floats) -> View:
        """Return the view with what `see` adds, and the rate of the `swing` (m/s) and the `particles` (rows, n), m."""
        seen, (near, far) = super().with_estimate(view, state), self.task.scenario.distance
        late = round(self.delay / self.task.control_period)  # the tool has not touched before
        (place, spread), begin = self.place(state[END:]), np.clip(state[END - KEPT + late], near, far - 1e-3)
        low, high = (norm.cdf((end - place) / spread)[:, None] for end in (begin, far))
        among = place[:, None] + spread[:, None] * norm.ppf(np.clip(low + (high - low) * QUANTILES, 1e-9, 1 - 1e-9))
        own = {name: seen[name] for name in ("distance_estimate", "spread", "swing")}
        return View(view.observation, view.spec, rate=state[3], particles=np.clip(among, begin[:, None], far), **own)

    def command(self, view: View) -> tuple[ArrayLike, ArrayLike]:
        """Return velocity (m/s) and acceleration (m/s^2) of the shifted profile."""
        own = {name: view[name] for name in ("distance_estimate", "spread", "swing", "rate", "particles")}
        free, shift = ~view.alarm, np.zeros(len(view.observation))
        if free.any():
            costs = self.predicted(View(view.observation[free], view.spec, **{k: v[free] for k, v in own.items()}))
            costs[:, 0] -= MARGIN
            shift[free] = SHIFTS[np.argmin(costs, axis=1), 0]
        own["distance_estimate"] = own["distance_estimate"] - shift
        return super().command(View(view.observation, view.spec, **own))

    def predicted(self, view: View) -> Floats:
        """Return the mean cost until the touch (m/s) for each shift, (rows, shifts)."""
        objects, period = view["particles"][:, None], self.task.control_period
        shape = np.broadcast_shapes(objects.shape, SHIFTS.shape)
        names = ("position", "velocity", "swing", "rate", "spread", "time_weight")
        position, velocity, swing, rate, spread, weight = (view[name][:, None, None] for name in names)
        error, reach = view["distance_estimate"][:, None, None] + position - objects, self["acceleration"] * period
        cost, apart, known, unknown = np.zeros(shape), np.ones(shape, np.bool_), spread, np.ones(1)
        for _ in range(STEPS):
            seen = objects + error * unknown + known * np.sqrt(1.0 - unknown) * ERRORS - position - SHIFTS
            untouched = dict.fromkeys(("force_peak", "alarm", "time_since_alarm"), np.zeros(()))
            own = {"distance_estimate": seen, "spread": known, "swing": swing, "velocity": velocity, **untouched}
            wanted = np.asarray(super().command(View(view.observation, view.spec, **own))[0])
            tool, gained = position + swing, np.clip(wanted - velocity, -reach, reach)
            position, velocity = position + (velocity + 0.5 * gained) * period, velocity + gained
            swing, rate = self.swing(swing, rate, gained)
            moved, gap = position + swing - tool, objects - position - swing
            speed = np.maximum(moved / period, 0.0)
            touch = TOUCH[0] + TOUCH[1] * speed + TOUCH[2] * speed**2 + TOUCH[3] * np.maximum(velocity, 0.0)
            share = np.clip((gap + moved) / np.maximum(moved, 1e-9), 0.0, 1.0)
            hit = apart & (gap <= 0.0)
            cost += np.where(hit, weight * period * share + touch, apart * weight * period)
            apart &= ~hit
            known = np.minimum(LEAST + RISE * np.maximum(gap, 0.0), spread)
            unknown = (known / spread) ** 2
        return (cost + apart * (weight * np.maximum(gap, 0.0) / 0.3 + TOUCH[0])).mean(axis=2)
