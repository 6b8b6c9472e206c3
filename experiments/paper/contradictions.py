"""Where the paper is misprinted or at odds with itself, with the numbers that show it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from experiments.paper.tables import Table, where


@dataclass(frozen=True, slots=True)
class Contradiction:
    """One place in the paper, and what is done about it."""

    place: str
    what: str


PRINTED_MASS = 5.35  # kg, m_r + m_t just before the impact, section 3.2
TOOL_MASS = 0.125  # kg
HEAVY_OBJECT = 2.5  # kg


def contradictions(tables: Mapping[str, Table]) -> tuple[Contradiction, ...]:
    """Return the list; entries that rest on a table appear if that table is there."""
    found = [
        Contradiction("Eq. 6", "m_n is a misprint of m_p, the mass of the object."),
        Contradiction("Eq. 18", "Lacks a dot: the object's acceleration, m_p x_p'', stands on the left."),
        share_of_the_mass(),
        stop_restitution(),
    ]
    if "figure_06" in tables:
        found.append(restitution_of_equation_7(tables["figure_06"]))
    if "figure_13" in tables and "figure_14" in tables:
        found.append(impact_velocities(tables["figure_13"], tables["figure_14"]))
    if "figure_13" in tables:
        found.append(braking_within_the_contact(tables["figure_13"]))
    if "figure_12" in tables:
        found.append(first_entry(tables["figure_12"]))
    return tuple(found)


def share_of_the_mass() -> Contradiction:
    """The 48 % of section 3.2."""
    return Contradiction(
        "Section 3.2, Fig. 14",
        f"2.5 kg is called about 48 % of m_r + m_t = 5.35 kg. It is {100 * HEAVY_OBJECT / PRINTED_MASS:.1f} % of "
        "that, and "
        f"{100 * HEAVY_OBJECT / (PRINTED_MASS - TOOL_MASS):.1f} % of m_r = {PRINTED_MASS - TOOL_MASS:g} kg alone.",
    )


def stop_restitution() -> Contradiction:
    """The stops of section 5."""
    return Contradiction(
        "Section 5, stops of the slider",
        "Each stop is a linear spring and damper, and its impact is assumed completely inelastic. No finite damping "
        "does "
        f"that: a stop that never pulls has a restitution of exp(-2) = {math.exp(-2.0):.4f} at a damping ratio of 1, "
        "and about "
        "1/(4 zeta^2) at large ones. We take a ratio of 1.",
    )


def restitution_of_equation_7(table: Table) -> Contradiction:
    """What eq. 7 delivers, from the fixed tool at 1 m/s: V_p = 1 + e (eq. 1)."""
    shown = []
    for restitution in (0.1, 0.5, 0.9):
        rows = where(table, free=0, restitution=restitution)
        shown.append(f"{float(np.median(rows['object_velocity'])) - 1.0:.4f} for {restitution:g}")
    return Contradiction(
        "Eq. 7",
        "Does not deliver the restitution it is given: an isolated contact has "
        + ", ".join(shown)
        + ", whatever k_c, masses and speed. Here e is the number given to eq. 7, as in the paper.",
    )


def impact_velocities(light: Table, heavy: Table) -> Contradiction:
    """0.98 and 0.95 m/s."""
    ours = [float(table["impact_velocity"][table["case"] == case][0]) for table, case in ((light, "b"), (heavy, "a"))]
    return Contradiction(
        "Fig. 13b and 14a",
        "The tool is said to strike at about 0.98 m/s in one and at about 0.95 m/s in the other. Between the two "
        "only the "
        "object's mass differs, which nothing before the impact depends on: both cannot hold. Ours are "
        f"{ours[0]:.4f} and {ours[1]:.4f} m/s.",
    )


def braking_within_the_contact(table: Table) -> Contradiction:
    """When the braking of Fig. 13a begins."""
    rows = where(table, case="a")
    time = rows["time"][rows["contact"] > 0].astype(float)
    return Contradiction(
        "Section 3.2, Fig. 13a",
        f"The braking is said to begin after the impact. With the printed k_c, e, m_p and speed the contact lasts "
        f"{1e3 * np.ptp(time):.1f} ms, longer than the 16 ms after which the braking begins. It costs V_p its fifth "
        "digit.",
    )


def first_entry(table: Table) -> Contradiction:
    """M_X,11 and the mass that is felt."""
    at = int(np.argmax(table["at_impact"] > 0))
    return Contradiction(
        "Eq. 16",
        "The (1,1) entry of M_X is taken as the share of the robot's mass that takes part in the impact. That is the "
        "mass felt "
        "if the tool could only move along x. The mass felt by a force along x is 1/(M_X^-1)_11: with our estimates of "
        f"the robot's inertia {float(table['effective_mass'][at]):.2f} kg against {float(table['mass'][at]):.2f} kg "
        "at the impact. We "
        "reproduce the paper's and show both in Fig. 12.",
    )
