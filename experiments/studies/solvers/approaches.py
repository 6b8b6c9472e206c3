"""Approaches for the studies `speed` and `stability`: six named approaches, and random approaches."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple, get_args

import numpy as np

import impact_gym as ig
from experiments.lab.scenes import DISTANCE, MOTION, scene
from impact_gym.couplings import Coupling
from impact_gym.robot import default_approach
from impact_gym.scene import Dissipation

CRUISE = ig.Trapezoid(1.0, 8.0, ig.Brake(threshold=1.0, delay=10.0))  # the brake would act only after the end of a run
SEED = 4  # of the random approaches

RANGES = {  # ranges of random numbers of a scene, in which the solver must work
    "contact stiffness": (1e2, 1e10),  # N/m^m, m: exponent of the stiffness
    "restitution": (1e-3, 1.0),
    "mass ratio": (1e-3, 1e3),  # -, ratio of the object's mass to the tool's mass
    "speed": (0.01, 5.0),  # m/s
    "coupling stiffness": (1.0, 1e5),  # N/m, of a spring and damper or of a mechanism
    "damping ratio": (0.0, 3.0),  # of a spring and damper or of a stop
    "deceleration": (0.5, 50.0),  # m/s^2, of the brake
}
OTHERS = {  # ranges of further random numbers of a scene; we chose these ranges
    "tool mass": (0.01, 10.0),  # kg
    "acceleration": (0.5, 50.0),  # m/s^2
    "distance": (0.05, 0.35),  # m
    "threshold": (0.1, 10.0),  # N, of the alarm
    "delay": (0.0, 0.05),  # s, of the brake after the alarm
    "free length": (0.01, 0.3),  # m, of a mechanism
    "stop stiffness": (1e4, 1e6),  # N/m
    "robot mass": (0.5, 50.0),  # kg
    "robot stiffness": (1e3, 1e6),  # N/m
    "robot damping": (1.0, 1e3),  # N s/m
    "friction": (1e-3, 3.0),  # -, coefficient of friction between object and ground
    "reference velocity": (0.01, 5.0),  # m/s, of a contact with "fixed" dissipation
    "stroke over rest": (1.01, 30.0),  # -, ratio of a spring's stroke to its steady deflection during acceleration
}
EXPONENTS = (*((1.5, 1.5),) * 6, (1.0, 0.0), (1.0, 1.0), (2.0, 2.0), (1.5, 1.0), (1.2, 1.2), (3.0, 0.0))
ROUGH = 0.25  # probability of friction, of "fixed" dissipation, and of a limited travel of a spring
AT_AN_END = 0.05  # fraction of the draws from RANGES that return an end of the range
AFTERMATH = 0.5  # s, a run goes on for at least this time after an unbraked flange would reach the object


class Approach(NamedTuple):
    """An approach from rest, simulated for `duration` (s): the first arguments of `simulate`."""

    scene: ig.Scene
    motion: ig.Trapezoid
    duration: float

    @property
    def about(self) -> dict[str, Any]:
        """The columns of a table that describe the approach."""
        return {"coupling": kind(self.scene), "speed": self.motion.speed}


class Solution(NamedTuple):
    """A solver's answer for an approach. A float is nan if the solver does not give it."""

    velocity: float  # m/s, V_p
    peak_force: float = math.nan  # N
    contact_duration: float = math.nan  # s, sum over all contacts, up to the end of the run
    detection_time: float = math.nan  # s; nan: there was no alarm
    contacts: int = 0
    passes: int = 0  # number of times that the slider passes its alignment

    @classmethod
    def of(cls, outcome: Any, duration: float) -> "Solution":
        """Return the solution in an outcome of `ig.simulate` or `reference.simulate`; the run lasted `duration` (s)."""
        lasted = sum((duration if contact.end is None else contact.end) - contact.start for contact in outcome.contacts)
        detection = math.nan if outcome.detection_time is None else outcome.detection_time
        counts = len(outcome.contacts), len(outcome.snap_through)
        return cls(outcome.object_velocity, outcome.peak_force, lasted, detection, *counts)


def kind(of: ig.Scene) -> str:
    """Return the names of the coupling and of the robot of a scene."""
    couplings = {ig.Rigid: "rigid", ig.SpringDamper: "spring", ig.Bistable: "bistable"}
    robots = {ig.Robot: ", robot", ig.RobotTable: ", robot table", type(None): ""}
    return couplings[type(of.coupling)] + robots[type(of.robot)]


