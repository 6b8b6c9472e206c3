"""Section 2, instantaneous and non-instantaneous impact.

The instantaneous impact of a tool at 1 m/s on an object at rest is computed in closed form (paper, eq. 1-4). The
non-instantaneous impact is simulated as an approach without a brake, at 1 m/s in the paper's figures. Case (a): the
tool is fixed to the robot. Case (b): the tool is free. Penetration and force of case (b) are those of a fixed tool and
an object with the reduced mass of tool and object. So case (b) is simulated with a fixed tool and this object.
"""

from collections.abc import Iterable

import numpy as np
import polars as pl

import impact_gym as ig
from experiments.lab import scenes
from experiments.lab.scenes import OBJECT_MASS, REDUCED_MASS, STEADY, TOOL_MASS, scene, simulate_with_trace
from experiments.lab.study import Row
from experiments.studies.paper.runs import Array, Numbers, histories, runs_of, where
from impact_gym.physics import impact
from impact_gym.scene import Dissipation

OF_MASSES = (0.0, 0.25, 0.5, 0.75, 1.0)  # restitutions of Fig. 3
MASSES = np.logspace(-2.0, 1.0, 121)  # kg, of the tool in Fig. 3
STIFFNESS, RESTITUTION = 1e5, 0.5  # contact of Fig. 5
STIFFNESSES = np.logspace(3.0, 6.0, 25).tolist()  # N/m^1.5
RESTITUTIONS = (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)  # nominal restitutions: arguments of eq. 7
CUT = 1e5  # N/m^1.5, contact stiffness for CUT_RESTITUTIONS and VANISHING
CUT_RESTITUTIONS = np.round(np.arange(0.05, 1.0001, 0.025), 3)
VANISHING = (0.05, 0.02, 0.01, 0.005)  # restitutions close to 0
CONTACTS = {
    "linear": ig.Contact(5e3, RESTITUTION, "exact", stiffness_exponent=1.0, damping_exponent=0.0),
    "paper": ig.Contact(1e5, RESTITUTION),
}
SPEEDS = (0.5, 1.0, 2.0)  # m/s, of the tool
NOMINAL = np.round(np.linspace(0.01, 1.0, 100), 2)
SMALL = 0.3  # restitutions below SMALL are called small; the paper gives no number
LAWS: tuple[Dissipation, ...] = ("hu-guo", "hunt-crossley")


def figure_02() -> pl.DataFrame:
    """Evaluate eq. 1, 3 and 4 over the restitution."""
    restitution = np.linspace(0.0, 1.0, 101)
    tool, hit = impact.free_tool(TOOL_MASS, OBJECT_MASS, 1.0, 0.0, restitution)
    fixed = impact.rigid_tool(1.0, 0.0, restitution)
    columns = {"tool_velocity": tool, "object_velocity": hit, "object_velocity_fixed": fixed}
    return pl.DataFrame({"restitution": restitution, **{name: np.asarray(column) for name, column in columns.items()}})


def _numbers_figure_02(frame: pl.DataFrame) -> Numbers:
    _, tool, hit, fixed = where(frame).values()
    return {
        "fixed_ends": fixed[[0, -1]], "object_ends": hit[[0, -1]], "tool_ends": tool[[0, -1]],
        "object_steps": np.diff(hit), "tool_change_steps": np.diff(np.abs(tool - 1.0)), "share": hit / fixed,
        "residual": np.abs(TOOL_MASS * tool + OBJECT_MASS * hit - TOOL_MASS).max(),
    }  # fmt: skip


def figure_03() -> pl.DataFrame:
    """Evaluate eq. 3 and 4 over restitution and tool mass."""
    every_mass = np.sort(np.append(MASSES, (TOOL_MASS, scenes.ROBOT_AND_TOOL)))
    restitution, mass = (axis.ravel() for axis in np.meshgrid(OF_MASSES, every_mass, indexing="ij"))
    tool, hit = (np.asarray(velocity) for velocity in impact.free_tool(mass, OBJECT_MASS, 1.0, 0.0, restitution))
    return pl.DataFrame({"restitution": restitution, "tool_mass": mass, "tool_velocity": tool, "object_velocity": hit})


