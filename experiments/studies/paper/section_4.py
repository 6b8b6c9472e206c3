"""Section 4, the tool on spring and damper (stiffness k_t): Fig. 16 to 20."""

from collections.abc import Mapping
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.signal import find_peaks

import impact_gym as ig
from experiments.lab.scenes import DISTANCE, DURATION, MOTION, STEADY, scene
from experiments.lab.study import Row
from experiments.studies.paper.runs import Array, Numbers, Run, changes, enclose_changes, histories, runs_of, where

CONTACT_STIFFNESSES = (1e3, 1e4, 1e5)  # N/m^1.5
COUPLING_STIFFNESSES = np.linspace(5.0, 200.0, 196)  # N/m
SETTLED_STIFFNESSES = COUPLING_STIFFNESSES[::5]  # N/m
SETTLED = 4.0  # m, distance at which the tool's transient after the acceleration has decayed at every k_t
CRITICAL, DAMPED = {"damping_ratio": 1.0}, {"coupling_stiffness": 150.0}  # what is constant along a curve (-, N/m)
RESTITUTION = 0.1  # restitution of Fig. 18 to 20
SPRING = ig.SpringDamper(150.0)  # of Fig. 17, 19 and 20
INELASTIC = {"a": scene(1e5, RESTITUTION, SPRING), "b": scene(1e3, RESTITUTION, SPRING)}  # Fig. 19 and 20


def _point(
    k_t: float, k_c: float, restitution: float, zeta: float = 1.0, distance: float = DISTANCE, braked: bool = True
) -> Row:
    approach = scene(k_c, restitution, ig.SpringDamper(k_t, zeta), distance=distance)
    outcome = ig.simulate(approach, MOTION if braked else STEADY, DURATION + distance / MOTION.speed)
    return {
        "braked": braked, "distance": distance, "damping_ratio": zeta, "contact_stiffness": k_c,
        "coupling_stiffness": float(k_t), "contacts": len(outcome.contacts),
        "object_velocity": outcome.object_velocity, "object_velocity_first": outcome.contacts[0].object_velocity,
    }  # fmt: skip


def _sweep(restitution: float) -> list[Row]:
    """Simulate the paper's curves, and the curves at the distance SETTLED."""
    rows: list[Row] = []
    for k_c in CONTACT_STIFFNESSES:
        along = partial(_point, k_c=k_c, restitution=restitution)
        rows += enclose_changes(COUPLING_STIFFNESSES, along, "coupling_stiffness", "contacts")
    pairs = product(CONTACT_STIFFNESSES, SETTLED_STIFFNESSES)
    return rows + [_point(k_t, k_c, restitution, distance=SETTLED) for k_c, k_t in pairs]


def figure_16() -> list[Row]:
    """Simulate the curves of `_sweep`, and several damping ratios at k_t = 150 N/m."""
    ratios = [zeta for zeta in np.round(np.arange(0.1, 2.0001, 0.05), 2).tolist() if zeta != 1.0]  # `_sweep` has 1
    return _sweep(1.0) + [_point(150.0, k_c, 1.0, zeta) for k_c in CONTACT_STIFFNESSES for zeta in ratios]


def figure_18() -> list[Row]:
    """Simulate the curves of `_sweep`, and points at SETTLED_STIFFNESSES without a brake."""
    pairs = product(CONTACT_STIFFNESSES, SETTLED_STIFFNESSES)
    return _sweep(RESTITUTION) + [_point(k_t, k_c, RESTITUTION, braked=False) for k_c, k_t in pairs]


def curves(
    frame: pl.DataFrame, distance: float = DISTANCE, braked: bool = True, at: Mapping[str, float] = CRITICAL
) -> list[dict[str, Array]]:
    """Return a curve for each contact stiffness: the columns of the rows that the arguments select."""
    rows = frame.sort("damping_ratio", maintain_order=True).filter(braked=braked, distance=distance, **at)
    return [where(rows, contact_stiffness=k_c) for k_c in CONTACT_STIFFNESSES]


