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
from experiments.paper.tables import Table, where

TITLE = "The bistable mechanism tuned to the impact speed"
ALT = """Three panels against impact speed: V_p of the fixed, the tuned and the linear end-effector; the tuned height;
the tuned front stop. Open squares mark optima on the edge of the search."""
SPEEDS = tuple(np.round(np.arange(0.2, 2.0001, 0.1), 1).tolist())  # m/s
HEIGHTS = np.linspace(0.010, 0.045, 29)  # m
STOPS = np.linspace(0.004, 0.060, 29)  # m
REFINEMENTS, POINTS, ZOOM = 4, 7, 0.4
CASES = {"holds": "tuned, holds the tool", "slips": "tuned, does not hold it"}
STYLES = {"fixed": (OBJECT, "-"), "linear": (TOOL, "-"), "holds": (FORCE, "-"), "slips": (COUPLING, "--")}
KNOWN = (MECHANISM.height, MECHANISM.front_stop)  # off the grid, and not to be missed
Design = tuple[float, float]  # H, front stop, m
NAMES = (
    "case", "speed", "object_velocity", "height", "front_stop", "force_at_stop", "passes", "height_edge", "stop_edge",
)  # fmt: skip
"""edges: -1, 0 or 1 where the best point lies on the lower edge of the searched range, inside, or on the upper edge."""


def mechanism(design: Design) -> ig.Bistable | None:
    """Return the mechanism, or None if there is none: the stop lies beyond the stroke."""
    height, stop = design
    if stop**2 >= MECHANISM.free_length**2 - height**2:
        return None
    return replace(MECHANISM, height=height, front_stop=stop)


def force_at_stop(coupling: ig.Bistable) -> float:
    """Return the force with which the mechanism holds the tool on its front stop, N."""
    return float(coupling.force(coupling.front_stop))


def best(designs: Iterable[Design], speed: float, case: str) -> tuple[float, Design]:
    """Return the least V_p (m/s) and its design among those of `designs` that hold the tool, or do not."""
    couplings = {design: coupling for design in designs if (coupling := mechanism(design)) is not None}
    allowed = {at: one for at, one in couplings.items() if (force_at_stop(one) >= HOLD) == (case == "holds")}
    found = ((approach(coupling, speed).object_velocity, design) for design, coupling in allowed.items())
    return min(found, default=(np.inf, (np.nan, np.nan)))


def search(speed: float, case: str) -> tuple[Design, int, int]:
    """Return the best design, and on which edge of the searched range its H and its stop lie: -1, 0 or 1."""
    found = best((KNOWN, *product(HEIGHTS.tolist(), STOPS.tolist())), speed, case)
    grids = (HEIGHTS, STOPS)
    widths = [float(grid[1] - grid[0]) for grid in grids]
    for _ in range(REFINEMENTS):
        axes = [
            np.clip(np.linspace(x - width, x + width, POINTS), grid[0], grid[-1]).tolist()
            for x, width, grid in zip(found[1], widths, grids, strict=True)
        ]
        found = min(found, best(product(*axes), speed, case))
        widths = [ZOOM * width for width in widths]
    on_height, on_stop = (int(x == grid[-1]) - int(x == grid[0]) for x, grid in zip(found[1], grids, strict=True))
    return found[1], on_height, on_stop


def compute(speeds: Sequence[float] = SPEEDS) -> Table:
    """Search at every speed (m/s)."""
    rows: list[tuple[str | float, ...]] = []
    for speed in speeds:
        chosen = {case: search(speed, case) for case in CASES}
        for case, (design, *edges) in {"fixed": (KNOWN, 0, 0), **chosen}.items():
            coupling = mechanism(design)
            assert coupling is not None  # it was simulated
            outcome = approach(coupling, speed)
            passes = len(outcome.snap_through)
            rows.append((case, speed, outcome.object_velocity, *design, force_at_stop(coupling), passes, *edges))
        rows.append(("linear", speed, approach(LINEAR, speed).object_velocity, *[np.nan] * 3, 0, 0, 0))
    return {name: np.array(column) for name, column in zip(NAMES, zip(*rows, strict=True), strict=True)}


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


def _list(speeds: np.ndarray) -> str:
    return ", ".join(f"{speed:g}" for speed in speeds) + " m/s" if speeds.size else "no speed"
