"""Section 4, the tool behind spring and damper: Fig. 16 and 18, V_p against the stiffness of the coupling.

Where the number of contacts changes between two points of the grid, the change is enclosed by
bisection and both ends of the enclosure become points of the curve. Beside the paper's approach there is one to an
object so far ahead that the tool no longer swings when it arrives.
"""

from functools import partial

import numpy as np
import polars as pl
from numpy.typing import NDArray

import impact_gym as ig
from experiments.lab.charts import SERIES
from experiments.lab.scenes import DISTANCE, DURATION, MOTION, STEADY, decoupled
from experiments.studies.paper import runs
from experiments.studies.paper.layouts import Panels, Reproduction, mark, panels
from experiments.studies.paper.runs import Array, Columns, Numbers, Row, enclose_changes, where

CONTACT_STIFFNESSES = (1e3, 1e4, 1e5)  # N/m^1.5
COUPLING_STIFFNESSES = np.linspace(5.0, 200.0, 196)  # N/m
SETTLED_STIFFNESSES = COUPLING_STIFFNESSES[::5]  # N/m
SETTLED = 4.0  # m, distance after which the swing from the acceleration has died away at every k_t
DAMPED_STIFFNESS = 150.0  # N/m
DAMPING_RATIOS = np.round(np.arange(0.1, 2.0001, 0.05), 2)
RESTITUTION = 0.1  # of Fig. 18


def _point(
    k_t: float, k_c: float, restitution: float, zeta: float = 1.0, distance: float = DISTANCE, braked: bool = True
) -> Row:
    """Simulate one approach; a row of the frame."""
    scene = decoupled(k_c, restitution, k_t, zeta, distance)
    outcome = ig.simulate(scene, MOTION if braked else STEADY, DURATION + distance / MOTION.speed)
    return {
        "braked": braked, "distance": distance, "damping_ratio": zeta, "contact_stiffness": k_c,
        "coupling_stiffness": float(k_t),
        "contacts": len(outcome.contacts), "object_velocity": outcome.object_velocity,
        "object_velocity_first": outcome.contacts[0].object_velocity,
    }  # fmt: skip


def _sweep(restitution: float) -> list[Row]:
    """Simulate the curves of the paper and those of the settled tool."""
    rows: list[Row] = []
    for k_c in CONTACT_STIFFNESSES:
        along = partial(_point, k_c=k_c, restitution=restitution)
        rows += enclose_changes(COUPLING_STIFFNESSES, along, "coupling_stiffness", "contacts")
    for k_c in CONTACT_STIFFNESSES:
        rows += [_point(k_t, k_c, restitution, distance=SETTLED) for k_t in SETTLED_STIFFNESSES]
    return rows


def figure_16() -> list[Row]:
    """Simulate the curves, and at one k_t a row over the damping ratio."""
    ratios = DAMPING_RATIOS[DAMPING_RATIOS != 1.0].tolist()  # that one is on the curve
    return _sweep(1.0) + [_point(DAMPED_STIFFNESS, k_c, 1.0, zeta) for k_c in CONTACT_STIFFNESSES for zeta in ratios]


def figure_18() -> list[Row]:
    """Simulate the curves, and some of their points without a brake."""
    pairs = [(k_t, k_c) for k_c in CONTACT_STIFFNESSES for k_t in SETTLED_STIFFNESSES]
    return _sweep(RESTITUTION) + [_point(k_t, k_c, RESTITUTION, braked=False) for k_t, k_c in pairs]


def curve(frame: pl.DataFrame, k_c: float, distance: float = DISTANCE, braked: bool = True) -> Columns:
    """Return the rows of one curve, by rising coupling stiffness."""
    return where(frame, braked=braked, distance=distance, damping_ratio=1.0, contact_stiffness=k_c)


def changes(frame: pl.DataFrame, k_c: float) -> list[tuple[float, int, int]]:
    """Return where the number of contacts changes: k_t (N/m), contacts below and above it."""
    return runs.changes(curve(frame, k_c), "coupling_stiffness", "contacts")


def _on_grid(frame: pl.DataFrame) -> list[Array]:
    """Return V_p of each curve at the points of the grid, which are the same for all."""
    curves = [curve(frame, k_c) for k_c in CONTACT_STIFFNESSES]
    return [rows["object_velocity"][np.isin(rows["coupling_stiffness"], COUPLING_STIFFNESSES)] for rows in curves]


def _rising_from(frame: pl.DataFrame) -> Array:
    """Return for each contact stiffness the coupling stiffness (N/m) from which on V_p rises at every step."""
    falls = [np.flatnonzero(np.diff(velocity) <= 0) for velocity in _on_grid(frame)]
    return np.array([COUPLING_STIFFNESSES[at[-1] + 1 if at.size else 0] for at in falls])


def _places(holds: NDArray[np.bool_]) -> str:
    """Return in words at how many points of the grid something holds, and between which it does not."""
    broken = COUPLING_STIFFNESSES[~holds]
    where_not = f"; not at {broken.min():g} to {broken.max():g} N/m" if broken.size else ""
    return f"holds at {holds.sum()} of {holds.size} values of k_t{where_not}"


