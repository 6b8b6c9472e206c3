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
from impact_gym.physics.hertz import MATERIALS, hertz

RIGID = (1e30, 0.0)  # Pa and Poisson's ratio of something far stiffer than any pad
PADS = {"norbornene": 0.01, "neoprene": 0.01, "memory-foam": 0.04}
"""Radius (m) of the dome of each material, of `impact_gym.MATERIALS`, that may be put on a tool."""


class Pad(NamedTuple):
    """A dome of one material, which sits on the tool and counts as part of its mass."""

    stiffness: float  # N/m^1.5, Hertz's against something far stiffer
    restitution: float  # -, against something that loses nothing
    radius: float  # m, of the dome

    @property
    def deepest(self) -> float:
        """How far it may be pressed in, m: Hertz's law is one of small penetrations, and is stretched at half of R."""
        return 0.5 * self.radius

    def pressed(self, force: Floats) -> Floats:
        """Return how far forces (N, any shape) press it in, m."""
        return (np.asarray(force) / self.stiffness) ** (2.0 / 3.0)


def pad_of(material: str) -> Pad:
    """Return the pad of a material: as stiff as in the middle of what is measured, and at its bounciest.

    Raises:
        ValueError: there is none of it.
    """
    known("--pad ", [material], PADS)
    measured, radius = MATERIALS[material], PADS[material]
    assert measured.restitution is not None  # of each material of which there is a pad
    stiffness = hertz(radius, math.sqrt(math.prod(measured.young)), sum(measured.poisson) / 2.0, *RIGID)
    return Pad(stiffness, measured.restitution[1], radius)


def on_pad(name: str, stiffness: Floats, restitution: Floats) -> tuple[Floats, Floats]:
    """Return stiffness (N/m^1.5) and restitution (-) of contacts with the pad in between, any shape."""
    pad = pad_of(name)
    of_pad, of_object = pad.stiffness ** (-2.0 / 3.0), np.asarray(stiffness) ** (-2.0 / 3.0)
    share = of_pad / (of_pad + of_object)
    lost = share * (1.0 - pad.restitution**2) + (1.0 - share) * (1.0 - np.asarray(restitution) ** 2)
    return (of_pad + of_object) ** -1.5, np.sqrt(1.0 - lost)
