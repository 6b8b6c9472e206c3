"""From the records a user describes a scene with to the flat ones that the kernels read and are chosen by."""

import math

import numpy as np
from scipy.optimize import brentq

from impact_gym.physics import coupling as laws
from impact_gym.physics.bistable import force
from impact_gym.physics.contact import Force, Hertz, Power
from impact_gym.physics.coupling import Law
from impact_gym.physics.dissipation import damping_factor
from impact_gym.physics.robot import LumpedRobot, VaryingRobot
from impact_gym.scene import Bistable, Contact, Coupling, Rigid, Robot, RobotTable, SpringDamper


def contact_law(contact: Contact) -> Force:
    """Lower a contact; the Hertz contact has kernels of its own."""
    m, n = contact.stiffness_exponent, contact.damping_exponent
    damping = damping_factor(contact.dissipation, contact.restitution, m, n)
    if m == n == 1.5:
        return Hertz(contact.stiffness, damping)
    return Power(contact.stiffness, damping, m, n)


def chain_law(tool_mass: float, coupling: Coupling, robot: Robot | RobotTable | None = None) -> Law:
    """Lower what holds the tool to the simplest law that describes it."""
    if robot is None:
        if isinstance(coupling, Rigid):
            return laws.RigidLaw(tool_mass)
        if isinstance(coupling, SpringDamper):
            frequency = math.sqrt(coupling.stiffness / tool_mass)
            return laws.SpringDamperLaw(tool_mass, frequency, coupling.damping_ratio)
        return laws.MechanismLaw(tool_mass, _mechanism(tool_mass, coupling))
    if isinstance(coupling, Rigid):
        if isinstance(robot, RobotTable):
            return laws.VaryingLaw(tool_mass, _varying(robot))
        mass = robot.mass + tool_mass
        ratio = 0.5 * robot.damping / math.sqrt(robot.stiffness * mass)
        return laws.SpringDamperLaw(mass, math.sqrt(robot.stiffness / mass), ratio)
    behind = _varying(robot) if isinstance(robot, RobotTable) else _lumped(robot)
    if isinstance(coupling, SpringDamper):
        damping = 2.0 * coupling.damping_ratio * math.sqrt(coupling.stiffness * tool_mass)
        return laws.RobotLaw(tool_mass, laws.Spring(coupling.stiffness, damping), behind)
    return laws.RobotLaw(tool_mass, _mechanism(tool_mass, coupling), behind)


def _lumped(robot: Robot) -> LumpedRobot:
    return LumpedRobot(robot.mass, robot.stiffness, robot.damping)


def _varying(robot: RobotTable) -> VaryingRobot:
    splines = robot.splines
    return VaryingRobot(np.ascontiguousarray(splines.x), np.ascontiguousarray(splines.c))


def _mechanism(tool_mass: float, mechanism: Bistable) -> laws.Mechanism:
    """Lower a mechanism; its slider rests where the front stop bears the preload."""
    spring = (mechanism.stiffness, mechanism.free_length, mechanism.height)
    k_s, front = mechanism.stop_stiffness, mechanism.front_stop

    def net(depth: float) -> float:
        return float(force(*spring, front + depth)) - k_s * depth

    depth = brentq(net, 0.0, mechanism.stroke - front, xtol=1e-18, rtol=8.9e-16)
    damping = 2.0 * mechanism.stop_damping_ratio * math.sqrt(k_s * tool_mass)
    return laws.Mechanism(*spring, front + depth, front, mechanism.rear_stop, k_s, damping)
