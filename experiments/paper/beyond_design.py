"""Which height H and front stop give the least V_p at each impact speed; k, L0 and rear stop as in Fig. 23.

Designs that hold the tool on its front stop while the robot accelerates, F_T(front stop) >= m_t a (requirement 1 of
section 5), are kept apart from those that do not. A grid over H and stop is searched and refined around its best point.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

import impact_gym as ig
from experiments.lab.charts import COUPLING, FORCE, OBJECT, TOOL
from experiments.paper.beyond_speed import approach
from experiments.paper.layouts import Panels, panels
from experiments.paper.scenes import HOLD, LINEAR, MECHANISM, MOTION
from experiments.paper.statements import Statements, section_6
from experiments.paper.tables import Array, Row, Table, from_rows, where

TITLE = "The bistable mechanism tuned to the impact speed"
ALT = """Three panels against impact speed: V_p of the fixed, the tuned and the linear end-effector; the tuned height;
the tuned front stop. Open squares mark optima on the edge of the search."""
SPEEDS = tuple(np.round(np.arange(0.2, 2.0001, 0.1), 1).tolist())  # m/s
HEIGHTS = np.linspace(0.010, 0.045, 29)  # m
STOPS = np.linspace(0.004, 0.060, 29)  # m
REFINEMENTS, POINTS, ZOOM = 4, 7, 0.4
CASES = {"holds": "tuned, holds the tool", "slips": "tuned, does not hold it"}
STYLES = {"fixed": (OBJECT, "-"), "linear": (TOOL, "-"), "holds": (FORCE, "-"), "slips": (COUPLING, "--")}
Optimum = tuple[float, float, float]  # V_p (m/s), H, front stop (m)


def force_at_stop(coupling: ig.Bistable) -> float:
    """Return the force with which the mechanism holds the tool on its front stop, N."""
    return float(coupling.force(coupling.front_stop))


def best(heights: Iterable[float], stops: Iterable[float], speed: float, case: str) -> Optimum:
    """Return the best of these designs that hold the tool, or do not; a stop beyond the stroke is no design."""
    least: Optimum = (np.inf, np.nan, np.nan)
    for height, stop in product(heights, stops):
        if stop**2 >= MECHANISM.free_length**2 - height**2:
            continue
        coupling = replace(MECHANISM, height=height, front_stop=stop)
        if (force_at_stop(coupling) >= HOLD) == (case == "holds"):
            least = min(least, (approach(coupling, speed).object_velocity, height, stop))
    return least


def search(speed: float, case: str) -> tuple[ig.Bistable, tuple[int, int]]:
    """Return the best design, and on which edge of the searched range its H and its stop lie: -1 lower, 0 none, 1."""
    grids = (HEIGHTS, STOPS)
    papers = best([MECHANISM.height], [MECHANISM.front_stop], speed, case)  # off the grid, and not to be missed
    least = min(papers, best(HEIGHTS.tolist(), STOPS.tolist(), speed, case))
    widths = [float(grid[1] - grid[0]) for grid in grids]
    for _ in range(REFINEMENTS):
        heights, stops = (
            np.clip(np.linspace(x - width, x + width, POINTS), grid[0], grid[-1]).tolist()
            for x, width, grid in zip(least[1:], widths, grids, strict=True)
        )
        least = min(least, best(heights, stops, speed, case))
        widths = [ZOOM * width for width in widths]
    on_height, on_stop = (int(x == grid[-1]) - int(x == grid[0]) for x, grid in zip(least[1:], grids, strict=True))
    return replace(MECHANISM, height=least[1], front_stop=least[2]), (on_height, on_stop)


def row(case: str, speed: float, coupling: ig.Bistable | ig.SpringDamper, edges: tuple[int, int] = (0, 0)) -> Row:
    """Simulate one design; its row of the table."""
    outcome = approach(coupling, speed)
    height = stop = force = np.nan
    if isinstance(coupling, ig.Bistable):
        height, stop, force = coupling.height, coupling.front_stop, force_at_stop(coupling)
    return {
        "case": case, "speed": speed, "object_velocity": outcome.object_velocity, "height": height, "front_stop": stop,
        "force_at_stop": force, "passes": len(outcome.snap_through), "height_edge": edges[0], "stop_edge": edges[1],
    }  # fmt: skip


def compute(speeds: Sequence[float] = SPEEDS) -> Table:
    """Search at every speed (m/s)."""
    rows: list[Row] = []
    for speed in speeds:
        rows.append(row("fixed", speed, MECHANISM))
        for case in CASES:
            rows.append(row(case, speed, *search(speed, case)))
        rows.append(row("linear", speed, LINEAR))
    return from_rows(rows)


@panels(13.0, 4.4, columns=3, sharex=True)
def plot(table: Table, grid: Panels) -> None:
    """Draw V_p, H and front stop against the impact speed."""
    labels = {"fixed": "design of Fig. 23a", "linear": "linear, k_t = 50 N/m", **CASES}
    for case, label in labels.items():
        rows = where(table, case=case)
        colour, line = STYLES[case]
        grid[0].plot(rows["speed"], rows["object_velocity"], line, color=colour, label=label)
        if case == "linear":
            continue
        for axes, column, edge in ((grid[1], "height", "height_edge"), (grid[2], "front_stop", "stop_edge")):
            marker = None if case == "fixed" else "."
            axes.plot(rows["speed"], 1e3 * rows[column], line, color=colour, marker=marker, label=label)
            on_edge = rows[edge] != 0.0
            axes.plot(rows["speed"][on_edge], 1e3 * rows[column][on_edge], "s", color="none", mec=colour, markersize=8)
    for axes, label in zip(grid, ("V_p (m/s)", "height H (mm)", "front stop (mm)"), strict=True):
        axes.set(xlabel="impact speed (m/s)", ylabel=label)
    grid[0].plot([], [], "s", color="none", mec="black", markersize=8, label="on the edge of the grid")
    grid[0].figure.legend(loc="outside upper center", ncols=5, handles=grid[0].get_legend_handles_labels()[0])


def statements(table: Table) -> Statements:
    """Compare with section 6."""
    fixed, holds, slips, linear = (where(table, case=case) for case in ("fixed", "holds", "slips", "linear"))
    speed = fixed["speed"]
    gain = 1.0 - holds["object_velocity"] / fixed["object_velocity"]
    at_one = int(np.argmin(np.abs(speed - MOTION.speed)))
    worse = speed[holds["object_velocity"] > linear["object_velocity"]]
    edge = speed[(holds["height_edge"] != 0) | (holds["stop_edge"] != 0)]
    bound = speed[holds["force_at_stop"] < 1.01 * HOLD]
    others = np.arange(speed.size) != at_one
    much = others & (gain > 0.1)
    heights, stops = HEIGHTS[[0, -1]] * 1e3, STOPS[[0, -1]] * 1e3
    yield section_6.claim(
        "The bi-stable mechanism has to be tuned to the impact velocity",
        much.sum() > 0.5 * others.sum(),
        f"tuning H and front stop lowers V_p by {100 * gain[at_one]:.0f} % at {speed[at_one]:g} m/s and by up to "
        f"{100 * gain.max():.0f} % elsewhere, by more than 10 % at {much.sum()} of {others.sum()} other speeds",
        "more than 10 % at more than half of the speeds other than 1 m/s, among designs that hold the tool",
        why=f"Searched: H from {heights[0]:g} to {heights[1]:g} mm, stop from {stops[0]:g} to {stops[1]:g} mm. The "
        f"optimum lies on the edge of that range at {_list(edge)}; on the limit of the hold (within 1 %) at "
        f"{_list(bound)}; it is worse than the linear end-effector at {_list(worse)}. Designs that do not hold the "
        f"tool could bring V_p to {slips['object_velocity'][at_one]:.3f} m/s at {speed[at_one]:g} m/s, where the best "
        f"that holds has {holds['object_velocity'][at_one]:.3f} m/s.",
    )


def _list(speeds: Array) -> str:
    return ", ".join(f"{speed:g}" for speed in speeds) + " m/s" if speeds.size else "no speed"