def _draw(axes: Panels, frame: pl.DataFrame) -> None:
    """Draw a curve per contact stiffness and mark where the number of contacts changes."""
    for colour, k_c in zip(SERIES, CONTACT_STIFFNESSES, strict=False):
        rows, far = curve(frame, k_c), curve(frame, k_c, SETTLED)
        stiffness, velocity = rows["coupling_stiffness"], rows["object_velocity"]
        label = f"k_c = $10^{round(np.log10(k_c))}$ N/m$^{{1.5}}$"
        axes.plot(stiffness, velocity, color=colour, label=label)
        axes.plot(far["coupling_stiffness"], far["object_velocity"], color=colour, linewidth=0.8, linestyle="--")
        at = np.isin(stiffness, [stiffness_below for stiffness_below, _, _ in changes(frame, k_c)])
        mark(axes, stiffness[at], velocity[at], colour)
    axes.plot([], [], color="black", linewidth=0.8, linestyle="--", label="ours: tool settled before the impact")
    if any(changes(frame, k_c) for k_c in CONTACT_STIFFNESSES):
        mark(axes, [], [], label="number of contacts changes")
    axes.set(xlabel="coupling stiffness k_t (N/m)", ylabel="final object velocity V_p (m/s)")
    axes.legend(fontsize=9)


def _damping_row(frame: pl.DataFrame, k_c: float) -> Columns:
    """Return the row over the damping ratio at one k_c."""
    place = {"contact_stiffness": k_c, "coupling_stiffness": DAMPED_STIFFNESS}
    return where(frame.sort("damping_ratio"), braked=True, distance=DISTANCE, **place)


@panels(10.6, 4.6, columns=2, sharey=True, width_ratios=(3, 2))
def _plot_16(frame: pl.DataFrame, grid: Panels) -> None:
    left, right = grid
    _draw(left, frame)
    for colour, k_c in zip(SERIES, CONTACT_STIFFNESSES, strict=False):
        rows = _damping_row(frame, k_c)
        ratio = rows["damping_ratio"]
        right.plot(ratio, rows["object_velocity"], color=colour)
        right.plot(ratio, rows["object_velocity_first"], color=colour, linestyle=":")
        turns = np.flatnonzero(np.diff(rows["contacts"]))
        mark(right, ratio[turns], rows["object_velocity"][turns], colour)
    right.plot([], [], color="black", linestyle=":", label="after the first contact")
    right.legend(fontsize=9)
    left.set_title("e = 1, $\\zeta$ = 1")
    right.set(title="ours: e = 1, k_t = 150 N/m", xlabel="damping ratio $\\zeta$", ylabel="V_p (m/s)")


def _numbers_16(frame: pl.DataFrame) -> Numbers:
    soft, middle, stiff = grid = _on_grid(frame)
    settled = np.array([curve(frame, k_c, SETTLED)["object_velocity"] for k_c in CONTACT_STIFFNESSES])
    damped = [_damping_row(frame, k_c)["object_velocity"] for k_c in CONTACT_STIFFNESSES]
    inner = COUPLING_STIFFNESSES[1:-1]
    jump = np.where((inner > 60.0) & (inner < 120.0), np.diff(stiff, n=2), -np.inf)
    slope_break = float(inner[np.argmax(jump)])
    (onset, before, after), *_ = changes(frame, 1e5)
    return {
        "largest": np.max(grid),
        "rising_from": _rising_from(frame),
        "damping_falls": [(np.diff(velocity) <= 0).sum() for velocity in damped],
        "settled_steps": np.diff(settled), "settled_rises": (np.diff(settled) > 0).sum(axis=1),
        "soft": soft, "middle": middle, "stiff": stiff,
        "order": _places((soft > middle) & (middle > stiff)),
        "slope_break": slope_break, "onset": onset, "apart": abs(onset - slope_break),
        "contacts_before": before, "contacts_after": after,
    }  # fmt: skip


@panels(7.0, 4.6)
def _plot_18(frame: pl.DataFrame, axes: Panels) -> None:
    _draw(axes, frame)
    axes.set_title("e = 0.1, $\\zeta$ = 1")


def _numbers_18(frame: pl.DataFrame) -> Numbers:
    soft, middle, stiff = grid = _on_grid(frame)
    unbraked = [curve(frame, k_c, braked=False)["object_velocity"] for k_c in CONTACT_STIFFNESSES]
    steadily = (unbraked[0] < unbraked[1]) & (unbraked[1] < unbraked[2])
    at_150 = [velocity[(COUPLING_STIFFNESSES == 150.0).argmax()] for velocity in grid]
    return {
        "soft": soft, "middle": middle, "stiff": stiff,
        "order": _places((soft < middle) & (middle < stiff)),
        "softest_slowest": ((soft < middle) & (soft < stiff)).sum(),
        "steps_unbraked": np.diff(unbraked, axis=0),
        "ordered_unbraked": steadily.sum(), "values_unbraked": steadily.size,
        "at_150": at_150, "steps_at_150": np.diff(at_150),
        "rising_from": _rising_from(frame),
    }  # fmt: skip


FIGURES = {
    "figure_16": Reproduction(figure_16, _plot_16, _numbers_16),
    "figure_18": Reproduction(figure_18, _plot_18, _numbers_18),
}
