"""A shield: around any controller, it keeps the forces of contact below a limit.

`agents.baselines.permitted` says at what speed the tool may meet an object. How the tool moves as long as it meets
none follows in closed form from how the flange does. So a command is let through if the tool keeps to that speed,
wherever an object may stand, while the command lasts and in a stop right after it; if not, it is slowed down until it
does. As that stop is then there to be commanded next, the shield never runs out of commands. After the alarm the flange
stops with all that it has, or retreats.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.baselines.permitted import held_up_to, permitted, poles
from agents.baselines.rule import Floats, Rule, View, encode
from agents.policies import Controller
from impact_gym.scene import Bistable, Rigid, SpringDamper
from impact_gym.task import ObservationSpec, Task

STEP = 1e-3  # s, between the moments of a command at which the tool's speed is looked at
COARSE_STEP = 4e-3  # s, likewise of the stop, which the next command looks at again
SLACK = 1e-3  # share of the permitted speed, more than the tool's differs from one moment to the next
HALVINGS = 10  # of what is asked for, where that is too fast
ROUNDING = 1e-5  # m/s, of velocities as observed


class FullSpeed(Rule):
    """As fast as the environment lets a flange go; back as fast from the alarm on."""

    def __init__(self, parameters: ArrayLike = ()) -> None:
        super().__init__(parameters)

    def command(self, view: View) -> tuple[ArrayLike, ArrayLike]:
        """Return one end of the velocities or the other, at the largest acceleration."""
        back, forward = self.task.velocity_range
        return np.where(view.alarm, back, forward), self.task.acceleration_range[1]


class Shield:
    """A controller whose commands are another's, slowed down where a contact force could exceed a limit."""

    def __init__(self, environment: Mapping[str, Any], limit: float, controller: Controller | None = None) -> None:
        """Make a controller.

        Args:
            environment: arguments of the environment; its `scenario` says where objects may stand, and which.
            limit: N, that no contact force is to exceed.
            controller: whose commands are let through as far as possible; None: `FullSpeed`, so that the shield alone
                says how fast.

        Raises:
            ValueError: for this environment nothing is proven, or the limit permits no speed.
        """
        self.task = task = Task(**environment)
        self.spec = ObservationSpec(task)
        self.permitted = permitted(task, limit)
        self.controller = controller or FullSpeed().for_environment(environment)
        self.near = task.scenario.distance[0]  # m
        self.speed_up, self.stop = 2 * task.acceleration_range[1:]  # m/s^2, the most it may, either way
        if isinstance(task.coupling, Bistable):
            self.speed_up = held_up_to(task, task.coupling)
        self.poles = poles(task.coupling, task.tool_mass) if isinstance(task.coupling, SpringDamper) else ()
        stopped = task.velocity_range[1] / self.stop + (2.0 / self.poles[0] if self.poles else 0.0)
        self.during = np.linspace(0.0, task.control_period, 1 + math.ceil(task.control_period / STEP))
        self.after = np.linspace(0.0, stopped, 1 + math.ceil(stopped / COARSE_STEP))

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for an observation (n_obs,) or the actions for a batch of them (n, n_obs), and a state.

        Raises:
            ValueError: the tool hangs on a spring, an episode goes on, and the state of the call before is missing.
        """
        view = View(np.atleast_2d(observation), self.spec)
        going_on = view["time"] > 0.0
        if state is None and self.poles and going_on.any():
            raise ValueError("state must be what the last call returned: the shield follows the tool on its spring")
        inner, lags = state or (None, np.zeros((len(self.poles), len(going_on))))
        action, inner = self.controller.predict(observation, inner, episode_start, deterministic)
        asked = self._physical(np.atleast_2d(action))
        now = np.stack([view["position"], view["velocity"], *np.where(going_on, lags, 0.0)])
        free = ~view.alarm
        command = np.stack([np.minimum(asked[0], 0.0), np.full(len(free), self.stop)])
        command[:, free] = self._slowed(now[:, free], asked[:, free])
        lags = self._flight(now, command, self.during[-1:])[2:, :, 0]
        actions = encode(command[0], command[1], self.task.velocity_range, self.task.acceleration_range)
        return actions.reshape(np.shape(action)), (inner, lags)

    def _physical(self, action: ArrayLike) -> Floats:
        """Return what actions (n, 2) ask for (2, n), m/s and m/s^2."""
        low, high = np.array([self.task.velocity_range, self.task.acceleration_range]).T
        return (low + 0.5 * (np.clip(np.asarray(action, np.float64), -1.0, 1.0) + 1.0) * (high - low)).T

    def _slowed(self, now: Floats, asked: Floats) -> Floats:
        """Return the commands (2, n), m/s and m/s^2, that come nearest to those that are `asked` for and are safe.

        Args:
            now: (2 or 4, n), the flange's position (m) and velocity (m/s), and how the tool lags, see `_flight`.
            asked: (2, n), m/s and m/s^2.
        """
        command = np.stack([asked[0], np.where(asked[0] > now[1], np.minimum(asked[1], self.speed_up), asked[1])])
        rows = np.flatnonzero(~self._safe(now, command))
        if not rows.size:
            return command
        now, (high, gently) = now[:, rows], asked[:, rows]
        velocity, gently = now[1], np.minimum(gently, self.speed_up)

        def to(target: Floats) -> Floats:
            return np.stack([target, np.where(target >= velocity, gently, self.stop)])

        keeps_on = (velocity < high) & self._safe(now, to(velocity))
        low = np.where(keeps_on, velocity, np.minimum(high, 0.0))
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            safe = self._safe(now, to(middle))
            low, high = np.where(safe, middle, low), np.where(safe, high, middle)
        command[:, rows] = to(low)
        return command

    def _safe(self, now: Floats, command: Floats) -> NDArray[np.bool_]:
        """Whether a command (2, n), followed for a control period and then by a stop, keeps the tool slow enough."""
        path = self._flight(now, command, self.during)
        safe = self._slow_enough(path, STEP)
        end = path[:, safe, -1]
        rest = np.stack([np.zeros(end.shape[1]), np.full(end.shape[1], self.stop)])
        safe[safe] = self._slow_enough(self._flight(end, rest, self.after), COARSE_STEP)
        return safe

    def _slow_enough(self, path: Floats, step: float) -> NDArray[np.bool_]:
        """Whether a tool, its path (2 or 4, n, k) known every `step` (s), keeps to what is permitted."""
        position, velocity, *lags = path
        limit = (1.0 - SLACK) * self.permitted
        tool, tool_velocity, wrong = position, velocity, np.zeros(position.shape, np.bool_)
        if self.poles:
            (slow, fast), (by_fast, by_slow) = self.poles, lags
            lag, lag_rate = (by_slow - by_fast) / (fast - slow), (fast * by_fast - slow * by_slow) / (fast - slow)
            tool, tool_velocity = position - lag, velocity - lag_rate
            wrong = slow * fast * lag > (slow + fast) * (limit - velocity)
        elif isinstance(self.task.coupling, Rigid):
            wrong[:, 1:] = (np.diff(velocity) > ROUNDING) & (velocity[:, 1:] > 0.0)
        met = tool + np.maximum(tool_velocity, 0.0) * step >= self.near
        return ~(met & (wrong | (tool_velocity > limit))).any(axis=-1)

    def _flight(self, now: Floats, command: Floats, times: Floats) -> Floats:
        """Return position and velocity of a flange and the lag of its tool (2 or 4, n, k) at `times` (k,) from `now`.

        The tool lags by q, q'' + (p1 + p2) q' + p1 p2 q = the flange's acceleration. So q' + p1 q and q' + p2 q, which
        stand for the lag, decay with p2 and p1, and grow with that acceleration.
        """
        position, velocity, *lags = now[..., None]
        target, size = command[..., None]
        acceleration = np.copysign(size, target - velocity)
        ramp = np.minimum(times, (target - velocity) / acceleration)
        held = times - ramp
        reached = velocity + acceleration * ramp
        path = [position + 0.5 * (velocity + reached) * ramp + reached * held, reached]
        for lag, pole in zip(lags, self.poles[::-1], strict=True):
            ramped = lag * np.exp(-pole * ramp) - acceleration / pole * np.expm1(-pole * ramp)
            path.append(ramped * np.exp(-pole * held))
        return np.stack(path)
