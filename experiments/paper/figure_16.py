"""Fig. 16: V_p against the stiffness of the coupling for three contact stiffnesses; zeta = 1, e = 1."""

import numpy as np
from matplotlib.figure import Figure

import impact_gym as ig
from experiments.charts import SERIES
from experiments.paper.scenes import DURATION, MOTION, decoupled
from experiments.paper.tables import Table

RESTITUTION = 1.0
CONTACT_STIFFNESSES = (1e3, 1e4, 1e5)  # N/m^1.5
COUPLING_STIFFNESSES = np.linspace(5.0, 200.0, 196)  # N/m


def compute() -> Table:
    """Simulate the grid."""
    rows = []
    for contact_stiffness in CONTACT_STIFFNESSES:
        for coupling_stiffness in COUPLING_STIFFNESSES:
            scene = decoupled(contact_stiffness, RESTITUTION, coupling_stiffness)
            outcome = ig.simulate(scene, MOTION, DURATION)
            rows.append((contact_stiffness, coupling_stiffness, outcome.object_velocity, len(outcome.contacts)))
    names = ("contact_stiffness", "coupling_stiffness", "object_velocity", "contacts")
    return dict(zip(names, np.array(rows).T, strict=True))


def plot(table: Table) -> Figure:
    """Draw a curve per contact stiffness and mark where the number of contacts changes."""
    figure = Figure(figsize=(7.0, 4.6))
    axes = figure.subplots()
    for colour, contact_stiffness in zip(SERIES, CONTACT_STIFFNESSES, strict=False):
        rows = table["contact_stiffness"] == contact_stiffness
        stiffness, velocity = table["coupling_stiffness"][rows], table["object_velocity"][rows]
        axes.plot(
            stiffness, velocity, color=colour, label=f"k_c = $10^{round(np.log10(contact_stiffness))}$ N/m$^{{1.5}}$"
        )
        changes = np.flatnonzero(np.diff(table["contacts"][rows])) + 1
        axes.plot(stiffness[changes], velocity[changes], "o", color=colour, markeredgecolor="black")
    axes.plot([], [], "o", color="none", markeredgecolor="black", label="number of contacts changes")
    axes.set(xlabel="coupling stiffness k_t (N/m)", ylabel="final object velocity V_p (m/s)")
    axes.legend()
    return figure
