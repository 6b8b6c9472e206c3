"""The logs as our simulator has them: predictions, residuals over the noise, and how they change with what is free."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from impact_gym.identify.coordinates import Coordinate
from impact_gym.identify.log import Log
from impact_gym.identify.sensor import Array, Sensor, bursts, noise_of
from impact_gym.motion import Trapezoid
from impact_gym.outcome import Trace
from impact_gym.physics.impact import GRAVITY
from impact_gym.scene import Rigid, RobotTable, Scene, SpringDamper
from impact_gym.simulation import simulate
from impact_gym.task.paths import replaced

RTOL = 1e-8
STEP = 2e-3
"""Of a coordinate, for forward differences: what the curvature adds to a slope, a thousandth of it, and what the
simulator's steps and the interpolation between them add, are both lost in a noise of a percent. As slopes by start and
bias cost nothing, a fit takes up to 30 % fewer simulations than with SciPy's "2-point" and less than half of its
"3-point", to the same minimum. The batch simulator records no motion but its end and cannot give these differences."""
IMPOSSIBLE = 1e3  # times its size is what a log is off a scene that cannot be
TRACED = {"force": "contact_force"}  # column of a log: that of a trace, where the two have not the same name


def tool_acceleration(scene: Scene, trace: Trace) -> Array:
    """Return the tool's acceleration (n,), m/s^2, from the forces on it and on what is fixed to it."""
    robot = scene.robot.at(scene.object.distance) if isinstance(scene.robot, RobotTable) else scene.robot
    mass = scene.tool.mass + (robot.mass if robot and isinstance(scene.coupling, Rigid) else 0.0)
    return np.asarray((trace.coupling_force - trace.contact_force) / mass)


