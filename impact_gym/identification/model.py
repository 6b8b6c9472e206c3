"""The model that is fitted to logs: predicted samples and residuals as functions of a vector x.

x has a coordinate for each free number of the scene (ln(e/(1-e)) for the restitution e, ln|a| for any other number a),
then the start of the motion in each log, then the biases to estimate.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from impact_gym.identification.log import Log
from impact_gym.identification.sensor import Array, Sensor, bursts, noise_of
from impact_gym.motion import Trapezoid
from impact_gym.outcome import Trace
from impact_gym.physics.impact import GRAVITY
from impact_gym.scene import RobotTable, Scene
from impact_gym.simulation import simulate
from impact_gym.support.dotted_paths import flatten, get, parts, replaced
from impact_gym.support.validation import WrongTypeError

MASS, STIFFNESS, RESTITUTION = "object.mass", "contact.stiffness", "contact.restitution"
SEARCHED = {STIFFNESS: (1e2, 1e8), RESTITUTION: (0.03, 0.99), MASS: (5e-3, 5e2)}  # ranges of scattered starting points
SEARCH_FACTOR = 10.0  # starting points of any other number are scattered within this factor of the scene's value
REACH_FACTOR = 1e4  # a fitted number may leave its range by at most this factor; for the restitution see LARGEST_LOGIT
WALL = 1e5  # largest ratio of object mass to the mass of a tool on a spring; a heavier object acts like a fixed wall
LARGEST_LOGIT = 14.0  # largest |ln(e/(1-e))| of the restitution e, which keeps e between 8e-7 and 1 - 8e-7
RTOL = 1e-8
STEP = 2e-3  # step of a coordinate for finite differences; the relative error of these derivatives is about 0.1 %
Column = tuple[int, str]  # index of a log, and name of one of its columns
IMPOSSIBLE = 1e3  # if the scene cannot be simulated, predicted samples are this many times the range of their column


@dataclass(frozen=True)
class Coordinate:
    """The coordinate of one free number, and its bounds."""

    name: str
    sign: float  # sign of the number (1, -1); the coordinate is computed from the absolute value
    searched: tuple[float, float]  # range of the absolute value over which starting points are scattered
    wall: float = math.inf  # largest absolute value; a larger value would predict the same log

    @property
    def reach(self) -> tuple[float, float]:
        """Least and largest coordinate that the fit may reach."""
        if self.name == RESTITUTION:
            return -LARGEST_LOGIT, LARGEST_LOGIT
        return math.log(self.searched[0] / REACH_FACTOR), math.log(min(self.searched[1] * REACH_FACTOR, self.wall))

    def coordinate(self, size: float) -> float:
        """Return the coordinate of an absolute value."""
        if self.name == RESTITUTION:
            return min(math.log(size / (1.0 - size)) if size < 1.0 else LARGEST_LOGIT, LARGEST_LOGIT)
        return math.log(size)

    def number(self, u: float) -> float:
        """Return the number at coordinate `u`; `u` is first clipped to `reach`."""
        u = float(np.clip(u, *self.reach))
        return 1.0 / (1.0 + math.exp(-u)) if self.name == RESTITUTION else self.sign * math.exp(u)

    def end(self, u: float | None, side: int) -> float:
        """Return the number at the end `u` of its interval; None: 0 (`side` -1), else +-infinity or restitution 1."""
        if u is not None:
            return self.number(u)
        return float(side > 0) if self.name == RESTITUTION else self.sign * (math.inf if side > 0 else 0.0)

    def start(self, scene: Scene) -> float:
        """Return the coordinate of the number in `scene`, or if it is outside `reach`, the middle of `reach`."""
        size, (low, high) = abs(get(scene, self.name)), self.reach
        inside = size > 0.0 and low <= self.coordinate(size) <= high
        return self.coordinate(size) if inside else (low + high) / 2.0


def free_coordinates(scene: Scene, free: Iterable[str]) -> tuple[Coordinate, ...]:
    """Return the coordinates of the numbers whose names are in `free`."""
    if isinstance(free, str):
        raise WrongTypeError(f"free must be a sequence of names, got the text {free!r}")
    known, names = list(flatten(parts(scene))), list(free)
    if not names or len(set(names)) < len(names):
        raise ValueError(f"free must name at least one number of the scene, and no number twice, got {names}")
    coordinates = []
    for name in names:
        if name not in known:
            near = get_close_matches(str(name), known, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"free: the scene has no number {name!r}{hint}; it has {', '.join(known)}")
        if (value := get(scene, name)) == 0.0:
            raise ValueError(f"free: {name} must not be 0 in the scene, as the search uses its logarithm: give a guess")
        searched = SEARCHED.get(name, (abs(value) / SEARCH_FACTOR, abs(value) * SEARCH_FACTOR))
        on_spring = name == MASS and scene.coupling.oscillator(scene.tool.mass)
        wall = WALL * scene.tool.mass if on_spring else math.inf
        coordinates.append(Coordinate(name, math.copysign(1.0, value), searched, wall))
    return tuple(coordinates)


def tool_acceleration(scene: Scene, trace: Trace) -> Array:
    """Return the tool's acceleration (n,), m/s^2, from the forces on it and on all bodies fixed to it."""
    robot = scene.robot.at(scene.object.distance) if isinstance(scene.robot, RobotTable) else scene.robot
    mass = scene.tool.mass + (robot.mass if robot and scene.coupling.fixed else 0.0)
    return np.asarray((trace.coupling_force - trace.contact_force) / mass)


