"""Section 2.2, non-instantaneous impact: an approach at 1 m/s without a brake, tool fixed (a) and free (b).

Two free masses meet as an imposed tool meets one object of their reduced mass: same penetration, same force.
"""

from collections.abc import Iterable

import numpy as np
import polars as pl

import impact_gym as ig
from experiments.lab.charts import FORCE, OBJECT, SERIES, TOOL
from experiments.lab.scenes import OBJECT_MASS, REDUCED_MASS, STEADY, TOOL_MASS, scene, simulate_with_trace
from experiments.studies.paper.layouts import Panels, Reproduction, mark, panels
from experiments.studies.paper.runs import Array, Columns, Numbers, Row, Run, histories, where
from impact_gym.physics import impact

TITLES = ("(a) tool fixed to the robot", "(b) tool decoupled from the robot")
STIFFNESS, RESTITUTION = 1e5, 0.5  # of Fig. 5
SCENES = {"a": scene(STIFFNESS, RESTITUTION), "b": scene(STIFFNESS, RESTITUTION, object_mass=REDUCED_MASS)}
STIFFNESSES = np.logspace(3.0, 6.0, 25)  # N/m^1.5
RESTITUTIONS = (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)  # as given to eq. 7
CUT = 1e5  # N/m^1.5, where more restitutions are looked at
CUT_RESTITUTIONS = np.round(np.arange(0.05, 1.0001, 0.025), 3)
VANISHING = (0.05, 0.02, 0.01, 0.005)  # restitutions below those of the curves
CONTACTS = {
    "linear": ig.Contact(5e3, RESTITUTION, "exact", stiffness_exponent=1.0, damping_exponent=0.0),
    "paper": ig.Contact(1e5, RESTITUTION),
}
SPEEDS = (0.5, 1.0, 2.0)  # m/s, of the tool
NOMINAL = np.round(np.linspace(0.01, 1.0, 100), 2)
SMALL = 0.3  # what we call a small restitution; the paper does not say
LAWS = {"hu-guo": "eq. 7 (Hu and Guo)", "hunt-crossley": "Hunt and Crossley"}


def figure_05() -> pl.DataFrame:
    """Simulate both cases."""
    return histories(SCENES, STEADY, duration=0.5)


def parts(frame: pl.DataFrame, case: str) -> tuple[Array, Array, Array]:
    """Return time (s), elastic part and damping part of the contact force (N)."""
    trace = Run(frame, case).trace
    penetration = np.maximum(trace.tool_position - trace.object_position, 0.0)
    elastic = np.where(trace.contact_force > 0.0, STIFFNESS * penetration**1.5, 0.0)
    return trace.time, elastic, trace.contact_force - elastic


@panels(10.4, 3.8, columns=2, sharex=True, sharey=True)
def _plot_05(frame: pl.DataFrame, grid: Panels) -> None:
    for axes, case, title in zip(grid, SCENES, TITLES, strict=True):
        time, elastic, damping = parts(frame, case)
        axes.plot(time, elastic + damping, color=FORCE, label="contact force")
        axes.plot(time, elastic, color=TOOL, linestyle="--", label="elastic part")
        axes.plot(time, damping, color=OBJECT, linestyle=":", label="damping part")
        axes.set(title=title, xlabel="time (s)", ylabel="force (N)", xlim=(0.31, 0.335))
        axes.legend()


def _numbers_05(frame: pl.DataFrame) -> Numbers:
    a, b = (Run(frame, case) for case in SCENES)
    peak_a, peak_b = a.trace.contact_force.max(), b.trace.contact_force.max()
    time, _, damping = parts(frame, "a")
    last = int(np.flatnonzero((damping[:-1] > 0.0) & (damping[1:] <= 0.0))[0])
    fraction = damping[last] / (damping[last] - damping[last + 1])
    return {
        "peak_a": peak_a,
        "peak_b": peak_b,
        "peak_ratio": peak_a / peak_b,
        "duration_a": 1e3 * a.duration_of_contact,
        "duration_b": 1e3 * b.duration_of_contact,
        "turn": float(time[last] + fraction * (time[last + 1] - time[last])),
        "damping_at_ends": 100.0 * np.abs(damping[a.contact > 0][[0, -1]]).max() / damping.max(),
        "least": min(run.trace.contact_force.min() for run in (a, b)),
    }


def _sweep(pairs: Iterable[tuple[float, float]]) -> list[Row]:
    """Simulate both cases for every (contact stiffness, restitution).

    The free tool as in Fig. 5: the impulse on the object of reduced mass is that on the free one.
    """
    rows: list[Row] = []
    for stiffness, restitution in pairs:
        for free, mass in enumerate((OBJECT_MASS, REDUCED_MASS)):
            outcome, trace = simulate_with_trace(scene(stiffness, restitution, object_mass=mass), STEADY, 2.0)
            (contact,) = outcome.contacts
            assert contact.end is not None  # the run is long enough
            penetration = np.max(trace.tool_position - trace.object_position)
            rows.append({
                "free": free, "contact_stiffness": stiffness, "restitution": restitution,
                "peak_force": contact.peak_force, "duration": contact.end - contact.start,
                "object_velocity": contact.impulse / OBJECT_MASS, "penetration": penetration,
                "separation_velocity": contact.separation_velocity,
            })  # fmt: skip
    return rows


