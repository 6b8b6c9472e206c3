"""Simulator and environment of a robot tool that strikes an object; the tool should arrive early and strike softly."""

from impact_gym.support import beside, sources

sources.check()
beside.install()

from impact_gym import envs, robot, sensors
from impact_gym.advice import advise
from impact_gym.couplings import Bistable, Rigid, SpringDamper
from impact_gym.identification import Identified, LoadCell, Sensor, identify
from impact_gym.identification.held_out import HeldOut, hold_out
from impact_gym.motion import Brake, Motion, Trapezoid
from impact_gym.outcome import ContactRecord, Outcome, Outcomes, Trace
from impact_gym.physics.dissipation import effective_restitution
from impact_gym.physics.hertz import MATERIALS, Material, hertz, material_ranges
from impact_gym.scene import Contact, Object, Robot, RobotTable, Scene, Tool
from impact_gym.simulation import simulate, sweep
from impact_gym.teleop import channels, operators
from impact_gym.teleop.channels import Channel

__version__ = "0.1.0"
__all__ = [
    "MATERIALS", "Bistable", "Brake", "Channel", "Contact", "ContactRecord", "HeldOut", "Identified", "LoadCell",
    "Material", "Motion", "Object", "Outcome", "Outcomes", "Rigid", "Robot", "RobotTable", "Scene", "Sensor",
    "SpringDamper", "Tool", "Trace", "Trapezoid", "advise", "channels", "effective_restitution", "hertz", "hold_out",
    "identify", "material_ranges", "operators", "robot", "sensors", "simulate", "sweep",
]  # fmt: skip

envs.register()