def _numbers_figure_03(frame: pl.DataFrame) -> Numbers:
    curves = [where(frame, restitution=e)["object_velocity"] for e in OF_MASSES]
    heavy = where(frame, restitution=1.0, tool_mass=scenes.ROBOT_AND_TOOL)["object_velocity"][0]
    return {"steps": np.diff(curves), "ends": curves[-1][[0, -1]], "heavy": heavy}


def figure_05() -> pl.DataFrame:
    """Simulate the fixed and the free tool; `elastic` and `damping` are the parts of the contact force (N)."""
    fixed, free = (scene(STIFFNESS, RESTITUTION, object_mass=mass) for mass in (OBJECT_MASS, REDUCED_MASS))
    frame = histories({"a": fixed, "b": free}, STEADY, duration=0.5)
    force, depth = frame["contact_force"].to_numpy(), (frame["tool_position"] - frame["object_position"]).to_numpy()
    elastic = np.where(force > 0.0, STIFFNESS * np.maximum(depth, 0.0) ** 1.5, 0.0)
    return frame.with_columns(elastic=elastic, damping=force - elastic)


def _numbers_figure_05(frame: pl.DataFrame) -> Numbers:
    a, b = runs_of(frame)
    damping = where(frame, case="a")["damping"]
    around = np.flatnonzero((damping[:-1] > 0.0) & (damping[1:] <= 0.0))[0] + np.array([0, 1])
    return {
        "a": a, "b": b, "peak_ratio": a.peak_force / b.peak_force,
        "turn": np.interp(0.0, -damping[around], a.trace.time[around]),
        "damping_at_ends": 100.0 * np.abs(damping[a.contact > 0][[0, -1]]).max() / damping.max(),
        "least": min(a.trace.contact_force.min(), b.trace.contact_force.min()),
    }  # fmt: skip


def _sweep(pairs: Iterable[tuple[float, float]]) -> list[Row]:
    rows: list[Row] = []
    for stiffness, restitution in pairs:
        for free, mass in enumerate((OBJECT_MASS, REDUCED_MASS)):
            outcome, trace = simulate_with_trace(scene(stiffness, restitution, object_mass=mass), STEADY, 2.0)
            (contact,) = outcome.contacts
            assert contact.end is not None  # the contact ends during the run
            penetration = np.max(trace.tool_position - trace.object_position)
            rows.append({
                "free": free, "contact_stiffness": stiffness, "restitution": restitution,
                "peak_force": contact.peak_force, "duration": contact.end - contact.start,
                "object_velocity": contact.impulse / OBJECT_MASS, "penetration": penetration,
                "separation_velocity": contact.separation_velocity,
            })  # fmt: skip
    return rows


def _grids(frame: pl.DataFrame, column: str) -> Array:
    """Return `column` as an array (2, restitutions, stiffnesses), first for the fixed tool, then for the free tool."""
    on_grid = frame.filter(pl.col("restitution").is_in(RESTITUTIONS), pl.col("contact_stiffness").is_in(STIFFNESSES))
    ordered = on_grid.sort("free", "restitution", "contact_stiffness")[column]
    return ordered.to_numpy().reshape(2, len(RESTITUTIONS), len(STIFFNESSES))


def figure_06() -> list[Row]:
    """Simulate all pairs of RESTITUTIONS and STIFFNESSES, and CUT_RESTITUTIONS at k_c = CUT."""
    grid = {(k, e) for e in RESTITUTIONS for k in STIFFNESSES}
    return _sweep(sorted(grid | {(CUT, float(e)) for e in CUT_RESTITUTIONS}))


def _numbers_figure_06(frame: pl.DataFrame) -> Numbers:
    peaks, depths, velocities = (_grids(frame, column) for column in ("peak_force", "penetration", "object_velocity"))
    row = where(frame, free=0, contact_stiffness=CUT)
    force, lowest = row["peak_force"], np.argmin(row["peak_force"])
    return {
        "peak_steps": np.diff(peaks), "ratio": peaks[0] / peaks[1], "mean_ratio": (peaks[0] / peaks[1]).mean(),
        "depth_steps": np.diff(depths), "depth_ends": 1e3 * depths[0, -1, [0, -1]],
        "energy_spread": (np.ptp(velocities, axis=-1) / velocities.mean(axis=-1)).max(),
        "force_steps": np.diff(force), "force_ends": force[[0, -1]],
        "force_lowest": force[lowest], "lowest_at": row["restitution"][lowest],
    }  # fmt: skip


