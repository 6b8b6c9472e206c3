"""Pads on the tool: a dome of a soft material between tool and object, two Hertz springs one behind the other.

Both carry the same force F = k_i delta_i^1.5, so the penetrations add up to that of one spring with

    k^(-2/3) = k_pad^(-2/3) + k_object^(-2/3),

and each stores 2/5 F delta_i, the share k_i^(-2/3) / k^(-2/3) of the whole. Each loses the share 1 - e_i^2 of what it
stores, so 1 - e^2 is the mean of these, weighted by what is stored. The object's own numbers are those of its contact
with a tool without a pad, which is far stiffer than any pad.
"""

import math
import tomllib
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agents.baselines.rule import Floats
from agents.setups.keys import known

TABLE = Path(__file__).with_name("pads.toml")


class Pad(NamedTuple):
    """A dome of one material."""

    material: str
    young: float  # Pa
    poisson: float  # -
    resilience: float  # -, share of the energy that it gives back, e^2
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


@cache
def pads() -> dict[str, Pad]:
    """Return the pads of the table by name."""
    return {name: Pad(**content) for name, content in tomllib.loads(TABLE.read_text()).items()}


def pad_of(name: str) -> Pad:
    """Return a pad of the table.

    Raises:
        ValueError: there is none of that name.
    """
    known("--pad ", [name], pads())
    return pads()[name]


def on_pad(name: str, stiffness: Floats, restitution: Floats) -> tuple[Floats, Floats]:
    """Return stiffness (N/m^1.5) and restitution (-) of contacts with the pad in between, any shape."""
    pad = pad_of(name)
    of_pad, of_object = pad.stiffness ** (-2.0 / 3.0), np.asarray(stiffness) ** (-2.0 / 3.0)
    share = of_pad / (of_pad + of_object)
    lost = share * (1.0 - pad.resilience) + (1.0 - share) * (1.0 - np.asarray(restitution) ** 2)
    return (of_pad + of_object) ** -1.5, np.sqrt(1.0 - lost)