def grid_values(frame: pl.DataFrame, column: str, free: int) -> Array:
    """Return `column` of one limit case over (restitution, contact stiffness)."""
    rows = [where(frame, free=free, restitution=e) for e in RESTITUTIONS]  # each by rising stiffness
    return np.array([row[column][np.isin(row["contact_stiffness"], STIFFNESSES)] for row in rows])


def _draw(grid: Panels, frame: pl.DataFrame, column: str, label: str) -> None:
    """Draw `column` against k_c, a panel of `grid` (2,) per limit case and a curve per restitution."""
    for free, axes in enumerate(grid):
        for colour, e, values in zip(SERIES, RESTITUTIONS, grid_values(frame, column, free), strict=True):
            axes.loglog(STIFFNESSES, values, color=colour, label=f"e = {e:g}")
        axes.set(title=TITLES[free], xlabel="contact stiffness k_c (N/m$^{1.5}$)", ylabel=label)
        axes.legend(ncols=2, fontsize=9)
    limits = [axes.get_ylim() for axes in grid]
    for axes in grid:
        axes.set_ylim(np.min(limits), np.max(limits))


def figure_06() -> list[Row]:
    """Simulate the grid of (a) and (b), and a finer row over e at one k_c."""
    grid = {(float(k), e) for e in RESTITUTIONS for k in STIFFNESSES}
    return _sweep(sorted(grid | {(CUT, float(e)) for e in CUT_RESTITUTIONS}))


@panels(15.0, 4.2, columns=3)
def _plot_06(frame: pl.DataFrame, grid: Panels) -> None:
    *limit_cases, last = grid
    _draw(limit_cases, frame, "peak_force", "largest contact force (N)")
    for free, colour, label in ((0, OBJECT, "tool fixed"), (1, TOOL, "tool decoupled")):
        row = where(frame, free=free, contact_stiffness=CUT)  # by rising restitution
        restitution, force = row["restitution"], row["peak_force"]
        last.plot(restitution, force, color=colour, label=label)
        lowest = int(np.argmin(force))
        mark(last, restitution[lowest], force[lowest], colour)
    mark(last, [], [], label="smallest")
    last.set(xlabel="restitution e given to eq. 7", ylabel="largest contact force (N)", ylim=(0, None))
    last.set_title("(c) ours, at k_c = $10^5$ N/m$^{1.5}$")
    last.legend()


def _numbers_06(frame: pl.DataFrame) -> Numbers:
    peaks, depths, velocities = (
        np.array([grid_values(frame, column, free) for free in (0, 1)])
        for column in ("peak_force", "penetration", "object_velocity")
    )
    row = where(frame, free=0, contact_stiffness=CUT)
    force, lowest = row["peak_force"], np.argmin(row["peak_force"])
    return {
        "peak_steps": np.diff(peaks, axis=-1),
        "depth_steps": np.diff(depths, axis=-1),
        "depth_ends": 1e3 * depths[0, -1, [0, -1]],
        "energy_spread": (np.ptp(velocities, axis=-1) / velocities.mean(axis=-1)).max(),
        "force_steps": np.diff(force),
        "force_elastic": force[-1],
        "force_lowest": force[lowest],
        "lowest_at": row["restitution"][lowest],
        "force_inelastic": force[0],
        "ratio": peaks[0] / peaks[1],
        "mean_ratio": (peaks[0] / peaks[1]).mean(),
    }


def figure_07() -> list[Row]:
    """Simulate the grid, and at one k_c what becomes of a restitution that tends to zero."""
    return _sweep([(float(k), e) for e in RESTITUTIONS for k in STIFFNESSES] + [(CUT, e) for e in VANISHING])


@panels(10.0, 4.2, columns=2)
def _plot_07(frame: pl.DataFrame, grid: Panels) -> None:
    _draw(grid, frame, "duration", "duration of the contact (s)")


def _numbers_07(frame: pl.DataFrame) -> Numbers:
    durations = np.array([grid_values(frame, "duration", free) for free in (0, 1)])
    instantaneous = impact.free_tool(TOOL_MASS, OBJECT_MASS, 1.0, 0.0, np.array(RESTITUTIONS))[1]
    error = 100.0 * np.abs(grid_values(frame, "object_velocity", 1)[:, 0] / instantaneous - 1.0)
    at_cut = frame.filter(free=1, contact_stiffness=CUT)
    parting = [where(at_cut, restitution=e)["separation_velocity"][0] for e in VANISHING]
    return {
        "stiffness_steps": np.diff(durations, axis=2),
        "restitution_steps": np.diff(durations, axis=1),
        "longer": durations[0, 0, 0] / durations[0, -1, 0],
        "parting_steps": np.diff(parting),
        "parting_first": parting[0],
        "parting_last": parting[-1],
        "ratio": durations[0] / durations[1],
        "mean_ratio": (durations[0] / durations[1]).mean(),
        "error": error.max(),
        "error_at": RESTITUTIONS[int(np.argmax(error))],
    }