def _velocities(frame: pl.DataFrame, **line: Any) -> Array:
    """Return V_p as an array (contact stiffnesses, points of a curve); `line`: arguments of `curves`."""
    points = frame.filter(pl.col("coupling_stiffness").is_in(COUPLING_STIFFNESSES.tolist()))
    return np.array([rows["object_velocity"] for rows in curves(points, **line)])


def _rising_from(frame: pl.DataFrame) -> Array:
    """Return for each contact stiffness the coupling stiffness (N/m) above which V_p rises at every step."""
    falls = [np.flatnonzero(steps <= 0) for steps in np.diff(_velocities(frame))]
    return np.array([COUPLING_STIFFNESSES[at[-1] + 1 if at.size else 0] for at in falls])


def _places(holds: NDArray[np.bool_]) -> str:
    """Return in words at how many values of k_t a condition holds, and where it does not."""
    broken = COUPLING_STIFFNESSES[~holds]
    where_not = f"; not at {broken.min():g} to {broken.max():g} N/m" if broken.size else ""
    return f"holds at {holds.sum()} of {holds.size} values of k_t{where_not}"


def _numbers_figure_16(frame: pl.DataFrame) -> Numbers:
    soft, middle, stiff = grid = _velocities(frame)
    settled_steps = np.diff(_velocities(frame, distance=SETTLED))
    damped_steps = np.diff(_velocities(frame, at=DAMPED))
    inner = COUPLING_STIFFNESSES[1:-1]
    jump = np.where((inner > 60.0) & (inner < 120.0), np.diff(stiff, n=2), -np.inf)
    slope_break = float(inner[np.argmax(jump)])
    (onset, before, after), *_ = changes(curves(frame)[-1], "coupling_stiffness", "contacts")
    return {
        "largest": grid.max(), "rising_from": _rising_from(frame),
        "damping_falls": (damped_steps <= 0).sum(axis=1),
        "settled_steps": settled_steps, "settled_rises": (settled_steps > 0).sum(axis=1),
        "soft": soft, "middle": middle, "stiff": stiff, "order": _places((soft > middle) & (middle > stiff)),
        "slope_break": slope_break, "onset": onset, "apart": abs(onset - slope_break),
        "contacts_before": before, "contacts_after": after,
    }  # fmt: skip


def _numbers_figure_18(frame: pl.DataFrame) -> Numbers:
    soft, middle, stiff = grid = _velocities(frame)
    unbraked_steps = np.diff(_velocities(frame, braked=False), axis=0)
    at_150 = grid[:, (COUPLING_STIFFNESSES == 150.0).argmax()]
    return {
        "soft": soft, "middle": middle, "stiff": stiff, "order": _places((soft < middle) & (middle < stiff)),
        "softest_slowest": ((soft < middle) & (soft < stiff)).sum(), "steps_unbraked": unbraked_steps,
        "ordered_unbraked": (unbraked_steps > 0).all(axis=0).sum(), "values_unbraked": unbraked_steps.shape[1],
        "at_150": at_150, "steps_at_150": np.diff(at_150), "rising_from": _rising_from(frame),
    }  # fmt: skip


def figure_17() -> pl.DataFrame:
    """Simulate Fig. 17a and 17b."""
    return histories({"a": scene(1e5, 1.0, SPRING), "b": scene(1e4, 1.0, SPRING)})


def _numbers_figure_17(frame: pl.DataFrame) -> Numbers:
    both = a, b = runs_of(frame)
    before = a.part(np.cumsum(a.contact) == 0)
    stretch = 1e3 * (before.tool_position - before.flange_position)
    ahead = (before.tool_velocity - before.flange_velocity)[before.time > MOTION.speed / MOTION.acceleration]
    times = [1e3 * (run.first_contact.time - run.first_contact.time[0]) for run in both]
    compressions = [1e3 * (run.first_contact.flange_position - run.first_contact.tool_position) for run in both]
    reached = [np.interp(a.duration, *points) for points in zip(times, compressions, strict=True)]  # when (a) separates
    return {
        "a": a, "b": b, "peaks": [len(find_peaks(run.trace.contact_force, 0.1 * run.peak_force)[0]) for run in both],
        "lag": -stretch.min(), "ahead_most": stretch.max(),
        "faster_share": 100 * np.mean(ahead > 0.0),  # %, share of points, and so of time: points are 1 ms apart
        "faster_most": ahead.max(), "faster_last": ahead[-1],
        "compressions": [values.max() for values in compressions], "reached": reached,
        "restitution_error": max(abs(run.restitution - 1.0) for run in both),
    }  # fmt: skip


