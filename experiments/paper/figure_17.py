"""Fig. 17: velocities and forces for two contact stiffnesses; k_t = 150 N/m, zeta = 1, e = 1."""

from matplotlib.figure import Figure

from experiments.paper import time_history
from experiments.paper.scenes import DURATION, MOTION, decoupled
from experiments.paper.tables import Table, histories

CASES = {"a": "(a, c) k_c = 10$^5$ N/m$^{1.5}$", "b": "(b, d) k_c = $10^4$ N/m$^{1.5}$"}


def compute() -> Table:
    """Simulate both cases."""
    return histories({"a": decoupled(1e5, 1.0, 150.0), "b": decoupled(1e4, 1.0, 150.0)}, MOTION, DURATION)


def plot(table: Table) -> Figure:
    """Draw both cases side by side."""
    return time_history.draw(table, CASES, window=(0.25, 0.75))
