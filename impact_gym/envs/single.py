"""The Gymnasium environment, a batch of size 1. The docstring of `ImpactApproachEnv` is its specification."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from impact_gym.envs.arguments import documented
from impact_gym.envs.batch import Batch
from impact_gym.outcome import Trace
from impact_gym.support.validation import WrongTypeError, choice, flag, whole
from impact_gym.task.episodes import EpisodeState, reset_options
from impact_gym.task.scenario import ScenarioRanges
from impact_gym.task.task import Task

if TYPE_CHECKING:
    from impact_gym.render import Renderer

TRACE_POINTS = 1 << 15
_ROW = np.zeros(1, np.int64)
_NO_SKIP = np.zeros(1, np.bool_)


def steps_per_second(task: Task) -> int:
    """Return the control steps per second of a film, 1 to 30, so that `horizon` takes about 18 s if possible."""
    return min(max(round(task.horizon / task.control_period / 18.0), 1), 30)


@documented
class ImpactApproachEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """A robot's tool approaches an object at an unknown distance.

    ## Description
    A robot's flange follows a commanded motion, and carries a tool of 0.125 kg. Ahead of the tool is an object. The
    controller does not know the object's distance, mass, contact stiffness and restitution. The tool should touch the
    object early, and the object should then leave slowly. If the contact force exceeds 1 N, the controller gets an
    *alarm*, the report of a contact. The task is from the paper of Tommasino, Cipriani, Doria, Rosati (2020), 'Effect
    of End-Effector Compliance on Collisions in Robotic Teleoperation'.

    ## Action Space
    `Box(-1, 1, (2,), float32)`: an action is a velocity and an acceleration. With this acceleration, the flange changes
    its velocity to the commanded value, and then keeps this velocity. Values outside the box are clipped.

    | Num | Action                     | at -1 | at +1 | Unit  | Argument             |
    |-----|----------------------------|-------|-------|-------|----------------------|
    | 0   | velocity to go to          | -0.5  | 1.5   | m/s   | `velocity_range`     |
    | 1   | acceleration to use for it | 1     | 20    | m/s^2 | `acceleration_range` |

    Both are rounded to 1e-6 m/s or m/s^2. `action_spec` of the unwrapped environment has two methods:
    `decode(action)` returns both in SI units, and `encode(velocity, acceleration)` returns an action.

    ## Observation Space
    `Box(..., (8,), float32)`. The last column of the table names the arguments that add or change a number. Each number
    is mapped from a constant range (columns "from" and "to") to [-1, 1] or [0, 1], and clipped. Position and velocity
    are values of the commanded motion. The flange of a rigid robot follows this motion exactly, and the flange of a
    compliant `robot` deviates from it. `sensors()` of the unwrapped environment returns the sensor values in SI units.

    `observation_spec` of the unwrapped environment describes the observation. Its tuple `ids` has an id per number,
    such as "alarm". `index(id)` returns the index of a number in the observation, and `decode(observation, id)` the
    number in SI units. The slice `actor` selects the numbers for a controller, and the slice `critic` all numbers.

    `privileged=True` appends numbers for a critic: the object's true mass, contact stiffness, restitution and distance,
    the reaction delay, and all numbers in the list of Starting State that are drawn per episode. If `alarm` is
    "reading", it also appends the time since a switch would have raised the alarm.

    OBSERVATION_TABLE

    A step lasts one control period, 16 ms. It ends earlier when the alarm reaches the controller, or when the episode
    ends. The alarm reaches the controller `reaction_delay` after the contact force first exceeds `alarm_threshold`, and
    stays on. Noise and bias of the force readings do not affect it.

    With `alarm="reading"` there is no switch. Each force reading is then the largest force since the previous reading,
    with noise and bias. A reading above `alarm_threshold` raises the alarm for 0.15 s (`after_alarm`). A later reading
    can raise the alarm again. Such an alarm does not shorten a step, and noise can raise a false alarm. The episode
    ends 0.15 s after a switch would have raised the alarm.

    With `range_sensor` the tool carries a proximity sensor, see `RangeSensor`. For every observation, the sensor
    measures the gap to the object. The controller observes the newest reading that has arrived, and its age. Before the
    first, both are inf in `sensors()`, and 1 in the observation. The argument `range_noise`, without a `range_sensor`,
    adds an estimate of the distance, made once before the episode.

    ## Rewards
    Without an `operator`, each step gives `-time_weight * dt` until the first contact begins. Here dt is the duration
    of the step, or of the part of the step before the contact. If the object was touched, the step that terminates the
    episode adds `-V_p - force_weight * peak force`. V_p is the object's final velocity or, with `friction`, the
    object's largest velocity. If the object was not touched, this step adds `-missed_cost` (-2). If V_p is at most
    `missed_cost` and `force_weight` is 0, the return lies in [-time_weight * horizon - missed_cost, 0].

    With a `force_limit` or `velocity_limit`, each step's `info` has `cost`: 1 if the step terminates an episode whose
    peak force or V_p is above its limit, otherwise 0.

    ## Starting State
    Flange, tool and object are at rest, the flange at position 0. The coupling is relaxed, but a bistable coupling
    rests on its front stop. Each episode takes eleven uniform random numbers from `np_random`. These numbers determine
    the scenario:

    SCENARIO_TABLE

    They also determine the time weight (log-uniform), the reaction delay (uniform), the error of the distance estimate
    (normal), and the error of all force readings (normal). Arguments fix these four by default. The last of the eleven
    numbers determines the seed of all other random numbers.

    Each number in the next list may be a pair (low, high). Every episode then draws the number between low and high,
    log-uniformly if it is observed as log and low is not 0, else uniformly. The list says in which range a critic
    observes it:

    SET_UP_LIST

    With the same seed, a draw of a number in this list does not change the scenario or the list's other numbers.

    `reset(options=...)` applies to one episode:

    - `{"scenario": {...}}` fixes some or all of the scenario fields above.
    - `{"record": {...}}` fixes some or all of the drawn numbers. To repeat an episode, give its final `info["record"]`
      and the same actions. A reaction delay must not exceed the environment's largest reaction delay. Numbers of
      the list must lie in the environment's ranges. No number may be given twice.

    ## Episode End
    An episode terminates 0.15 s (`after_alarm`) after the alarm. If the object was touched, the flange then brakes to
    rest at the largest acceleration of an action, and the simulation continues for at most 10 s. Without `friction`,
    the simulation ends when tool and object are apart and cannot touch again. V_p is then the object's last velocity.
    With `friction`, the simulation ends when V_p is final and the tool is slower than 1 mm/s. If contacts are still
    possible after 10 s, as with an object of several tonnes, `info["status"]` begins with "not settled".

    Without an alarm an episode terminates at 1.2 s (`horizon`). An object that was touched too softly to raise the
    alarm counts as touched. If the object was not touched, the episode is `missed`. An episode also terminates if the
    solver fails. Then the reward is the same as for a missed episode, and `info["status"]` gives the cause. Episodes
    are truncated only after `max_episode_steps`: by Gymnasium's `TimeLimit`, or by the batch.

    The final `info` has `object_velocity` (m/s), `approach_time` (s), `peak_force` (N), `contact_count`, `missed`,
    `time_weight`, `reward_terms`, `scenario`, `record` and `status`. `reward_terms` has the terms time, velocity, force
    and missed; their sum is the return. `record` has all drawn numbers. With `friction` the final `info` also has
    `slide` and `rest_time`. `slide` (m) is the distance from the object's first position to the place where it comes to
    rest if no contact follows. `rest_time` (s) is the time from which the object rests and, checked once per ms after
    the flange has stopped, the tool is slower than 1 mm/s; inf if the simulation ends before. A truncated episode has
    no final `info`. Then, and during an episode, `env.unwrapped.episode_info()` returns the present values.

    ## Arguments
    To draw a number of a coupling or robot from a range, give a dict:
    `coupling={"type": "SpringDamper", "stiffness": (40, 60)}`.

    ARGUMENT_LIST

    Two more arguments are `render_mode` (None, "human", "rgb_array" or "rgb_array_list") and
    `record_trace` (True: keep time histories, which `trace()` returns).

    ## Rendering
    Rendering needs the packages of the extra `render`, and does not change any result. A picture shows flange,
    coupling, tool and object to scale, the gap, the object's velocity, the alarm and, at the end, the result.

    - "human" and "rgb_array_list" show the episode in slow motion, with many pictures per step.
      `impact_gym.render.film.SlowMotionVideo` writes a film of 6 to 10 s.
    - "rgb_array" gives one picture at the end of each step. From these pictures Gymnasium's `RecordVideo` makes a film
      with a constant slow-motion factor, set by `render_fps` in the metadata. In a batch of at most 16 environments,
      `render` returns a picture of each, and `RecordVideo` shows them side by side.

    ## Version History
    * v0: first version; it may still change until version 0.1.0 of the package is released

    As in Gymnasium, an id gets a higher version number if new results cannot be compared with old ones. This is so if
    a default changes, or if the same seed and actions give other observations, rewards or ends. Differences that `rtol`
    allows do not count. All ids then get the new number. An old id raises an error that names the new id.
    """

    metadata = {  # noqa: RUF012  # as in gymnasium.Env
        "render_modes": ["human", "rgb_array", "rgb_array_list"],
        "render_fps": 30,
    }

    def __init__(self, *, render_mode: str | None = None, record_trace: bool = False, **arguments: Any) -> None:
        """Make an environment; see Arguments."""
        choice("render_mode", render_mode, (None, *self.metadata["render_modes"]))
        flag("record_trace", record_trace)
        self.render_mode = render_mode
        self._renderer: Renderer | None = None
        points = TRACE_POINTS if record_trace or render_mode is not None else 0
        if "max_episode_steps" in arguments:
            raise WrongTypeError("max_episode_steps must be given to gymnasium.make, which adds a TimeLimit")
        self.task = Task.of("environment", arguments, "render_mode", "record_trace")
        self._batch = Batch(1, self.task, threads=1, trace_points=points)
        if render_mode == "rgb_array":
            self.metadata = {**self.metadata, "render_fps": steps_per_second(self.task)}
        self.observation_spec, self.action_spec = self._batch.spec, self._batch.action_spec
        self.observation_space = spaces.Box(self.observation_spec.scaled_low, 1.0, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (len(self.action_spec),), np.float32)
        self._running = False

    def set_scenario(self, scenario: ScenarioRanges | Mapping[str, Any] | str) -> None:
        """From the next episode on, draw scenarios from these ranges."""
        self._batch.set_scenario(scenario)

    def episode_info(self) -> dict[str, Any]:
        """Return the entries of the final `info` with their present values."""
        self._batch.check_begun("episode_info")
        return self._batch.info(0)

    def episode_state(self) -> EpisodeState:
        """Return the times (s) of detection, alarm, end of the alarm and end of the episode, see `EpisodeState`."""
        return self._batch.episode_state(0)

    def command(self, velocity: float) -> None:
        """Let the operator, a `Person`, command `velocity` (m/s) until the next call or the end of the episode."""
        self._batch.set_operator_velocity(velocity)

    def sensors(self) -> dict[str, float]:
        """Return the sensor values in SI units, not clipped.

        They are `time` (s), `position` (m) and `velocity` (m/s) of the commanded motion, `alarm` (0 or 1),
        `time_since_alarm` (s), `force` (N, the newest reading at the controller) and `force_peak` (N, the largest
        sensed force so far). Some arguments add `distance_estimate` (m, from the flange's position), `deflection` (m)
        and others.
        """
        return {name: float(column[0]) for name, column in self._batch.sensors().items()}

    def trace(self) -> Trace:
        """Return the time histories of the episode so far, and of the simulation that follows its last step.

        Raises:
            RuntimeError: neither `record_trace` nor `render_mode` was given, or the episode has too many points.
        """
        points, kept = int(self._batch.chains["traced"][0]), self._batch.traces.shape[1]
        if kept == 0:
            raise RuntimeError("make the environment with record_trace=True to read a trace")
        if points > kept:
            raise RuntimeError(f"the episode has {points} trace points, more than {kept}: shorten the horizon")
        return self._batch.trace(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode; see Starting State."""
        fixed = reset_options(options, self._batch.tasks)
        super().reset(seed=None if seed is None else whole("seed", seed, at_least=0))
        self._batch.begin(_ROW, [self.np_random], fixed)
        self._running = True
        if self._renderer is not None:
            self._renderer.begin()
        if self.render_mode == "human":
            self.render()
        return self._batch.observations[0].copy(), {}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Play one control step."""
        if not self._running:
            raise gym.error.ResetNeeded("no episode is under way: call reset before step")
        batch = self._batch
        batch.step(action, _NO_SKIP, (len(batch.action_spec),))
        terminated = bool(batch.episodes["terminated"][0])
        self._running = not terminated
        info = batch.step_infos()[0] | (batch.info(0) if terminated else {})
        if self.render_mode == "human":
            self.render()
        return batch.observations[0].copy(), float(batch.rewards[0]), terminated, False, info

    def render(self) -> Any:
        """Return a picture (540, 960, 3), or a list of the pictures since the last call; see Rendering.

        In mode "human", `render`, `reset` and `step` show the pictures in a window. In this mode, and without a
        `render_mode`, `render` returns None.

        Raises:
            DependencyNotInstalled: pygame is missing.
            ResetNeeded: there is no episode yet.
        """
        if self.render_mode is None:
            gym.logger.warn("render() draws nothing without a render_mode, such as gym.make(..., render_mode='human')")
            return None
        self._batch.check_begun("render")
        if self._renderer is None:
            from impact_gym.render import Renderer

            self._renderer = Renderer(self.render_mode, self.metadata["render_fps"])
        return self._renderer.render(self._batch.history(0))

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
