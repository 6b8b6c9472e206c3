"""Fig. 16 and 18: V_p against the stiffness of the coupling for three contact stiffnesses, zeta = 1.

Where the number of contacts changes between two points of the grid, the change is enclosed by bisection and both ends
of the enclosure become points of the curve. Beside the paper's approach there is one to an object so far ahead that
the tool no longer swings when it arrives.
"""

from collections.abc import Iterable, Mapping
from functools import partial

import numpy as np
from matplotlib.axes import Axes

import impact_gym as ig
from experiments.lab.charts import SERIES
from experiments.paper import sweeps
from experiments.paper.scenes import DISTANCE, DURATION, MOTION, decoupled
from experiments.paper.sweeps import Row, enclosed
from experiments.paper.tables import Table, from_rows, where

CONTACT_STIFFNESSES = (1e3, 1e4, 1e5)  # N/m^1.5
COUPLING_STIFFNESSES = np.linspace(5.0, 200.0, 196)  # N/m
SETTLED_STIFFNESSES = COUPLING_STIFFNESSES[::5]  # N/m
SETTLED = 4.0  # m, distance after which the swing from the acceleration has died away at every k_t
NAMES = (
    "distance", "damping_ratio", "contact_stiffness", "coupling_stiffness", "contacts", "object_velocity",
    "object_velocity_first",
)  # fmt: skip
"""`object_velocity_first` is the object's velocity after the first contact."""


def point(k_t: float, k_c: float, restitution: float, zeta: float = 1.0, distance: float = DISTANCE) -> Row:
    """Simulate one approach; a row of the table."""
    scene = decoupled(k_c, restitution, k_t, zeta, distance)
    outcome = ig.simulate(scene, MOTION, DURATION + distance / MOTION.speed)
    first, *others = outcome.contacts
    return distance, zeta, k_c, k_t, 1 + len(others), outcome.object_velocity, first.object_velocity


def compute(restitution: float, extra: Iterable[Row] = ()) -> Table:
    """Simulate the curves of the paper and those of the settled tool; `extra` rows go below them."""
    rows: list[Row] = []
    for k_c in CONTACT_STIFFNESSES:
        one = partial(point, k_c=k_c, restitution=restitution)
        rows += enclosed(COUPLING_STIFFNESSES, one, NAMES, "coupling_stiffness", "contacts")
    for k_c in CONTACT_STIFFNESSES:
        rows += [point(k_t, k_c, restitution, distance=SETTLED) for k_t in SETTLED_STIFFNESSES]
    return from_rows(NAMES, [*rows, *extra])


def by_curve(words: Mapping[float, str]) -> str:
    """Return a sentence with what there is to say about the curve of each contact stiffness."""
    return "; ".join(f"k_c = 1e{round(np.log10(k_c))}: {said}" for k_c, said in words.items())


def curve(table: Table, k_c: float, distance: float = DISTANCE) -> Table:
    """Return the rows of one curve, by rising coupling stiffness."""
    return where(table, distance=distance, damping_ratio=1.0, contact_stiffness=k_c)


def changes(table: Table, k_c: float) -> list[tuple[float, int, int]]:
    """Return where the number of contacts changes: k_t (N/m), contacts below and above it."""
    return sweeps.changes(curve(table, k_c), "coupling_stiffness", "contacts")


def on_grid(table: Table, k_c: float) -> np.ndarray:
    """Return V_p of one curve at the points of the grid, which are the same for all."""
    rows = curve(table, k_c)
    return rows["object_velocity"][np.isin(rows["coupling_stiffness"], COUPLING_STIFFNESSES)]


def rising_from(table: Table) -> dict[float, float]:
    """Return for each contact stiffness the coupling stiffness (N/m) from which on V_p rises at every step."""
    falls = {k_c: np.flatnonzero(np.diff(on_grid(table, k_c)) <= 0) for k_c in CONTACT_STIFFNESSES}
    return {k_c: COUPLING_STIFFNESSES[at[-1] + 1 if at.size else 0] for k_c, at in falls.items()}


def places(holds: np.ndarray) -> str:
    """Return in words at how many points of the grid something holds, and between which it does not."""
    broken = COUPLING_STIFFNESSES[~holds]
    where_not = f"; not at {broken.min():g} to {broken.max():g} N/m" if broken.size else ""
    return f"holds at {holds.sum()} of {holds.size} values of k_t{where_not}"


def draw(axes: Axes, table: Table) -> None:
    """Draw a curve per contact stiffness and mark where the number of contacts changes."""
    for colour, k_c in zip(SERIES, CONTACT_STIFFNESSES, strict=False):
        rows, far = curve(table, k_c), curve(table, k_c, SETTLED)
        stiffness, velocity = rows["coupling_stiffness"], rows["object_velocity"]
        label = f"k_c = $10^{round(np.log10(k_c))}$ N/m$^{{1.5}}$"
        axes.plot(stiffness, velocity, color=colour, label=label)
        axes.plot(far["coupling_stiffness"], far["object_velocity"], color=colour, linewidth=0.8, linestyle="--")
        marks = np.isin(stiffness, [at for at, _, _ in changes(table, k_c)])
        axes.plot(stiffness[marks], velocity[marks], "o", color=colour, markeredgecolor="black")
    axes.plot([], [], color="black", linewidth=0.8, linestyle="--", label="ours: tool settled before the impact")
    if any(changes(table, k_c) for k_c in CONTACT_STIFFNESSES):
        axes.plot([], [], "o", color="none", markeredgecolor="black", label="number of contacts changes")
    axes.set(xlabel="coupling stiffness k_t (N/m)", ylabel="final object velocity V_p (m/s)")
    axes.legend(fontsize=9)
