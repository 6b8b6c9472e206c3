"""Whether one tuning of the paper's mechanism holds for other sizes and speeds, as its introduction hopes.

The mechanism of Fig. 23 beside the spring of Fig. 23 under the paper's motion: over the object's mass with the paper's
tool, and over both masses at the paper's ratio, each over the impact speed. Then once more with the best of the small
modifications: stiffness, height and front stop each changed by a fifth or left alone, chosen for each size and speed.
"""

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
import polars as pl
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure

import impact_gym as ig
from agents.baselines.rule import Floats
from agents.jobs import Result
from experiments.lab.tables import Row, gathered, result_of, solver_and
from experiments.paper import scenes
from experiments.paper.scenes import DISTANCE, DURATION, LINEAR, MECHANISM, MOTION, OBJECT_MASS, TOOL_MASS

MASSES, SPEEDS = (0.05, 2.5), (0.2, 2.0)  # kg, of the object; m/s
TICKS = (0.05, 0.1, 0.25, 0.5, 1.0, 2.5)  # kg
CELLS = 31  # along each side of a map
FACTORS = (0.8, 1.0, 1.2)  # of a small modification
CRUISE = DISTANCE / MOTION.speed - 0.5 * MOTION.speed / MOTION.acceleration  # s, at constant speed in Fig. 23
HOLDS = 0.9
"""It holds where the mechanism leaves the object at least a tenth slower than the spring; at the paper's own point that
is a third."""
MAPS = {"object": "the paper's tool, 0.125 kg", "both": "a tool of half the object's mass"}
TUNINGS = {"mechanism": "the paper's tuning", "modified": "best small modification"}


def map_rows(folder: Path, processes: int | None, cells: int = CELLS) -> list[Row]:
    """Return a row for each map, speed and mass, computed once and kept in `folder`."""
    masses = np.geomspace(*MASSES, cells).tolist()
    arguments = [
        {"kind": kind, "speed": speed, "masses": masses} for kind in MAPS for speed in np.linspace(*SPEEDS, cells)
    ]
    depends = solver_and("experiments.paper.scenes", __name__)
    return gathered(folder, "sizes", rows_at, arguments, depends, processes=processes)


def rows_at(kind: str, speed: float, masses: list[float]) -> Result:
    """Return the rows of one map at an impact speed (m/s), for objects of `masses` (kg)."""
    objects = np.array(masses)
    tools = TOOL_MASS / OBJECT_MASS * objects if kind == "both" else np.full(len(objects), TOOL_MASS)
    own = {f"coupling.{name}": getattr(MECHANISM, name) for name in ("stiffness", "height", "front_stop")}
    modified = [
        velocity(
            MECHANISM, speed, objects, tools, **{name: f * own[name] for name, f in zip(own, factors, strict=True)}
        )
        for factors in product(FACTORS, repeat=len(own))
    ]
    columns = {
        "object": objects,
        "tool": tools,
        "spring": velocity(LINEAR, speed, objects, tools),
        "mechanism": velocity(MECHANISM, speed, objects, tools),
        "modified": np.min(modified, axis=0),
    }
    cells = zip(*(column.tolist() for column in columns.values()), strict=True)
    return result_of([{"kind": kind, "speed": speed, **dict(zip(columns, cell, strict=True))} for cell in cells])


def velocity(
    coupling: ig.Bistable | ig.SpringDamper, speed: float, objects: Floats, tools: Floats, **design: float
) -> Floats:
    """Return V_p (m/s) of each object and tool (n,), kg, at an impact speed (m/s); `design` changes the coupling."""
    distance = speed**2 / (2.0 * MOTION.acceleration) + speed * CRUISE
    motion = ig.Trapezoid(speed, MOTION.acceleration, MOTION.brake)
    varied: dict[str, Floats | float] = {"object.mass": objects, "tool.mass": tools, **design}
    scene = scenes.scene(1e3, 0.1, coupling, distance=distance)
    return ig.sweep(scene, motion, varied, duration=DURATION + 0.5, threads=1).object_velocity


def shares(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Return the share of each map where a tuning holds, and where the paper's is worse than the spring."""
    by_title = {}
    for kind, title in MAPS.items():
        cells = pl.DataFrame(rows).filter(kind=kind)
        holds = {name: cells.select((pl.col(name) <= HOLDS * pl.col("spring")).mean()).item() for name in TUNINGS}
        by_title[title] = holds | {"worse": cells.select((pl.col("mechanism") > pl.col("spring")).mean()).item()}
    return by_title


def maps(rows: Sequence[Row]) -> Figure:
    """Return the maps of V_p over the spring's; white where they are equal, blue where the mechanism is better."""
    figure = Figure(figsize=(10.6, 8.0))
    grid = figure.subplots(2, len(MAPS), sharex=True, sharey=True)
    for axes, (name, kind) in zip(grid.flat, product(TUNINGS, MAPS), strict=True):
        cells = pl.DataFrame(rows).filter(kind=kind)
        speeds, objects = (cells[column].unique().sort().to_numpy() for column in ("speed", "object"))
        ratio = (cells[name] / cells["spring"]).to_numpy().reshape(len(speeds), len(objects)).T
        norm = TwoSlopeNorm(1.0, 0.4, 1.6)
        mesh = axes.pcolormesh(speeds, objects, ratio, cmap="RdBu_r", norm=norm, shading="nearest", rasterized=False)
        axes.contour(speeds, objects, ratio, levels=[HOLDS], colors="black", linewidths=1.0)
        axes.plot(MOTION.speed, OBJECT_MASS, "k*", markersize=10)
        axes.set(yscale="log", xlabel="impact speed (m/s)", ylabel="object's mass (kg)")
        axes.set_yticks(TICKS, [f"{mass:g}" for mass in TICKS])
        axes.set_title(f"{TUNINGS[name]}; {MAPS[kind]}", fontsize=9)
        axes.grid(visible=False)
        axes.label_outer()
    figure.colorbar(mesh, ax=grid, label="V_p, mechanism over spring")
    return figure
