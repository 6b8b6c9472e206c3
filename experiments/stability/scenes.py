"""The storm: random scenes over the ranges in which the solver is to stand, scene k a pure function of the number k."""

import math
from collections.abc import Iterable, Mapping
from typing import Any, get_args

import numpy as np

import impact_gym as ig
from experiments.lab.tables import Row
from experiments.speed_vs_error.scenes import Approach
from impact_gym.robot import default_approach
from impact_gym.scene import Dissipation

SEED = 4  # of the storm
RANGES = {
    "contact stiffness": (1e2, 1e10),  # N/m^m
    "restitution": (1e-3, 1.0),
    "mass ratio": (1e-3, 1e3),  # object over tool
    "speed": (0.01, 5.0),  # m/s
    "coupling stiffness": (1.0, 1e5),  # N/m, of a spring and damper or of a mechanism
    "damping ratio": (0.0, 3.0),  # of a spring and damper or of a stop
    "deceleration": (0.5, 50.0),  # m/s^2, of the brake
}
"""What the storm must cover."""
OTHERS = {
    "tool mass": (0.01, 10.0),  # kg
    "acceleration": (0.5, 50.0),  # m/s^2
    "distance": (0.05, 0.35),  # m
    "threshold": (0.1, 10.0),  # N, of the alarm
    "delay": (0.0, 0.05),  # s, likewise
    "free length": (0.01, 0.3),  # m, of a mechanism
    "stop stiffness": (1e4, 1e6),  # N/m
    "robot mass": (0.5, 50.0),  # kg
    "robot stiffness": (1e3, 1e6),  # N/m
    "robot damping": (1.0, 1e3),  # N s/m
}
"""What a scene needs besides, over ranges of our own."""
EXPONENTS = (*((1.5, 1.5),) * 6, (1.0, 0.0), (1.0, 1.0), (2.0, 2.0), (1.5, 1.0), (1.2, 1.2), (3.0, 0.0))
AT_AN_END = 0.05  # share of draws from a range of the storm that are one of its ends
AFTERMATH = 0.5  # s, after the flange would reach the object


class _Draw:
    """Draws for one scene."""

    def __init__(self, number: int) -> None:
        self.rng = np.random.default_rng([SEED, number])
        self.share = self.rng.uniform

    def one(self, name: str) -> float:
        """A value of a range; log-uniform unless it begins at 0."""
        low, high = RANGES.get(name) or OTHERS[name]
        u, end = self.rng.random(2).tolist()
        if name in RANGES and end < AT_AN_END:
            return low if end < AT_AN_END / 2 else high
        if low == 0.0:
            return high * u
        return min(max(math.exp(math.log(low) + u * math.log(high / low)), low), high)

    def spring(self) -> ig.SpringDamper:
        return ig.SpringDamper(self.one("coupling stiffness"), self.one("damping ratio"))

    def mechanism(self) -> ig.Bistable:
        length = self.one("free length")
        height = self.share(0.2, 0.9) * length
        stroke = math.sqrt((length - height) * (length + height))
        front, rear = self.share(0.1, 0.9) * stroke, -self.share(0.1, 0.9) * stroke
        spring, stop = self.one("coupling stiffness"), self.one("stop stiffness")
        return ig.Bistable(spring, length, height, front, rear, stop, self.one("damping ratio"))

    def robot(self) -> list[float]:
        return [self.one(f"robot {name}") for name in ("mass", "stiffness", "damping")]

    def robot_table(self, distance: float) -> ig.RobotTable:
        """The shipped robot, or a random one that varies by up to a factor of two on the way to the object."""
        if self.share(0, 1) < 0.25:
            return default_approach().robot_table()
        way = np.linspace(0.0, 1.0, 6)
        start = np.array(self.robot())[:, None]
        slopes = self.rng.uniform(-1, 1, (3, 2))
        columns = (start * np.exp(0.5 * slopes[:, :1] * way + 0.2 * slopes[:, 1:] * way**2)).tolist()
        return ig.RobotTable(tuple((1.2 * distance * way).tolist()), *map(tuple, columns))


