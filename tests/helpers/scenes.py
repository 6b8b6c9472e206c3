"""The paper's tool, object, distance and motion, of which a test changes what it is about."""

import numpy as np

import impact_gym as ig

CRUISE = ig.Trapezoid(1.0, 8.0)
MOTION = ig.Trapezoid(1.0, 8.0, ig.Brake())


def scene(k_c=1e5, e=0.5, coupling=None, robot=None, *, m_t=0.125, m_p=0.25, distance=0.2505, **law):
    contact = ig.Contact(k_c, e, **law)
    return ig.Scene(ig.Tool(m_t), ig.Object(m_p, distance), contact, coupling or ig.Rigid(), robot)


def log_uniform(random, low, high):
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def time_unit(scene, contact):
    """t0 of a contact (s), with the flange as heavy as it may be."""
    mass, v = scene.object.mass, contact.approach_velocity
    if not isinstance(scene.coupling, ig.Rigid):
        mass = mass * scene.tool.mass / (mass + scene.tool.mass)
    return (mass * v**2 / scene.contact.stiffness) ** (1 / (scene.contact.stiffness_exponent + 1)) / v
