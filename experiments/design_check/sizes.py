"""Whether one tuning of the paper's mechanism holds for other sizes and speeds, as its introduction hopes.

The mechanism of Fig. 23 beside the spring of Fig. 23 under the paper's motion: over the object's mass with the paper's
tool, and over both masses at the paper's ratio, each over the impact speed; and once more with the best of the small
modifications, stiffness, height and front stop each changed by a fifth or left alone, chosen for each size and speed.
"""

from itertools import product
from typing import Any

import numpy as np
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure

import impact_gym as ig
from agents.jobs import Result
from experiments.lab.tables import Gather, Row, result_of, solver_and
from experiments.paper.beyond_speed import CRUISE
from experiments.paper.scenes import DURATION, LINEAR, MECHANISM, MOTION, held

HEAVY, SPEEDS = (0.05, 2.5), (0.2, 2.0)  # kg, of the object; m/s
TICKS = (0.05, 0.1, 0.25, 0.5, 1.0, 2.5)  # kg
CELLS = 31
MODIFIED = (0.8, 1.0, 1.2)
HOLDS = 0.9
"""It holds where the mechanism leaves the object at least a tenth slower than the spring; at the paper's own point that
is a third."""
MAPS = {"object": "the paper's tool, 0.125 kg", "both": "a tool of half the object's mass"}


def rows(gather: Gather, quick: bool) -> list[Row]:
    """Return a row for each map, mass and speed."""
    cells = 7 if quick else CELLS
    speeds, masses = np.linspace(*SPEEDS, cells).tolist(), np.geomspace(*HEAVY, cells).tolist()
    asked = [{"kind": kind, "speed": speed, "masses": masses} for kind in MAPS for speed in speeds]
    return gather("sizes", row_of_masses, asked, solver_and("experiments.paper", __name__))


def row_of_masses(kind: str, speed: float, masses: list[float]) -> Result:
    """Return the rows of one impact speed (m/s)."""
    objects = np.array(masses)
    tools = 0.5 * objects if kind == "both" else np.full(len(objects), 0.125)
    spring = _velocity(LINEAR, speed, objects, tools)
    one = _velocity(MECHANISM, speed, objects, tools)
    names = ("stiffness", "height", "front_stop")
    modified = [
        {f"coupling.{name}": share * getattr(MECHANISM, name) for name, share in zip(names, shares, strict=True)}
        for shares in product(MODIFIED, repeat=len(names))
    ]
    best = np.min([_velocity(MECHANISM, speed, objects, tools, **each) for each in modified], axis=0)
    columns = zip(masses, tools.tolist(), spring.tolist(), one.tolist(), best.tolist(), strict=True)
    return result_of([
        {"kind": kind, "speed": speed, "object": m_p, "tool": m_t, "spring": v, "mechanism": w, "modified": u}
        for m_p, m_t, v, w, u in columns
    ])  # fmt: skip


def _velocity(
    coupling: ig.Bistable | ig.SpringDamper, speed: float, objects: Any, tools: Any, **design: float
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return V_p (m/s) of each object and tool (n,), kg, at one impact speed (m/s)."""
    distance = speed**2 / (2.0 * MOTION.acceleration) + speed * CRUISE
    motion = ig.Trapezoid(speed, MOTION.acceleration, MOTION.brake)
    scene = held(coupling, 1e3, 0.1, distance)
    varied = {"object.mass": objects, "tool.mass": tools, **design}
    return ig.sweep(scene, motion, varied, duration=DURATION + 0.5, threads=1).object_velocity


def said(found: list[Row]) -> dict[str, Any]:
    """Return in what share of each map one tuning holds, and a modified one."""
    shares: dict[str, dict[str, float]] = {}
    for kind in MAPS:
        cells = [row for row in found if row["kind"] == kind]
        shares[kind] = {
            name: float(np.mean([row[name] <= HOLDS * row["spring"] for row in cells]))
            for name in ("mechanism", "modified")
        }
        shares[kind]["worse"] = float(np.mean([row["mechanism"] > row["spring"] for row in cells]))
    return {"holds": HOLDS, "shares": shares, "maps": MAPS}


def figure(found: list[Row]) -> Figure:
    """Return the maps of V_p over the spring's; white where they are equal, blue where the mechanism is better."""
    drawn = Figure(figsize=(10.6, 8.0))
    grid = drawn.subplots(2, len(MAPS), sharex=True, sharey=True)
    what = {"mechanism": "the paper's tuning", "modified": "best small modification"}
    for axes, (name, kind) in zip(grid.flat, product(what, MAPS), strict=True):
        cells = [row for row in found if row["kind"] == kind]
        speeds, objects = (np.unique([row[column] for row in cells]) for column in ("speed", "object"))
        ratio = np.array([row[name] / row["spring"] for row in cells]).reshape(len(speeds), len(objects)).T
        norm = TwoSlopeNorm(1.0, 0.4, 1.6)
        mesh = axes.pcolormesh(speeds, objects, ratio, cmap="RdBu_r", norm=norm, shading="nearest", rasterized=False)
        axes.contour(speeds, objects, ratio, levels=[HOLDS], colors="black", linewidths=1.0)
        axes.plot(MOTION.speed, 0.25, "k*", markersize=10)
        axes.set(yscale="log")
        axes.set_yticks(TICKS, [f"{mass:g}" for mass in TICKS])
        axes.set_title(f"{what[name]}; {MAPS[kind]}", fontsize=9)
        axes.grid(visible=False)
    for axes in grid[-1]:
        axes.set_xlabel("impact speed (m/s)")
    for axes in grid[:, 0]:
        axes.set_ylabel("object's mass (kg)")
    drawn.colorbar(mesh, ax=grid, label="V_p, mechanism over spring")
    return drawn