def draw(number: int) -> Approach:
    """Return scene `number` of the storm; every coupling comes with every robot."""
    draw = _Draw(number)
    tool = ig.Tool(draw.one("tool mass"))
    target = ig.Object(tool.mass * draw.one("mass ratio"), draw.one("distance"))
    m, n = EXPONENTS[draw.rng.integers(len(EXPONENTS))]
    laws: tuple[Dissipation, ...] = get_args(Dissipation)
    law: Dissipation = laws[draw.rng.integers(len(laws))] if draw.share(0, 1) < 0.5 else "hu-guo"
    contact = ig.Contact(draw.one("contact stiffness"), draw.one("restitution"), law, m, n)
    coupling = (ig.Rigid, draw.spring, draw.mechanism)[number % 3]()
    robots = (lambda: None, lambda: ig.Robot(*draw.robot()), lambda: draw.robot_table(target.distance))
    robot = robots[number // 3 % 3]()
    brakes = draw.share(0, 1) < 0.8
    brake = ig.Brake(*map(draw.one, ("threshold", "delay", "deceleration"))) if brakes else None
    motion = ig.Trapezoid(draw.one("speed"), draw.one("acceleration"), brake)
    duration = target.distance / motion.speed + motion.speed / motion.acceleration + AFTERMATH
    scene = ig.Scene(tool, target, contact, coupling, robot)
    return Approach(str(number), describe(scene, motion), scene, motion, duration)


def kind(scene: ig.Scene) -> str:
    """Return coupling and robot of a scene in words."""
    words = {ig.Rigid: "rigid", ig.SpringDamper: "spring", ig.Bistable: "bistable"}
    robots = {ig.Robot: ", robot", ig.RobotTable: ", robot table", type(None): ""}
    return words[type(scene.coupling)] + robots[type(scene.robot)]


def describe(scene: ig.Scene, motion: ig.Trapezoid) -> str:
    """Return what is hard about a scene in a line; `draw` gives it whole."""
    contact, coupling, robot = scene.contact, scene.coupling, scene.robot
    m, n = contact.stiffness_exponent, contact.damping_exponent
    words = [
        f"{kind(scene)}: k_c {contact.stiffness:.3g}, e {contact.restitution:.3g} ({contact.dissipation})",
        (m, n) != (1.5, 1.5) and f"m {m:g}, n {n:g}",
        f"m_t {scene.tool.mass:.3g} kg, m_p {scene.object.mass:.3g} kg, {motion.speed:.3g} m/s",
        isinstance(coupling, ig.SpringDamper) and f"k_t {coupling.stiffness:.3g}, zeta {coupling.damping_ratio:.3g}",
        isinstance(coupling, ig.Bistable)
        and f"k {coupling.stiffness:.3g}, k_s {coupling.stop_stiffness:.3g}, zeta_s {coupling.stop_damping_ratio:.3g}",
        isinstance(robot, ig.Robot) and f"m_r {robot.mass:.3g}, k_r {robot.stiffness:.3g}, c_r {robot.damping:.3g}",
        motion.brake and f"brake {motion.deceleration:.3g} m/s^2",
    ]
    return ", ".join(filter(None, words))


def labels(approach: Approach) -> Row:
    """Return the columns that say which scene a row is about."""
    first = {"scene": approach.name, "coupling": kind(approach.scene), "speed": approach.motion.speed}
    return first | {"description": approach.description, "failure": ""}


def known(arguments: Mapping[str, Any]) -> Row:
    """Return the row of a job that has no result, by its arguments: what is known of its scene."""
    return labels(draw(arguments["scene"])) | {"contender": arguments.get("contender", "")}


def judging(truths: Mapping[int, Row], columns: Iterable[str]) -> dict[int, Row]:
    """Return these columns of the truth, where there is one, by the number of the scene."""
    return {scene: {name: true[name] for name in columns} for scene, true in truths.items() if not true["failure"]}


def velocity(approach: Approach, rtol: float = 1e-8) -> float:
    """V_p of ours, m/s; nan if the run does not finish."""
    try:
        return ig.simulate(*approach.run, rtol).object_velocity
    except RuntimeError:
        return math.nan


def relative_error(value: float, true: float, speed: float) -> float:
    """Error of V_p, relative to V_p or to a millionth of the commanded speed: an object at rest has some rounding."""
    return abs(value - true) / max(abs(true), 1e-6 * speed)
