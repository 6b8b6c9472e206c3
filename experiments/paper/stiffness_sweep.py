"""Fig. 16 and 18: V_p against the stiffness of the coupling for three contact stiffnesses, zeta = 1.

Where the number of contacts changes between two points of the grid, the change is enclosed by bisection and both ends
of the enclosure become points of the curve. Beside the paper's approach there is one to an object so far ahead that
the tool no longer swings when it arrives.
"""

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

import impact_gym as ig
from experiments.lab.charts import SERIES
from experiments.paper.scenes import DISTANCE, DURATION, MOTION, decoupled
from experiments.paper.sweeps import Row, enclosed
from experiments.paper.tables import Table, from_rows, where

CONTACT_STIFFNESSES = (1e3, 1e4, 1e5)  # N/m^1.5
COUPLING_STIFFNESSES = np.linspace(5.0, 200.0, 196)  # N/m
SETTLED_STIFFNESSES = COUPLING_STIFFNESSES[::5]  # N/m
SETTLED = 4.0  # m, distance after which the swing from the acceleration has died away at every k_t
ENCLOSURE = 1e-6  # N/m, width to which a change in the number of contacts is enclosed
NAMES = (
    "distance", "damping_ratio", "contact_stiffness", "coupling_stiffness", "contacts", "object_velocity",
    "object_velocity_first",
)  # fmt: skip
"""`object_velocity_first` is the object's velocity after the first contact."""


def point(k_t: float, k_c: float, restitution: float, zeta: float = 1.0, distance: float = DISTANCE) -> Row:
    """Simulate one approach; a row of the table."""
    scene = decoupled(k_c, restitution, k_t, zeta, distance)
    outcome = ig.simulate(scene, MOTION, DURATION + distance / MOTION.speed)
    first = outcome.contacts[0].object_velocity
    return distance, zeta, k_c, k_t, float(len(outcome.contacts)), outcome.object_velocity, first


def curve(k_c: float, restitution: float) -> list[Row]:
    """Return the rows of one curve, with the changes in the number of contacts enclosed."""
    at, count = NAMES.index("coupling_stiffness"), NAMES.index("contacts")
    return enclosed(COUPLING_STIFFNESSES.tolist(), lambda k_t: point(k_t, k_c, restitution), at, [count], ENCLOSURE)


def compute(restitution: float, extra: Iterable[Row] = ()) -> Table:
    """Simulate the curves of the paper and those of the settled tool; `extra` rows go below them."""
    rows = [row for k_c in CONTACT_STIFFNESSES for row in curve(k_c, restitution)]
    for k_c in CONTACT_STIFFNESSES:
        rows += [point(float(k_t), k_c, restitution, distance=SETTLED) for k_t in SETTLED_STIFFNESSES]
    return from_rows(NAMES, rows + list(extra))


def name(k_c: float) -> str:
    """Return what a curve is called in a sentence."""
    return f"k_c = 1e{round(np.log10(k_c))}"


def column(table: Table, k_c: float, which: str, distance: float = DISTANCE) -> NDArray[np.float64]:
    """Return a column of one curve."""
    return where(table, distance=distance, damping_ratio=1.0, contact_stiffness=k_c)[which].astype(float)


def changes(table: Table, k_c: float) -> list[tuple[float, int, int]]:
    """Return where the number of contacts changes: k_t (N/m), contacts below and above it."""
    stiffness, contacts = (column(table, k_c, which) for which in ("coupling_stiffness", "contacts"))
    return [(float(stiffness[i]), int(contacts[i]), int(contacts[i + 1])) for i in np.flatnonzero(np.diff(contacts))]


def on_grid(table: Table, k_c: float) -> NDArray[np.float64]:
    """Return V_p of one curve at the points of the grid, which are the same for all."""
    stiffness = column(table, k_c, "coupling_stiffness")
    return column(table, k_c, "object_velocity")[np.isin(stiffness, COUPLING_STIFFNESSES)]


def rising_from(table: Table, k_c: float) -> float:
    """Return the coupling stiffness (N/m) from which on V_p rises at every step of the grid."""
    falls = np.flatnonzero(np.diff(on_grid(table, k_c)) <= 0)
    return float(COUPLING_STIFFNESSES[falls[-1] + 1 if falls.size else 0])


def settled_rises(table: Table) -> bool:
    """Say whether V_p of the settled tool rises at every step, on every curve."""
    curves = (column(table, k_c, "object_velocity", SETTLED) for k_c in CONTACT_STIFFNESSES)
    return all(bool((np.diff(curve) > 0).all()) for curve in curves)


def draw(axes: Axes, table: Table) -> None:
    """Draw a curve per contact stiffness and mark where the number of contacts changes."""
    for colour, k_c in zip(SERIES, CONTACT_STIFFNESSES, strict=False):
        stiffness, velocity = (column(table, k_c, which) for which in ("coupling_stiffness", "object_velocity"))
        label = f"k_c = $10^{round(np.log10(k_c))}$ N/m$^{{1.5}}$"
        axes.plot(stiffness, velocity, color=colour, label=label)
        far = [column(table, k_c, which, SETTLED) for which in ("coupling_stiffness", "object_velocity")]
        axes.plot(*far, color=colour, linewidth=0.8, linestyle="--")
        marks = np.isin(stiffness, [at for at, _, _ in changes(table, k_c)])
        axes.plot(stiffness[marks], velocity[marks], "o", color=colour, markeredgecolor="black")
    axes.plot([], [], color="black", linewidth=0.8, linestyle="--", label="ours: tool settled before the impact")
    if any(changes(table, k_c) for k_c in CONTACT_STIFFNESSES):
        axes.plot([], [], "o", color="none", markeredgecolor="black", label="number of contacts changes")
    axes.set(xlabel="coupling stiffness k_t (N/m)", ylabel="final object velocity V_p (m/s)")
    axes.legend(fontsize=9)
