"""Section 5, the bistable mechanism: Fig. 23 and 24. The restitution is 0.1, the contact stiffness 1e3 N/m^1.5."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import polars as pl

from experiments.lab.scenes import BISTABLE, HOLD, LINEAR, MOTION, OBJECT_MASS, scene
from experiments.lab.study import Row
from experiments.studies.paper.models import PAPER, Model
from experiments.studies.paper.runs import histories, runs_of, two_runs, where
from experiments.studies.paper.statements import Figure, Finding

FORCES = np.linspace(0.5, 2.0, 31)  # factors on the force of the mechanism


def figure_23(model: Model = PAPER) -> pl.DataFrame:
    """Simulate Fig. 23a (mechanism) and 23b (spring and damper)."""
    return histories(model, {"a": scene(1e3, 0.1, BISTABLE), "b": scene(1e3, 0.1, LINEAR)})


def _statements_23(frame: pl.DataFrame) -> Iterator[Finding]:
    run, linear = runs_of(frame)
    trace, time, tool = run.trace, run.trace.time, run.trace.tool_velocity
    x = BISTABLE.rest + trace.tool_position - trace.flange_position  # m, of the slider; the trace begins at rest
    passes = np.flatnonzero((x[:-1] > 0.0) & (x[1:] <= 0.0))
    snap = float(time[passes[0] + 1]) if passes.size else np.inf  # s, first passage of the alignment
    touch = int(np.argmax(run.contact > 0))
    first_phase = (time >= time[touch]) & (time < snap)
    slowed = int(np.argmax(first_phase & (tool <= 0.4)))
    settling = first_phase & (time >= time[slowed])  # from tool velocity 0.4 m/s until the slider passes its alignment
    steady = settling & np.append(np.diff(time) > 0.0, False)  # an event has two points at one time
    rate = np.abs(np.diff(tool)[steady[:-1]] / np.diff(time)[steady[:-1]])
    plateau = tool[steady][np.argmin(rate)]  # m/s, tool velocity at the smallest `rate`
    fall = 1e3 * (time[slowed] - time[touch])  # ms
    yield Finding("plateau", abs(plateau - 0.4) <= 0.05, f"{plateau:.3f} m/s")
    yield Finding("deceleration", fall < 16.0, f"from 1.0 to 0.4 m/s in {fall:.1f} ms",
        reading=(600.0 / fall > MOTION.deceleration, f"{600.0 / fall:.0f} m/s^2 on average"))  # fmt: skip
    share = 100 * trace.object_velocity[slowed] / run.final_velocity
    yield Finding("complete", share >= 95.0, f"the object has {share:.0f} % of V_p by then")
    change, at_stop = np.ptp(tool[settling]), int(np.argmax((time > snap) & (x <= BISTABLE.rear_stop)))
    loss = plateau - tool[(time > snap) & (time < time[at_stop])].min(initial=np.inf)
    yield Finding("crosses", change < 0.05 and snap < np.inf and loss > 0.2,
        f"changes by {change:.3f} m/s until the crossing at {snap:.3f} s, then by {loss:.2f} m/s")  # fmt: skip
    difference = np.abs(tool - trace.flange_velocity)[time > time[at_stop] + 0.02].max()
    yield Finding("adapts", at_stop > 0 and difference < 0.05,
        f"from 20 ms after the rear stop on, they differ by {difference:.3f} m/s at most")  # fmt: skip
    largest = [each.during_contact.coupling_force.max() for each in (run, linear)]
    yield Finding("force", largest[0] < largest[1], f"at most {largest[0]:.2f} N against {largest[1]:.2f} N")
    back = trace.coupling_force[(run.contact > 0) & (x < BISTABLE.front_stop) & (x > 0.0)]
    yield Finding("force_falls", back.size > 1 and (np.diff(back) < 0.0).all(),
        f"from {back[0]:.2f} N to {back[-1]:.2f} N" if back.size else "")  # fmt: skip
    yield Finding("velocity", run.final_velocity < linear.final_velocity,
        f"{run.final_velocity:.4f} m/s against {linear.final_velocity:.4f} m/s")  # fmt: skip
    yield Finding("impulse", run.impulse < linear.impulse, f"{run.impulse:.4f} N s against {linear.impulse:.4f} N s")


def beyond_holding(model: Model = PAPER) -> pl.DataFrame:
    """Simulate Fig. 23a with weaker and stronger mechanisms, then with other contacts (`force` is null)."""
    rows: list[Row] = []
    for factor in FORCES:
        mechanism = replace(BISTABLE, stiffness=factor * BISTABLE.stiffness)
        outcome, trace = model.trace(scene(1e3, 0.1, mechanism))
        before = trace.time < outcome.contacts[0].start
        lag = 1e3 * (trace.flange_position - trace.tool_position)[before].max()
        rows.append({"force": mechanism.holding_force, "lag": lag, "object_velocity": outcome.object_velocity})
    contacts = [
        {"contact_stiffness": k_c, "restitution": e, "contacts": len(model.simulate(scene(k_c, e, BISTABLE)).contacts)}
        for k_c, e in product((1e3, 1e4, 1e5), (0.1, 0.3, 0.5, 0.7, 1.0))
    ]
    return pl.concat([pl.DataFrame(rows), pl.DataFrame(contacts)], how="diagonal")


def _statements_holding(frame: pl.DataFrame) -> Iterator[Finding]:
    rows = where(frame.filter(pl.col("force").is_not_null()))
    held = rows["force"] >= HOLD
    lag, velocity = (rows["lag"][~held].min(), rows["lag"][held].max()), rows["object_velocity"][held]
    yield Finding("keeps", lag[0] > 0.1 > lag[1],
        f"below {HOLD:g} N it lags by at least {lag[0]:.2f} mm, above by at most {lag[1]:.3f} mm")  # fmt: skip
    yield Finding("least", (np.diff(velocity) > 0.0).all(),
        f"{1e3 * OBJECT_MASS * velocity[0]:.1f} N ms with {rows['force'][held][0]:.2f} N, "
        f"{1e3 * OBJECT_MASS * velocity[-1]:.1f} N ms with {rows['force'][-1]:.2f} N")  # fmt: skip
    contacts = where(frame.filter(pl.col("contacts").is_not_null()))["contacts"]
    yield Finding("no_rebounds", contacts.max() == 1,
        f"one contact in {(contacts == 1).sum()} of {contacts.size} scenes")  # fmt: skip


FIGURES = (
    Figure(figure_23, _statements_23, partial(
        two_runs, titles=("(a, c) bistable mechanism", "(b, d) linear spring-damper"), common="e = 0.1, k_c = 1e3",
        forces=True)),
    Figure(beyond_holding, _statements_holding),
)  # fmt: skip