class Model:
    """Predicted samples and residuals of all logs."""

    def __init__(
        self, logs: Sequence[Log], scene: Scene, motions: Sequence[Trapezoid], sensors: Mapping[str, Sensor],
        free: Sequence[Coordinate],
    ) -> None:  # fmt: skip
        self.logs, self.scene, self.motions, self.sensors, self.free = logs, scene, motions, sensors, free
        self.samples, self.size = 0, len(free) + len(logs)
        self.slots, self.bias_indices = dict[Column, slice](), dict[Column, int]()  # sample slices; bias indices in x
        for k, log in enumerate(logs):
            for name in log.columns:
                self.slots[k, name] = slice(self.samples, self.samples + len(log.time))
                self.samples += len(log.time)
                if sensors[name].bias == "estimated":
                    self.bias_indices[k, name] = self.size
                    self.size += 1
        self.measured = np.concatenate([values for log in logs for values in log.columns.values()])
        self.noise = dict[str, float]()  # standard deviation in each column, given by the sensor or estimated
        for name, sensor in sensors.items():
            columns = [log.columns[name] for log in logs if name in log.columns]
            least = 1e-6 * max(float(np.ptp(values) or np.abs(values).max()) for values in columns)
            self.noise[name] = max(float(np.mean([noise_of(values, sensor) for values in columns])), least)
        self._cache: tuple[bytes, tuple[Array, Array]] = (b"", (np.empty(0), np.empty(0)))

    def of_first_blow(self) -> "Model":
        """Return a model of first blows: a log whose force has several blows is cut between the first two."""
        logs = []
        for log in self.logs:
            blows = bursts(log.columns["force"], self.sensors["force"]) if "force" in log.columns else []
            end = (blows[0][1] + blows[1][0]) // 2 + 1 if len(blows) > 1 else len(log.time)
            columns = {name: values[:end] for name, values in log.columns.items()}
            logs.append(Log(log.name, log.time[:end], columns))
        model = Model(logs, self.scene, self.motions, self.sensors, self.free)
        model.noise = dict(self.noise)
        return model

    def scene_at(self, x: Array) -> Scene:
        """Return the scene with its free numbers set to those of x."""
        return replaced(self.scene, {each.name: each.number(u) for each, u in zip(self.free, x, strict=False)})

    def trace(self, scene: Scene, k: int, duration: float) -> Trace:
        """Simulate `scene` with the motion of log k."""
        trace = simulate(scene, self.motions[k], duration, RTOL, trace=True).trace
        assert trace is not None
        return trace

    def latest(self, scene: Scene, k: int) -> float:
        """Return the latest time (s) after the start of the motion at which log k may end."""
        motion, time = self.motions[k], self.logs[k].time
        arrival = 2.0 * scene.object.distance / motion.speed + motion.speed / motion.acceleration
        return arrival + scene.coupling.response_time(scene.tool.mass) + float(time[-1] - time[0])

    def sensed(self, scene: Scene, trace: Trace, name: str, at: Array) -> tuple[Array, Array]:
        """Return a column's readings without bias, and their rates, at the times `at` (n,), in s from motion start."""
        sensor = self.sensors[name]
        if name == "tool_acceleration":
            values = tool_acceleration(scene, trace)
        elif name == "object_acceleration":  # an object at rest stays at rest until the force exceeds friction
            values = trace.contact_force / scene.object.mass - (scene.object.friction or 0.0) * GRAVITY
            values = np.where(trace.object_velocity > 0.0, values, np.maximum(values, 0.0))
        else:
            values = getattr(trace, "contact_force" if name == "force" else name)
        if sensor.cell:
            values = values + sensor.cell.mass * tool_acceleration(scene, trace)
        return sensor.senses(trace.time, values, at)

    def predicted(self, x: Array) -> tuple[Array, Array]:
        """Return all predicted samples (n,) without biases, and the time derivatives of these samples (n,)."""
        key = x[: len(self.free) + len(self.logs)].tobytes()
        if self._cache[0] != key:
            self._cache = key, self._predict(x)
        return self._cache[1]

    def _predict(self, x: Array) -> tuple[Array, Array]:
        values, slopes = np.zeros(self.samples), np.zeros(self.samples)
        try:
            scene = self.scene_at(x)
            for k, log in enumerate(self.logs):
                at = log.time - x[len(self.free) + k]
                if at[-1] > self.latest(scene, k):
                    raise ValueError("the log begins after the blow")
                trace = self.trace(scene, k, max(float(at[-1]), log.step))
                for name in log.columns:
                    values[self.slots[k, name]], slopes[self.slots[k, name]] = self.sensed(scene, trace, name, at)
        except (ValueError, RuntimeError):  # the scene or the start is invalid, or the simulation fails
            for (k, name), slot in self.slots.items():
                values[slot], slopes[slot] = IMPOSSIBLE * np.ptp(self.logs[k].columns[name]), 0.0
        return values, slopes

    def biases(self, x: Array) -> Array:
        """Return the bias of each sample (n,)."""
        bias = np.zeros(self.samples)
        for (k, name), slot in self.slots.items():
            bias[slot] = x[self.bias_indices[k, name]] if (k, name) in self.bias_indices else self.sensors[name].bias
        return bias

    def scales(self) -> Array:
        """Return the noise of each sample (n,)."""
        return np.concatenate([np.full_like(self.logs[k].time, self.noise[name]) for k, name in self.slots])

    def residuals(self, x: Array) -> Array:
        """Return (predicted - measured) / noise of all samples (n,)."""
        return (self.predicted(x)[0] + self.biases(x) - self.measured) / self.scales()

    def jacobian(self, x: Array, skip: int | None = None) -> Array:
        """Return the derivatives of `residuals` with respect to x (n, size); the column of x[skip] stays 0."""
        here, slopes = self.predicted(x)
        columns = np.zeros((self.samples, self.size))
        for i, coordinate in enumerate(self.free):
            if i != skip:
                step = -STEP if x[i] + STEP > coordinate.reach[1] else STEP  # beyond `reach`, `number` is constant
                there = x.copy()
                there[i] += step
                columns[:, i] = (self._predict(there)[0] - here) / step
        for (k, name), slot in self.slots.items():
            columns[slot, len(self.free) + k] = -slopes[slot]
            if (k, name) in self.bias_indices:
                columns[slot, self.bias_indices[k, name]] = 1.0
        return columns / self.scales()[:, None]