def named() -> dict[str, tuple[str, Approach]]:
    """Return the six named approaches, by name, each with a description."""
    soft, spring = ig.SpringDamper(50.0), ig.SpringDamper(150.0)
    # as in Fig. 23, but just below 0.97724 m/s; above this speed the slider stays past its alignment
    below = replace(MOTION, speed=0.9772)
    distance = below.speed**2 / (2 * MOTION.acceleration) + below.speed * (DISTANCE - 1 / (2 * MOTION.acceleration))
    held, heavy = scene(1e3, 0.1, ig.Bistable(), distance=distance), scene(1e6, 1.0, spring, object_mass=1.0)
    stiff, slow = (
        "k_c 1e8, e 0.7, spring 50 N/m: two short contacts",
        "k_c 1e8, e 0.1, no brake: the second contact is slow",
    )
    return {
        "soft": ("k_c 1e3, e 0.7, spring 50 N/m", Approach(scene(1e3, 0.7, soft), MOTION, 1.5)),
        "stiff": (stiff, Approach(scene(1e8, 0.7, soft), MOTION, 1.5)),
        "inelastic": ("k_c 1e5, e 0.02 (d = 73.5), spring 50 N/m", Approach(scene(1e5, 0.02, soft), MOTION, 1.5)),
        "multiple": ("k_c 1e6, e 1, spring 150 N/m, object 1 kg: six contacts", Approach(heavy, MOTION, 1.5)),
        "pushed": (slow, Approach(scene(1e8, 0.1, spring), CRUISE, 0.8)),
        "bistable": ("bistable, 4e-5 m/s below its threshold", Approach(held, below, 1.5)),
    }


class _Draw:
    """Random draws for one approach."""

    def __init__(self, *numbers: int) -> None:
        self.rng = np.random.default_rng([SEED, *numbers])
        self.share = self.rng.uniform

    def value(self, name: str) -> float:
        """Draw log-uniformly, or uniformly if the range begins at 0. Some draws from RANGES are an end of the range."""
        low, high = RANGES.get(name) or OTHERS[name]
        u, end = map(float, self.rng.random(2))
        if name in RANGES and end < AT_AN_END:
            return low if end < AT_AN_END / 2 else high
        if low == 0.0:
            return high * u
        return min(max(math.exp(math.log(low) + u * math.log(high / low)), low), high)

    def mechanism(self) -> ig.Bistable:
        length = self.value("free length")
        height = self.share(0.2, 0.9) * length
        stroke = math.sqrt((length - height) * (length + height))
        front, rear = self.share(0.1, 0.9) * stroke, -self.share(0.1, 0.9) * stroke
        spring, stop = self.value("coupling stiffness"), self.value("stop stiffness")
        return ig.Bistable(spring, length, height, front, rear, stop, self.value("damping ratio"))

    def robot(self) -> list[float]:
        return [self.value(f"robot {name}") for name in ("mass", "stiffness", "damping")]

    def robot_table(self, distance: float) -> ig.RobotTable:
        """Return the shipped robot, or a robot whose parameters change by a factor of at most about two on the path."""
        if self.share(0, 1) < 0.25:
            return default_approach().robot_table()
        way = np.linspace(0.0, 1.0, 6)
        start = np.array(self.robot())[:, None]
        slopes = self.rng.uniform(-1, 1, (3, 2))
        columns = (start * np.exp(0.5 * slopes[:, :1] * way + 0.2 * slopes[:, 1:] * way**2)).tolist()
        return ig.RobotTable(tuple((1.2 * distance * way).tolist()), *map(tuple, columns))


def random_approach(number: int) -> Approach:
    """Return the approach `number`; nine successive approaches have all combinations of coupling and robot."""
    draw, rough = _Draw(number), _Draw(number, 1)

    def is_rough() -> bool:
        return rough.share(0, 1) < ROUGH

    tool, friction = ig.Tool(draw.value("tool mass")), rough.value("friction") if is_rough() else None
    target = ig.Object(tool.mass * draw.value("mass ratio"), draw.value("distance"), friction)
    m, n = EXPONENTS[draw.rng.integers(len(EXPONENTS))]
    laws = [law for law in get_args(Dissipation) if law != "fixed"]
    law: Dissipation = laws[draw.rng.integers(len(laws))] if draw.share(0, 1) < 0.5 else "hu-guo"
    contact = ig.Contact(draw.value("contact stiffness"), draw.value("restitution"), law, m, n)
    if is_rough():
        contact = replace(contact, dissipation="fixed", reference_velocity=rough.value("reference velocity"))
    couplings: tuple[Callable[[], Coupling], ...] = (
        ig.Rigid,
        lambda: ig.SpringDamper(draw.value("coupling stiffness"), draw.value("damping ratio")),
        draw.mechanism,
    )
    coupling = couplings[number % 3]()
    robots = (lambda: None, lambda: ig.Robot(*draw.robot()), lambda: draw.robot_table(target.distance))
    robot = robots[number // 3 % 3]()
    brakes = draw.share(0, 1) < 0.8
    brake = ig.Brake(*map(draw.value, ("threshold", "delay", "deceleration"))) if brakes else None
    motion = ig.Trapezoid(draw.value("speed"), draw.value("acceleration"), brake)
    if isinstance(coupling, ig.SpringDamper) and is_rough():
        rest = tool.mass * motion.acceleration / coupling.stiffness
        coupling = replace(coupling, stroke=rest * rough.value("stroke over rest"))
    duration = target.distance / motion.speed + motion.speed / motion.acceleration + AFTERMATH
    return Approach(ig.Scene(tool, target, contact, coupling, robot), motion, duration)