@dataclass(eq=False)
class Model:
    """Residuals of all logs as a function of x: free coordinates, start of each motion (s), biases that are estimated.

    `noise` are the standard deviations of each column, the same in all logs.
    """

    logs: Sequence[Log]
    scene: Scene
    motions: Sequence[Trapezoid]
    sensors: Mapping[str, Sensor]
    free: Sequence[Coordinate]
    noise: dict[str, float]
    simulations: int = 0

    def __post_init__(self) -> None:
        columns = [(k, name) for k, log in enumerate(self.logs) for name in log.columns]
        self.biased = [(k, name) for k, name in columns if self.sensors[name].bias == "estimated"]
        self.size = len(self.free) + len(self.logs) + len(self.biased)
        ends = np.cumsum([len(self.logs[k].time) for k, _ in columns])
        self.samples = int(ends[-1])
        begins = [0, *ends[:-1]]
        self.slots = {key: slice(begin, end) for key, begin, end in zip(columns, begins, ends, strict=True)}
        self.measured = np.concatenate([values for log in self.logs for values in log.columns.values()])
        self._cache: tuple[bytes, tuple[Array, Array]] = (b"", (np.empty(0), np.empty(0)))

    @classmethod
    def of(
        cls, logs: Sequence[Log], scene: Scene, motions: Sequence[Trapezoid], sensors: Mapping[str, Sensor],
        free: Sequence[Coordinate],
    ) -> "Model":  # fmt: skip
        """Return the model with the noise that is known, or seen in the logs; never nothing."""
        noise = {}
        for name, sensor in sensors.items():
            columns = [log.columns[name] for log in logs if name in log.columns]
            least = 1e-6 * max(float(np.ptp(values) or np.abs(values).max()) for values in columns)
            noise[name] = max(float(np.mean([noise_of(values, sensor) for values in columns])), least)
        return cls(logs, scene, motions, sensors, free, noise)

    def of_first_blow(self) -> "Model":
        """Return the model of the logs up to the end of the first blow, where they have a force."""
        logs = []
        for log in self.logs:
            blows = bursts(log.columns["force"], self.sensors["force"]) if "force" in log.columns else []
            end = (blows[0][1] + blows[1][0]) // 2 + 1 if len(blows) > 1 else len(log.time)
            columns = {name: values[:end] for name, values in log.columns.items()}
            logs.append(Log(log.name, log.time[:end], columns))
        return Model(logs, self.scene, self.motions, self.sensors, self.free, dict(self.noise))

    def numbers(self, x: Array) -> dict[str, float]:
        """Return the free numbers of the scene."""
        return {coordinate.name: coordinate.number(u) for coordinate, u in zip(self.free, x, strict=False)}

    def scene_at(self, x: Array) -> Scene:
        """Return the scene with these numbers."""
        return replaced(self.scene, self.numbers(x))

    def trace(self, scene: Scene, k: int, duration: float) -> Trace:
        """Simulate the motion behind log k."""
        self.simulations += 1
        trace = simulate(scene, self.motions[k], duration, RTOL, trace=True).trace
        assert trace is not None
        return trace

    def latest(self, scene: Scene, k: int) -> float:
        """Return the latest time (s) of the motion at which log k may end.

        It begins before the flange has gone twice the distance to the object, and the tool has followed on its spring.
        """
        motion, log = self.motions[k], self.logs[k]
        arrival = 2.0 * scene.object.distance / motion.speed + motion.speed / motion.acceleration
        if isinstance(spring := scene.coupling, SpringDamper):
            arrival += 2.0 * np.pi * max(spring.damping_ratio, 1.0) * (scene.tool.mass / spring.stiffness) ** 0.5
        return arrival + float(log.time[-1] - log.time[0])

    def sensed(self, scene: Scene, trace: Trace, name: str, at: Array) -> tuple[Array, Array]:
        """Return what the sensor of a column reads `at` (n,) s of the motion, and its slope."""
        sensor = self.sensors[name]
        if name == "tool_acceleration":
            values = tool_acceleration(scene, trace)
        elif name == "object_acceleration":
            drag = (scene.object.friction or 0.0) * GRAVITY  # where it stands the ground gives way no sooner
            values = trace.contact_force / scene.object.mass - drag
            values = np.where(trace.object_velocity > 0.0, values, np.maximum(values, 0.0))
        else:
            values = getattr(trace, TRACED.get(name, name))
        if sensor.cell:
            values = values + sensor.cell.mass * tool_acceleration(scene, trace)
        return sensor.senses(trace.time, values, at)

    def predicted(self, x: Array) -> tuple[Array, Array]:
        """Return all columns of all logs (n,) without their biases, and their slopes in time."""
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
                    raise ValueError("the log begins when the blow is over")
                trace = self.trace(scene, k, max(float(at[-1]), log.step))
                for name in log.columns:
                    values[self.slots[k, name]], slopes[self.slots[k, name]] = self.sensed(scene, trace, name, at)
        except (ValueError, RuntimeError):  # no such scene or start, or the simulator cannot finish it
            for (k, name), slot in self.slots.items():
                values[slot], slopes[slot] = IMPOSSIBLE * np.ptp(self.logs[k].columns[name]), 0.0
        return values, slopes

    def biases(self, x: Array) -> Array:
        """Return the bias of each sample (n,)."""
        bias = np.zeros(self.samples)
        for (k, name), slot in self.slots.items():
            known = self.sensors[name].bias
            bias[slot] = x[self.bias_place(k, name)] if known == "estimated" else known
        return bias

    def bias_place(self, k: int, name: str) -> int:
        """Return which entry of x is the bias of a column of log k."""
        return len(self.free) + len(self.logs) + self.biased.index((k, name))

    def scales(self) -> Array:
        """Return the noise of each sample (n,)."""
        return np.concatenate([np.full_like(self.logs[k].time, self.noise[name]) for k, name in self.slots])

    def residuals(self, x: Array) -> Array:
        """Return predicted less measured, over the noise (n,)."""
        return (self.predicted(x)[0] + self.biases(x) - self.measured) / self.scales()

    def jacobian(self, x: Array, skip: int | None = None) -> Array:
        """Return the derivatives of `residuals` by x (n, size), differences in part, without x[skip]."""
        here, slopes = self.predicted(x)
        columns = np.zeros((self.samples, self.size))
        for i, number in enumerate(self.free):
            if i != skip:
                step = -STEP if x[i] + STEP > number.reach[1] else STEP  # beyond its reach nothing moves
                there = x.copy()
                there[i] += step
                columns[:, i] = (self._predict(there)[0] - here) / step
        for (k, name), slot in self.slots.items():
            columns[slot, len(self.free) + k] = -slopes[slot]
            if (k, name) in self.biased:
                columns[slot, self.bias_place(k, name)] = 1.0
        return columns / self.scales()[:, None]
