"""Pads on the tool: a dome of a soft material between tool and object, two Hertz springs one behind the other.

Both carry the same force F = k_i delta_i^1.5, so the penetrations add up to that of one spring with

    k^(-2/3) = k_pad^(-2/3) + k_object^(-2/3),

and each stores 2/5 F delta_i, the share k_i^(-2/3) / k^(-2/3) of the whole. Each loses the share 1 - e_i^2 of what it
stores, so 1 - e^2 is the mean of these, weighted by what is stored. The object's own numbers are those of its contact
with a tool without a pad, which is far stiffer than any pad.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.baselines.rule import Floats
from agents.setups.keys import known


class Pad(NamedTuple):
    """A dome of one material, which sits on the tool and counts as part of its mass."""

    material: str
    young: float  # Pa, Young's modulus
    poisson: float  # -
    resilience: float  # -, share of the energy that comes back, e^2
    radius: float  # m, of the dome
    source: str

    @property
    def stiffness(self) -> float:
        """Hertz stiffness against something far stiffer, 4/3 E / (1 - nu^2) sqrt(R), N/m^1.5."""
        return 4.0 / 3.0 * self.young / (1.0 - self.poisson**2) * math.sqrt(self.radius)

    @property
    def restitution(self) -> float:
        """Against something that loses nothing."""
        return math.sqrt(self.resilience)

    @property
    def deepest(self) -> float:
        """How far it may be pressed in, m: Hertz's law is one of small penetrations, and is stretched at half of R."""
        return 0.5 * self.radius

    def pressed(self, force: Floats) -> Floats:
        """Return how far forces (N, any shape) press it in, m."""
        return (np.asarray(force) / self.stiffness) ** (2.0 / 3.0)


def gent(shore: float) -> float:
    """Return Young's modulus (Pa) of rubber of a Shore A hardness, good to about a fifth.

    A. N. Gent, Rubber Chem. Technol. 31 (1958) 896-906.
    """
    return 0.0981e6 * (56.0 + 7.62336 * shore) / (0.137505 * (254.0 - 2.54 * shore))


BALLS = "hardness and restitution elasticity: manufacturer's sheet, quoted by BCIT Physics Commons, demonstration DLD20"
FOAM = (
    "modulus, of slow tests: G. Silber, C. Then, Preventive Biomechanics, 2013, table 4.3, E = 2 (mu_1 + mu_2); "
    "resilience, the most: Polyurethane Foam Association, In Touch 11 (1), 2016, ball rebound below 20 %"
)
PADS = {
    "norbornene": Pad("polynorbornene rubber (Norsorex), Shore A 32", gent(32.0), 0.49, 0.03, 0.01, BALLS),
    "neoprene": Pad("neoprene, Shore A 63", gent(63.0), 0.49, 0.53, 0.01, BALLS),
    "memory-foam": Pad("viscoelastic polyurethane foam", 13e3, 0.0, 0.2, 0.04, FOAM),
}
"""What may be put on a tool. Nothing here was measured by us; a foam is stiffer in a blow than in a slow test."""


def pad_of(name: str) -> Pad:
    """Return a pad of the table.

    Raises:
        ValueError: there is none of that name.
    """
    known("--pad ", [name], PADS)
    return PADS[name]


def on_pad(name: str, stiffness: Floats, restitution: Floats) -> tuple[Floats, Floats]:
    """Return stiffness (N/m^1.5) and restitution (-) of contacts with the pad in between, any shape."""
    pad = pad_of(name)
    of_pad, of_object = pad.stiffness ** (-2.0 / 3.0), np.asarray(stiffness) ** (-2.0 / 3.0)
    share = of_pad / (of_pad + of_object)
    lost = share * (1.0 - pad.resilience) + (1.0 - share) * (1.0 - np.asarray(restitution) ** 2)
    return (of_pad + of_object) ** -1.5, np.sqrt(1.0 - lost)
