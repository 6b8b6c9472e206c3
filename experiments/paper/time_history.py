"""The layout of Fig. 17, 19 and 23: velocities above, forces below, a column per case."""

from typing import Any

from matplotlib.figure import Figure

from experiments.charts import COUPLING, FORCE, velocities
from experiments.paper.tables import Table, trace_of


def draw(table: Table, titles: dict[str, str], window: tuple[float, float]) -> Figure:
    """Draw the cases of `table` named in `titles` over `window` (s)."""
    figure = Figure(figsize=(5.2 * len(titles), 6.4))
    grid: Any = figure.subplots(2, len(titles), sharex=True, sharey="row", squeeze=False)
    for column, (case, title) in enumerate(titles.items()):
        trace = trace_of(table, case)
        velocities(grid[0, column], trace)
        grid[0, column].set(title=title, xlabel="", xlim=window)
        axes = grid[1, column]
        axes.plot(trace.time, trace.contact_force, color=FORCE, label="contact force on the object")
        axes.plot(trace.time, trace.coupling_force, color=COUPLING, label="force of the coupling on the tool")
        axes.set(xlabel="time (s)", ylabel="force (N)")
        axes.legend()
    return figure
