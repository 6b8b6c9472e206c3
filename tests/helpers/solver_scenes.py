"""The paper's tool, object, distance and motion; and random approaches."""

import math
from dataclasses import replace
from functools import partial

import numpy as np

import impact_gym as ig
from impact_gym.support import dotted_paths

CRUISE = ig.Trapezoid(1.0, 8.0)
MOTION = ig.Trapezoid(1.0, 8.0, ig.Brake())
NODES = np.linspace(0.0, 0.35, 6)
TABLE = ig.RobotTable(*map(tuple, [NODES, 4 + 3 * NODES**2, 1.5e5 * (1 + NODES), 40 + 100 * NODES]))
SPRING, LINEAR = ig.SpringDamper(150.0), ig.SpringDamper(50.0)
COUPLINGS = {"rigid": ig.Rigid(), "spring": ig.SpringDamper(150.0, 0.5), "bistable": ig.Bistable()}
ROBOT = ig.Robot(5.225, 1.9e5, 50.4)
ROBOTS = {"rigid robot": None, "robot": ig.Robot(5.0, 1.5e5, 50.0), "robot table": TABLE}
EXPONENTS = [(1.5, 1.5), (1.5, 1.5), (1.0, 0.0), (1.2, 1.2), (2.0, 2.0)]


def scene(k_c=1e5, e=0.5, coupling=None, robot=None, *, m_t=0.125, m_p=0.25, distance=0.2505, friction=None, **law):
    target, contact = ig.Object(m_p, distance, friction), ig.Contact(k_c, e, **law)
    return ig.Scene(ig.Tool(m_t), target, contact, coupling or ig.Rigid(), robot)


def with_every_number(coupling, robot=ROBOT, **law):
    """Scene and motion as records by name, in which no number is None."""
    chain = replace(scene(1e4, 0.5, coupling, robot, **law), object=ig.Object(0.25, 0.1, 0.1))
    return {**dotted_paths.parts(chain), "motion": ig.Trapezoid(1.0, 8.0, ig.Brake(deceleration=5.0))}


def split(records):
    """The scene and the motion."""
    return ig.Scene(**{name: record for name, record in records.items() if name != "motion"}), records["motion"]


def log_uniform(random, low, high):
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def random_mechanism(random):
    length = 0.07
    height = random.uniform(0.3, 0.8) * length
    stroke = math.sqrt(length**2 - height**2)
    front, rear = random.uniform(0.1, 0.8) * stroke, -random.uniform(0.1, 0.8) * stroke
    stop = log_uniform(random, 1e4, 1e6), random.uniform(0.3, 2)
    return ig.Bistable(log_uniform(random, 20, 200), length, height, front, rear, *stop)


def random_approach(seed, coupling="any", robot="rigid robot", laws=("hu-guo",), springs=(20.0, 300.0)):
    """Scene, motion and duration of an approach that ends well after its first contact.

    The coupling "any" is rigid or a spring with a stiffness in `springs`, N/m. If there are several laws, the exponents
    are drawn, too.
    """
    random = np.random.default_rng([2027, seed])
    log = partial(log_uniform, random)
    if coupling == "any":
        coupling = "spring" if random.random() < 0.8 else "rigid"
    spring, mechanism = ig.SpringDamper(log(*springs), random.uniform(0, 3)), random_mechanism(random)
    couplings = {"rigid": ig.Rigid(), "spring": spring, "bistable": mechanism}
    robots = ROBOTS | {"robot": ig.Robot(log(1, 10), log(1e4, 5e5), log(20, 200))}
    m, n = EXPONENTS[random.integers(len(EXPONENTS)) if len(laws) > 1 else 0]
    contact = ig.Contact(log(1e3, 1e6), random.uniform(0.1, 1), laws[random.integers(len(laws))], m, n)
    target = ig.Object(log(0.05, 2.5), random.uniform(0.05, 0.15))
    brakes, brake = random.random() < 0.85, ig.Brake(log(0.05, 20), random.uniform(0, 0.03), random.uniform(1, 20))
    motion = ig.Trapezoid(random.uniform(0.3, 1.5), random.uniform(4, 20), brake if brakes else None)
    chain = ig.Scene(ig.Tool(log(0.05, 0.5)), target, contact, couplings[coupling], robots[robot])
    return chain, motion, target.distance / motion.speed + motion.speed / motion.acceleration + 0.25


def on_rough_ground(seed, *features):
    """A random approach of any chain. Features: friction under the object, a stroke of the spring, a fixed damping."""
    random = np.random.default_rng([2028, seed])
    kind = "spring" if "stroke" in features else ("any", "spring", "bistable", "rigid")[seed % 4]
    chain, motion, duration = random_approach(seed, kind, [*ROBOTS][seed // 4 % 3])
    if "friction" in features:
        chain = replace(chain, object=replace(chain.object, friction=log_uniform(random, 0.01, 3.0)))
    if "stroke" in features:  # longer than the deflection under the arm's own acceleration
        rest = motion.acceleration * chain.tool.mass / chain.coupling.stiffness
        chain = replace(chain, coupling=replace(chain.coupling, stroke=rest + log_uniform(random, 1e-3, 3e-2)))
    if "fixed" in features:
        m, n = (*EXPONENTS, (1.5, 1.0))[seed % 6]
        contact = replace(chain.contact, dissipation="fixed", stiffness_exponent=m, damping_exponent=n)
        chain = replace(chain, contact=replace(contact, reference_velocity=log_uniform(random, 0.05, 2.0)))
    return chain, motion, duration


def stored_energy(coupling, stretch):
    """Energy of a coupling and its stops (J), by its textbook form."""
    if isinstance(coupling, ig.Rigid):
        return 0.0 * stretch
    if isinstance(coupling, ig.SpringDamper):
        beyond = np.maximum(np.abs(stretch) - (coupling.stroke or np.inf), 0.0)
        return 0.5 * coupling.stiffness * stretch**2 + 0.5e5 * beyond**2
    x = coupling.rest + stretch
    beyond = np.maximum(np.maximum(x - coupling.front_stop, coupling.rear_stop - x), 0.0)
    spring = 0.5 * coupling.stiffness * (coupling.free_length - np.hypot(coupling.height, x)) ** 2
    return spring + 0.5 * coupling.stop_stiffness * beyond**2