def figure_07() -> list[Row]:
    """Simulate all pairs of RESTITUTIONS and STIFFNESSES, and VANISHING at k_c = CUT."""
    return _sweep([(k, e) for e in RESTITUTIONS for k in STIFFNESSES] + [(CUT, e) for e in VANISHING])


def _numbers_figure_07(frame: pl.DataFrame) -> Numbers:
    durations = _grids(frame, "duration")
    instantaneous = impact.free_tool(TOOL_MASS, OBJECT_MASS, 1.0, 0.0, np.array(RESTITUTIONS))[1]
    error = 100.0 * np.abs(_grids(frame, "object_velocity")[1, :, 0] / instantaneous - 1.0)
    at_cut = frame.filter(free=1, contact_stiffness=CUT)
    parting = [where(at_cut, restitution=e)["separation_velocity"][0] for e in VANISHING]
    return {
        "stiffness_steps": np.diff(durations, axis=2), "restitution_steps": np.diff(durations, axis=1),
        "longer": durations[0, 0, 0] / durations[0, -1, 0],
        "ratio": durations[0] / durations[1], "mean_ratio": (durations[0] / durations[1]).mean(),
        "parting": parting, "parting_steps": np.diff(parting), "parting_last": parting[-1],
        "error": error.max(), "error_at": RESTITUTIONS[int(np.argmax(error))],
    }  # fmt: skip


def _contact(case: str, speed: float) -> pl.DataFrame:
    """Simulate one contact. Rows are points of the trace from touch to separation; `time` (s) is 0 at the touch."""
    contact = CONTACTS[case]
    approach = ig.Scene(ig.Tool(TOOL_MASS), ig.Object(OBJECT_MASS, speed**2 / STEADY.acceleration), contact)
    outcome, trace = simulate_with_trace(approach, ig.Trapezoid(speed, STEADY.acceleration))
    (record,) = outcome.contacts
    assert record.end is not None
    depth = np.maximum(trace.tool_position - trace.object_position, 0.0)
    elastic = contact.stiffness * depth**contact.stiffness_exponent
    columns = {"time": trace.time - record.start, "force": trace.contact_force, "elastic": elastic}
    columns["damping"] = np.where(trace.contact_force > 0.0, trace.contact_force - elastic, np.nan)  # nan: separated
    delivered = record.separation_velocity / record.approach_velocity
    constants = {"case": case, "speed": speed, "nominal": RESTITUTION, "delivered": delivered}
    return pl.DataFrame(columns | constants).filter((trace.time >= record.start) & (trace.time <= record.end))


def beyond_contact() -> pl.DataFrame:
    """Simulate CONTACTS at SPEEDS, and evaluate the restitution that each of LAWS gives for each of NOMINAL."""
    contacts = [_contact(case, speed) for case in CONTACTS for speed in SPEEDS]
    delivered = {law: np.asarray(ig.effective_restitution(law, NOMINAL)) for law in LAWS}
    laws = [pl.DataFrame({"nominal": NOMINAL, "delivered": e, "case": law}) for law, e in delivered.items()]
    return pl.concat([*contacts, *laws], how="diagonal")


def _ends(rows: dict[str, Array]) -> tuple[float, float]:
    """Return the force at the touch, and the elastic force at the separation, both divided by the largest force."""
    pushing = np.flatnonzero(rows["force"] > 0.0)
    return rows["force"][pushing[0]] / rows["force"].max(), rows["elastic"][pushing[-1]] / rows["force"].max()


def _numbers_beyond_contact(frame: pl.DataFrame) -> Numbers:
    linear, paper = (where(frame, case=case, speed=1.0) for case in CONTACTS)
    errors = frame.filter(pl.col("nominal") < SMALL).with_columns(error=(pl.col("delivered") - pl.col("nominal")).abs())
    hu_guo, hunt_crossley = (where(errors, case=law)["error"] for law in LAWS)
    jump, end_share = _ends(linear)
    return {
        "spread": {case: np.ptp(where(frame, case=case)["delivered"]) for case in CONTACTS},
        "jump": 100.0 * jump, "end_share": end_share, "holding_back": linear["force"].max() * end_share,
        "paper_ends": max(_ends(paper)),
        "hu_guo": hu_guo, "hu_guo_worst": hu_guo.max(),
        "hunt_crossley": hunt_crossley, "hunt_crossley_worst": hunt_crossley.max(),
    }  # fmt: skip
