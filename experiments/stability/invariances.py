"""What must not matter: units, frame, order of rows, number of threads, the process. As numbers, over storm scenes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass, replace
from typing import Any

import numpy as np
from impact_gym.kernels import APPROACH, CHAIN, approach_rows

import impact_gym as ig
from agents.jobs import Result
from experiments.lab.tables import Gather, Row, result_of, solver_and
from experiments.speed_vs_error.scenes import Approach
from experiments.stability.rivals import eligible
from experiments.stability.scenes import draw, relative_error, velocity
from impact_gym.lowering import LOCAL_SHARE, approach_plan
from impact_gym.simulation import MAX_STEPS, NOTHING_RECORDED

RTOL = 1e-8  # of the runs
BOOST = 2.0  # m/s
UNITS = {"units scaled by powers of two": (8.0, 0.25, 2.0), "units scaled by 3, 0.7 and 1.3": (3.0, 0.7, 1.3)}
"""Factors of mass, length and time."""
LENGTHS = ("distance", "position", "free_length", "height", "front_stop", "rear_stop")
CONVERGED = 10 * RTOL  # relative, that a different sequence of steps may change
ROUNDING = 1e-12  # relative, in the median
SLOWEST = 1e-5  # m/s, ten times the floor of v_in, which no unit scales
MOST_STEPS = 20_000


def scaled(approach: Approach, mass: float, length: float, time: float) -> Approach:
    """Return the approach with its numbers in other units: each mass so many times as large, and so on."""
    force = mass * length / time**2
    factors = {"mass": mass, "speed": length / time, "threshold": force, "damping": force * time / length}
    factors |= dict.fromkeys(LENGTHS, length) | dict.fromkeys(("duration", "delay"), time)
    factors |= dict.fromkeys(("acceleration", "deceleration"), length / time**2)
    return _times(approach, factors | dict.fromkeys(("stiffness", "stop_stiffness"), force / length))


def _times(value: Any, factors: Mapping[str, float], factor: float = 1.0) -> Any:
    """Return a number or tuple of numbers times `factor`, or a record whose fields have theirs by name."""
    if is_dataclass(value):
        if isinstance(value, ig.Contact):  # N/m^m
            factors = {"stiffness": factors["threshold"] / factors["distance"] ** value.stiffness_exponent}
        parts = {name: getattr(value, name) for name in value.__dataclass_fields__}
        return replace(value, **{name: _times(part, factors, factors.get(name, 1.0)) for name, part in parts.items()})
    if isinstance(value, tuple):
        return tuple(one * factor for one in value)
    return value * factor if isinstance(value, float) else value


def velocity_in_frame(approach: Approach, boost: float, rtol: float) -> float:
    """V_p as someone at rest in a room of velocity `boost` (m/s) finds it, m/s; nan if the run does not finish.

    Flange, tool and object have that velocity from the start. A scene begins at rest, so that the public functions
    offer no other frame; the kernels do.
    """
    plan, table = approach_plan(*approach.run)
    plans, chains = np.array([plan], APPROACH), np.empty(1, CHAIN)
    plans["frame"] = boost
    approach_rows(plans, table, chains, 0, 1, LOCAL_SHARE * rtol, MAX_STEPS, NOTHING_RECORDED)
    (end,) = chains
    if end["status"] < 0:
        return math.nan
    object_velocity = float(end["flange_velocity"] + end["deflection_rate"] - end["penetration_rate"])
    return object_velocity - boost if end["contacts"] else 0.0


def line(name: str, differences: Sequence[float], exact: bool = True) -> Row:
    """Return a row of the table: what must not matter, by how much it does, and by how much it may.

    Where it need not be `exact`, rounding may differ, and with it the sequence of steps.
    """
    values = np.array(differences)
    median, largest, equal = float(np.median(values)), float(values.max()), float(np.mean(values == 0.0))
    if exact:
        allowed, met = "no difference at all", equal == 1.0
    else:
        allowed = f"median below {ROUNDING:g}, none above {CONVERGED:g}"
        met = median < ROUNDING and largest < CONVERGED
    found = {"scenes": len(values), "equal": equal, "median": median, "largest": largest}
    return {"contender": name, **found, "description": allowed, "met": int(met)}


def units(name: str, scenes: Sequence[int]) -> list[Row]:
    """Other units change only the numbers."""
    _, length, time = UNITS[name]
    found = []
    for approach in map(draw, scenes):
        there = velocity(scaled(approach, *UNITS[name]), RTOL) / (length / time)
        found.append(relative_error(there, velocity(approach, RTOL), approach.motion.speed))
    return [line(name, found, exact=False)]


def frame(scenes: Sequence[int]) -> list[Row]:
    """A room that moves at BOOST changes nothing within it; over V_p or BOOST, whose rounding comes in."""
    found = []
    for scene in scenes:
        here, moving = (velocity_in_frame(draw(scene), boost, RTOL) for boost in (0.0, BOOST))
        found.append(abs(moving - here) / max(abs(here), BOOST))
    return [line(f"frame moving at {BOOST:g} m/s", found, exact=False)]


def sweep_of(order: Sequence[int], threads: int) -> Any:
    """Return V_p (m/s) of a sweep over storm values, its rows those of the scenes in `order`."""
    approaches = [draw(number) for number in order]
    varied = {
        "object.mass": [a.scene.object.mass / a.scene.tool.mass for a in approaches],
        "object.distance": [a.scene.object.distance for a in approaches],
        "contact.stiffness": [a.scene.contact.stiffness for a in approaches],
        "contact.restitution": [max(a.scene.contact.restitution, 0.05) for a in approaches],
        "motion.speed": [a.motion.speed for a in approaches],
    }
    template = ig.Scene(ig.Tool(1.0), ig.Object(1.0, 0.1), ig.Contact(1e5, 0.5), ig.SpringDamper(150.0, 0.5))
    motion, durations = ig.Trapezoid(1.0, 8.0, ig.Brake()), [a.duration for a in approaches]
    found = ig.sweep(template, motion, varied, durations, RTOL, threads)
    return np.nan_to_num(found.object_velocity, nan=-1.0)  # a run that does not finish must not finish always


def sweeps(rows: int) -> list[Row]:
    """Rows in another order, and on other numbers of threads."""
    order = np.random.default_rng(0).permutation(rows)
    first = sweep_of(range(rows), 1)
    found = [line("order of the rows of a sweep", np.abs(sweep_of(order, 1) - first[order]).tolist())]
    for threads in (2, 7):
        change = np.abs(sweep_of(range(rows), threads) - first)
        found.append(line(f"{threads} threads instead of 1", change.tolist()))
    return found


def repeated(scenes: Sequence[int], velocities: Sequence[float]) -> list[Row]:
    """Scenes computed again, here and not in the processes that the storm had; V_p of those, m/s."""
    found = [abs(velocity(draw(scene), RTOL) - before) for scene, before in zip(scenes, velocities, strict=True)]
    return [line("another process, another order of scenes", found)]


CHANGES = {change.__name__: change for change in (units, frame, sweeps, repeated)}


def changed(change: str, given: Mapping[str, Any]) -> Result:
    """Return the rows of one of CHANGES."""
    return result_of(CHANGES[change](**given))


def rows(gather: Gather, size: int, storm: Sequence[Row]) -> list[Row]:
    """Return all rows, over `size` scenes each; `storm` are the rows of the storm.

    Units and frame: scenes with a contact, none slower than SLOWEST, in fewer steps than MOST_STEPS. The frame only
    those with m = n = 3/2 and a rigid robot.
    """
    done = [row for row in storm if not row["failure"]]
    struck = [int(row["scene"]) for row in done if row["slowest_contact"] > SLOWEST and row["steps"] < MOST_STEPS]
    before = {int(row["scene"]): row["object_velocity"] for row in done[:size] if row["finite"]}
    depends = solver_and("experiments.stability.scenes", "experiments.stability.rivals", __name__)
    asked: list[tuple[str, dict[str, Any]]] = [
        *(("units", {"name": name, "scenes": struck[:size]}) for name in UNITS),
        ("frame", {"scenes": [scene for scene in struck if eligible(draw(scene))][:size]}),
        ("sweeps", {"rows": max(size, 32)}),
        ("repeated", {"scenes": [*before], "velocities": [*before.values()]}),
    ]
    jobs = [{"change": change, "given": given} for change, given in asked]
    traced = line("with a trace", [row["trace_change"] for row in done if row["traced"]])
    return [*gather("invariances", changed, jobs, depends), traced]
