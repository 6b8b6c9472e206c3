"""Random scenes to calibrate on and to test with: every coupling, robot, contact law and exponent."""

import math
from typing import Literal

import numpy as np

import impact_gym as ig
from impact_gym.robot import default_approach

Kind = Literal["plausible", "limits"]
LAWS = (
    "hu-guo", "exact", "flores", "gonthier", "hunt-crossley", "lankarani-nikravesh", "herbert-mcwhannell",
)  # fmt: skip
EXPONENTS = (*((1.5, 1.5),) * 5, (1.0, 0.0), (1.0, 1.0), (2.0, 2.0), (1.5, 1.0))
LENGTH = 0.5  # m, of a random robot's table


def draw(kind: Kind, purpose: int, number: int) -> tuple[ig.Scene, ig.Trapezoid]:
    """Return scene `number` of a population; `purpose` keeps those of calibration and test apart.

    "plausible" holds what a tool of 50 to 500 g may meet. "limits" goes on where reductions become exact: contacts up
    to a hundred times stiffer, springs ten times softer, robots ten times heavier, stiffer and less variable.
    """
    rng = np.random.default_rng([purpose, number, int(kind == "limits")])
    far = kind == "limits"
    speed, acceleration = float(rng.uniform(0.3, 1.5)), float(rng.uniform(4, 15))
    tool, target = ig.Tool(_log(rng, 0.05, 0.5)), ig.Object(_log(rng, 0.05, 2.5), float(rng.uniform(0.1, 0.3)))
    brake = None
    if rng.random() < 0.8:
        brake = ig.Brake(1.0, float(rng.uniform(0, 0.03)), float(rng.uniform(4, 20)))
    motion = ig.Trapezoid(speed, acceleration, brake)
    contact = _contact(rng, _log(rng, 1e3, 1e8 if far else 1e6), target.mass * speed**2)
    coupling: ig.Rigid | ig.SpringDamper | ig.Bistable = ig.Rigid()
    choice = rng.integers(3)
    if choice == 1:
        coupling = ig.SpringDamper(_log(rng, 1 if far else 10, 2000), float(rng.uniform(0, 2)))
    if choice == 2:
        coupling = _mechanism(rng, tool.mass * acceleration)
    return ig.Scene(tool, target, contact, coupling, _robot(rng, far)), motion


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _contact(rng: np.random.Generator, stiffness: float, energy: float) -> ig.Contact:
    """A contact as stiff as one of m = 3/2 with `stiffness` at the penetration that `energy` (J) gives that one."""
    m, n = EXPONENTS[rng.integers(len(EXPONENTS))]
    law = LAWS[rng.integers(len(LAWS))] if m == n or (m, n) == (1.0, 0.0) else "hu-guo"
    scale = (energy / stiffness) ** (0.4 * (1.5 - m))
    return ig.Contact(stiffness * scale, float(rng.uniform(0.05, 1)), law, m, n)  # type: ignore[arg-type]


def _mechanism(rng: np.random.Generator, ramp_force: float) -> ig.Bistable:
    """A mechanism whose preload is 0.8 to 8 times what the ramp needs to carry the tool."""
    length = 0.07
    height = float(rng.uniform(0.3, 0.8)) * length
    stroke = math.sqrt(length**2 - height**2)
    front, rear = float(rng.uniform(0.1, 0.8)) * stroke, -float(rng.uniform(0.1, 0.8)) * stroke
    unit = float(ig.Bistable(1.0, length, height, front, rear).force(front))
    stiffness = _log(rng, 0.8, 8.0) * ramp_force / unit
    return ig.Bistable(stiffness, length, height, front, rear, _log(rng, 1e4, 1e6), float(rng.uniform(0.2, 2)))


def _robot(rng: np.random.Generator, far: bool) -> ig.Robot | ig.RobotTable | None:
    choice = rng.integers(3)
    if choice == 0:
        return None
    mass, stiffness = _log(rng, 1, 100 if far else 10), _log(rng, 1e4, 5e6 if far else 5e5)
    damping = 2.0 * _log(rng, 0.01, 0.3) * math.sqrt(mass * stiffness)
    if choice == 1:
        return ig.Robot(mass, stiffness, damping)
    if rng.random() < 0.25:
        return default_approach().robot_table()
    way = np.linspace(0.0, 1.0, 6)
    slopes = (0.1 if far else 1.0) * rng.uniform(-1, 1, (3, 2))
    shapes = np.exp(0.5 * slopes[:, :1] * way + 0.3 * slopes[:, 1:] * way**2)
    columns = (np.array([[mass], [stiffness], [damping]]) * shapes).tolist()
    return ig.RobotTable(tuple((LENGTH * way).tolist()), *(tuple(column) for column in columns))
