"""Where the paper is misprinted or at odds with itself, with the numbers that show it."""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from experiments.paper.figure_03 import ROBOT_AND_TOOL
from experiments.paper.figure_14 import HEAVY
from experiments.paper.scenes import TOOL_MASS
from experiments.paper.tables import Run, Table, where


class Contradiction(NamedTuple):
    """One place in the paper, and what is done about it."""

    place: str
    what: str


def contradictions(tables: Mapping[str, Table]) -> Iterator[Contradiction]:
    """Yield the list; entries that rest on a table appear if that table is there."""
    robot = ROBOT_AND_TOOL - TOOL_MASS
    yield Contradiction("Eq. 6", "m_n is a misprint of m_p, the mass of the object.")
    yield Contradiction("Eq. 18", "Lacks a dot: the object's acceleration, m_p x_p'', stands on the left.")
    yield Contradiction(
        "Section 3.2, Fig. 14",
        f"2.5 kg is called about 48 % of m_r + m_t = 5.35 kg. It is {100 * HEAVY / ROBOT_AND_TOOL:.1f} % of that, and "
        f"{100 * HEAVY / robot:.1f} % of m_r = {robot:g} kg alone.",
    )
    yield Contradiction(
        "Section 5, stops of the slider",
        "Each stop is a linear spring and damper, and its impact is assumed completely inelastic. No finite damping "
        f"does that: a stop that never pulls has a restitution of exp(-2) = {math.exp(-2.0):.4f} at a damping ratio of "
        "1, and about 1/(4 zeta^2) at large ones. We take a ratio of 1.",
    )
    if "figure_06" in tables:  # the fixed tool at 1 m/s: V_p = 1 + e (eq. 1)
        rows = {e: where(tables["figure_06"], free=0, restitution=e) for e in (0.1, 0.5, 0.9)}
        shown = [f"{np.median(row['object_velocity']) - 1.0:.4f} for {e:g}" for e, row in rows.items()]
        yield Contradiction(
            "Eq. 7",
            f"Does not deliver the restitution it is given: an isolated contact has {', '.join(shown)}, whatever k_c, "
            "masses and speed. Here e is the number given to eq. 7, as in the paper.",
        )
    if "figure_13" in tables and "figure_14" in tables:
        light, heavy = Run(tables["figure_13"], "b"), Run(tables["figure_14"], "a")
        yield Contradiction(
            "Fig. 13b and 14a",
            "The tool is said to strike at about 0.98 m/s in one and at about 0.95 m/s in the other. Between the two "
            "only the object's mass differs, which nothing before the impact depends on: at the touch both cannot "
            "hold. Either can, with all other printed numbers and the object at one distance. Ours are "
            f"{light.impact_velocity:.4f} and {heavy.impact_velocity:.4f} m/s. The second may be a mean over the "
            "contact (Fig. 14).",
        )
    if "figure_13" in tables:
        lasting = 1e3 * Run(tables["figure_13"], "a").duration_of_contact
        yield Contradiction(
            "Section 3.2, Fig. 13a",
            "The braking is said to begin after the impact. With the printed k_c, e, m_p and speed the contact lasts "
            f"{lasting:.1f} ms, longer than the 16 ms after which the braking begins. It costs V_p its fifth digit.",
        )
    if "figure_12" in tables:
        at_impact = where(tables["figure_12"], at_impact=1)
        yield Contradiction(
            "Eq. 16",
            "The (1,1) entry of M_X is taken as the share of the robot's mass that takes part in the impact. That is "
            "the mass felt if the tool could only move along x. The mass felt by a force along x is the reciprocal of "
            "that entry of the inverse of M_X: "
            f"with our estimates of the robot's inertia {at_impact['effective_mass'][0]:.2f} kg against "
            f"{at_impact['mass'][0]:.2f} kg at the impact. We reproduce the paper's and show both in Fig. 12.",
        )
