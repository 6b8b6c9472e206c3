"""A tool approaches an object: how to move and brake so that it arrives soon and does not shoot the object away."""

from pathlib import Path

from impact_gym import sources

sources.check()
if not Path(__file__).with_name("agents").is_dir():  # a checkout, where they lie beside: a wheel has them in here
    __path__.append(str(Path(__file__).parents[1]))

from impact_gym import envs, operators
from impact_gym.identify import Identified, LoadCell, Sensor, identify
from impact_gym.motion import Brake, Motion, Trapezoid
from impact_gym.operators import Channel
from impact_gym.physics.dissipation import effective_restitution
from impact_gym.physics.hertz import MATERIALS, Material, hertz, material_ranges
from impact_gym.scene import Bistable, Contact, Object, Rigid, Robot, RobotTable, Scene, SpringDamper, Tool
from impact_gym.simulation import ContactRecord, Outcome, Trace, simulate
from impact_gym.sweeps import Outcomes, sweep

__version__ = "0.1.0"
__all__ = [
    "MATERIALS", "Bistable", "Brake", "Channel", "Contact", "ContactRecord", "Identified", "LoadCell", "Material",
    "Motion", "Object", "Outcome", "Outcomes", "Rigid", "Robot", "RobotTable", "Scene", "Sensor", "SpringDamper",
    "Tool", "Trace", "Trapezoid", "effective_restitution", "hertz", "identify", "material_ranges", "operators",
    "simulate", "sweep",
]  # fmt: skip

envs.register()
