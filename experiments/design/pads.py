"""Contact through a pad: a dome of soft material on the tool. Pad and object act as two Hertz springs in series.

Spring i (pad or object) has the stiffness k_i, the penetration delta_i and the restitution e_i. Both springs have the
same force F = k_i delta_i^1.5, so the sum of both penetrations is that of one spring with the stiffness k:

    k^(-2/3) = k_pad^(-2/3) + k_object^(-2/3)

Spring i stores the energy 2/5 F delta_i. This is the fraction k_i^(-2/3) / k^(-2/3) of the total. Spring i loses the
fraction 1 - e_i^2 of its energy. So 1 - e^2 of the contact is the mean of 1 - e_i^2, weighted by the stored energies.
k_object and e_object are measured with a rigid tool without a pad.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.baselines.rule import Floats
from agents.setups.keys import refuse_unknown
from impact_gym.physics.hertz import MATERIALS, hertz

RIGID = (1e30, 0.0)  # Young's modulus (Pa) and Poisson's ratio of a body that is far stiffer than any pad
PADS = {"norbornene": 0.01, "neoprene": 0.01, "memory-foam": 0.04}  # m, radius of the dome of each material


class Pad(NamedTuple):
    """A dome of one material on the tool; the tool's mass includes the dome."""

    stiffness: float  # N/m^1.5, in contact with a rigid body
    restitution: float  # -, in contact with a body that loses no energy
    radius: float  # m, of the dome

    @classmethod
    def of(cls, material: str) -> "Pad":
        """Return the pad of a material; Young's modulus is the geometric mean of the ends of the measured range."""
        refuse_unknown("--pad ", [material], PADS)
        measured, radius = MATERIALS[material], PADS[material]
        assert measured.restitution is not None  # measured for all materials of PADS
        stiffness = hertz(radius, math.sqrt(math.prod(measured.young)), sum(measured.poisson) / 2.0, *RIGID)
        return cls(stiffness, measured.restitution[1], radius)

    def contact(self, stiffness: Floats, restitution: Floats) -> tuple[Floats, Floats]:
        """Convert contact stiffness (N/m^1.5) and restitution without the pad to those with the pad; any shape."""
        of_pad, of_object = self.stiffness ** (-2.0 / 3.0), np.asarray(stiffness) ** (-2.0 / 3.0)
        fraction = of_pad / (of_pad + of_object)
        lost = fraction * (1.0 - self.restitution**2) + (1.0 - fraction) * (1.0 - np.asarray(restitution) ** 2)
        return (of_pad + of_object) ** -1.5, np.sqrt(1.0 - lost)