def figure_19() -> pl.DataFrame:
    """Simulate Fig. 19a and 19b with their restitution and with restitution 1, each with and without a brake."""
    cases = INELASTIC | {"a, e = 1": scene(1e5, 1.0, SPRING), "b, e = 1": scene(1e3, 1.0, SPRING)}
    never = {f"{case}, no brake": approach for case, approach in cases.items()}
    return pl.concat([histories(cases), histories(never, STEADY)])


def _share_before_the_brake(run: Run) -> float:
    begin = run.trace.time[np.argmax((run.trace.flange_velocity < MOTION.speed) & (run.contact > 0))]
    return float(100 * np.interp(begin, run.trace.time, run.trace.object_velocity)) / run.final_velocity


def _coupling(touching: ig.Trace) -> Numbers:
    behind = int(np.argmax(touching.tool_velocity < touching.flange_velocity))
    stretch = np.max(touching.tool_position - touching.flange_position)
    gain, time = touching.tool_velocity[behind:] - touching.flange_velocity[behind:], touching.time
    slower = "throughout"
    if (gain >= 0.0).any():
        until = time[behind + np.argmax(gain >= 0.0)] - time[0]
        slower = f"for the first {1e3 * until:.0f} of {1e3 * np.ptp(time):.0f} ms"
    return {
        "push": touching.coupling_force[behind:].min(), "gain": gain.max(), "slower": slower,
        "stretch": stretch, "compressed": "always" if stretch < 0.0 else "not always",
    }  # fmt: skip


def _numbers_figure_19(frame: pl.DataFrame) -> Numbers:
    both = a, b = runs_of(frame)
    elastic = [Run(frame, f"{case}, e = 1") for case in "ab"]
    steady = [Run(frame, f"{case}, no brake") for case in ("a", "b", "a, e = 1", "b, e = 1")]
    braked, free = ([run.final_velocity for run in each] for each in ([*both, *elastic], steady))
    return {
        "a": a, "b": b, "elastic": elastic, "saved": 100.0 * (1.0 - np.divide(braked, free)),
        "shares": [_share_before_the_brake(run) for run in both],
        "parting": [run.during_contact.flange_velocity[-1] for run in both],
        "restitutions_felt": [
            (run.felt_contact.object_velocity[-1] - run.felt_contact.tool_velocity[-1]) / run.impact_velocity
            for run in both
        ],
        "contact": [_coupling(run.first_contact) for run in both],
        "felt": [_coupling(run.felt_contact) for run in both],
    }  # fmt: skip


figure_20 = figure_19


def _numbers_figure_20(frame: pl.DataFrame) -> Numbers:
    both = a, b = runs_of(frame)
    felt = [run.felt_contact for run in both]
    impulses_felt = [float(np.trapezoid(contact.coupling_force, contact.time)) for contact in felt]
    nominal = np.array([run.equation_22(RESTITUTION, run.impulse) for run in both])
    nominal_felt = np.array([run.equation_22(RESTITUTION, J) for run, J in zip(both, impulses_felt, strict=True)])
    velocities_felt = np.array([contact.object_velocity[-1] for contact in felt])
    return {
        "a": a, "b": b, "same_order": (a.impulse - b.impulse) * (a.final_velocity - b.final_velocity),
        "identity": max(abs(run.equation_22(run.restitution, run.impulse) / run.final_velocity - 1.0) for run in both),
        "drawn_error": max(abs(run.running_impulse()[1][-1] / run.impulse - 1.0) for run in both),
        "nominal": nominal, "nominal_error": np.abs(nominal / [run.final_velocity for run in both] - 1.0),
        "velocities_felt": velocities_felt,
        "nominal_felt": nominal_felt, "nominal_error_felt": np.abs(nominal_felt / velocities_felt - 1.0),
    }  # fmt: skip