def _contact(case: str, speed: float) -> pl.DataFrame:
    """Simulate one contact; return its rows of the frame, time from the touch on (s)."""
    contact = CONTACTS[case]
    approach = ig.Scene(ig.Tool(TOOL_MASS), ig.Object(OBJECT_MASS, speed**2 / STEADY.acceleration), contact)
    outcome, trace = simulate_with_trace(approach, ig.Trapezoid(speed, STEADY.acceleration))
    (record,) = outcome.contacts
    assert record.end is not None  # without a coupling a contact ends
    depth = np.maximum(trace.tool_position - trace.object_position, 0.0)
    elastic = contact.stiffness * depth**contact.stiffness_exponent
    rows = (trace.time >= record.start) & (trace.time <= record.end)
    columns = {"time": trace.time[rows] - record.start, "force": trace.contact_force[rows], "elastic": elastic[rows]}
    constants = {
        "case": case, "speed": speed, "nominal": RESTITUTION,
        "delivered": record.separation_velocity / record.approach_velocity,
    }  # fmt: skip
    return pl.DataFrame(columns).with_columns(pl.lit(value).alias(name) for name, value in constants.items())


def beyond_contact() -> pl.DataFrame:
    """Simulate both contacts at every speed, and evaluate both laws, which have no motion."""
    laws = [
        pl.DataFrame({"nominal": NOMINAL, "delivered": np.asarray(ig.effective_restitution(law, NOMINAL))})
        .with_columns(pl.lit(law).alias("case"))
        for law in LAWS
    ]  # fmt: skip
    return pl.concat([*(_contact(case, speed) for case in CONTACTS for speed in SPEEDS), *laws], how="diagonal")


@panels(10.6, 4.2, columns=2)
def _plot_contact(frame: pl.DataFrame, grid: Panels) -> None:
    left, right = grid
    for case, label, colour in (("linear", "linear", TOOL), ("paper", "the paper's", FORCE)):
        rows = where(frame, case=case, speed=1.0)
        left.plot(1e3 * rows["time"], rows["force"], color=colour, label=f"{label}: force")
        damping = np.where(rows["force"] > 0.0, rows["force"] - rows["elastic"], np.nan)  # none once it has let go
        left.plot(1e3 * rows["time"], damping, ":", color=colour, label="damping part")
    left.set(xlabel="time since the touch (ms)", ylabel="force (N)", title="e = 0.5")
    for (law, label), colour in zip(LAWS.items(), (OBJECT, TOOL), strict=True):
        rows = where(frame, case=law)
        right.plot(rows["nominal"], rows["delivered"], color=colour, label=label)
    right.plot([0.0, 1.0], [0.0, 1.0], color="#888888", linewidth=0.8, linestyle="--", label="what is asked for")
    right.set(xlabel="nominal restitution e", ylabel="restitution delivered")
    for axes in grid:
        axes.legend(fontsize=9)


def _ends(rows: Columns) -> tuple[float, float]:
    """Return the force at the touch, and that of the spring where the contact lets go, over the largest force."""
    pushing = np.flatnonzero(rows["force"] > 0.0)
    largest = rows["force"].max()
    return float(rows["force"][pushing[0]] / largest), float(rows["elastic"][pushing[-1]] / largest)


def _numbers_contact(frame: pl.DataFrame) -> Numbers:
    linear, paper = (where(frame, case=case, speed=1.0) for case in CONTACTS)
    spread = {case: np.ptp(where(frame, case=case)["delivered"]) for case in CONTACTS}
    hu_guo, hunt_crossley = (
        np.abs(rows["delivered"] - rows["nominal"])[NOMINAL < SMALL]
        for rows in (where(frame, case=law) for law in LAWS)
    )
    jump, holding_back = _ends(linear)
    return {
        "linear_spread": spread["linear"],
        "paper_spread": spread["paper"],
        "jump": 100.0 * jump,
        "end_share": holding_back,
        "holding_back": linear["force"].max() * holding_back,
        "paper_ends": max(_ends(paper)),
        "hu_guo": hu_guo,
        "hu_guo_worst": hu_guo.max(),
        "hunt_crossley": hunt_crossley,
        "hunt_crossley_worst": hunt_crossley.max(),
    }


FIGURES = {
    "figure_05": Reproduction(figure_05, _plot_05, _numbers_05),
    "figure_06": Reproduction(figure_06, _plot_06, _numbers_06),
    "figure_07": Reproduction(figure_07, _plot_07, _numbers_07),
    "beyond_contact": Reproduction(beyond_contact, _plot_contact, _numbers_contact),
}
