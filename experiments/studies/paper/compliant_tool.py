"""Section 4, the tool on spring and damper (stiffness k_t), and section 5, the bistable mechanism: Fig. 16 to 24.

In section 5 the restitution is 0.1, the contact stiffness 1e3 N/m^1.5.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import polars as pl
from matplotlib.figure import Figure as Sheet
from numpy.typing import NDArray

import impact_gym as ig
from experiments.lab import scenes
from experiments.lab.charts import SERIES
from experiments.lab.parts import Picture
from experiments.lab.scenes import BISTABLE, CONSTANT_SPEED, LINEAR, MOTION, OBJECT_MASS, scene
from experiments.lab.study import Row
from experiments.studies.paper.runs import PAPER, Array, Model, Run, histories, picture, runs_of, two_runs, where
from experiments.studies.paper.statements import Figure, Finding

CONTACT_STIFFNESSES = (1e3, 1e4, 1e5)  # N/m^1.5
COUPLING_STIFFNESSES = np.linspace(5.0, 200.0, 196)  # N/m
SETTLED = 4.0  # m, distance at which the tool's transient after the acceleration has decayed at every k_t
INELASTIC = 0.1  # restitution of Fig. 18 to 20
SPRING = ig.SpringDamper(150.0)  # of Fig. 17, 19 and 20
FORCES = np.linspace(0.5, 2.0, 31)  # factors on the force of the mechanism


def _rows(model: Model, k_t: Array, e: float, distance: float = scenes.DISTANCE, braked: bool = True) -> pl.DataFrame:
    """Simulate V_p over k_t (N/m) for each contact stiffness."""
    motion = MOTION if braked else CONSTANT_SPEED
    rows: list[Row] = []
    for k_c, stiffness in product(CONTACT_STIFFNESSES, k_t.tolist()):
        approach = scene(k_c, e, ig.SpringDamper(stiffness), distance=distance)
        outcome = model.simulate(approach, motion, scenes.DURATION + distance / MOTION.speed)
        rows.append({
            "braked": braked, "distance": distance, "contact_stiffness": k_c, "contacts": len(outcome.contacts),
            "object_velocity": outcome.object_velocity, "after_first": outcome.contacts[0].object_velocity,
        })  # fmt: skip
    return pl.DataFrame(rows)


def figure_16(model: Model = PAPER) -> pl.DataFrame:
    """Simulate the curves of Fig. 16, and curves of a tool that is settled when it strikes."""
    settled = _rows(model, COUPLING_STIFFNESSES[::5], 1.0, distance=SETTLED)
    return pl.concat([_rows(model, COUPLING_STIFFNESSES, 1.0), settled])


def figure_18(model: Model = PAPER) -> pl.DataFrame:
    """Simulate the curves of Fig. 18, and curves without a brake."""
    unbraked = _rows(model, COUPLING_STIFFNESSES[::5], INELASTIC, braked=False)
    return pl.concat([_rows(model, COUPLING_STIFFNESSES, INELASTIC), unbraked])


def _velocities(frame: pl.DataFrame, distance: float = scenes.DISTANCE, braked: bool = True) -> Array:
    """Return V_p as an array (contact stiffnesses, coupling stiffnesses)."""
    velocity = where(frame, distance=distance, braked=braked)["object_velocity"]
    return velocity.reshape(len(CONTACT_STIFFNESSES), -1)


def _places(holds: NDArray[np.bool_]) -> str:
    """Return in words at how many values of k_t a condition holds, and where it does not."""
    broken = COUPLING_STIFFNESSES[~holds]
    but = f", not at {broken.min():g} to {broken.max():g} N/m" if broken.size else ""
    return f"at {holds.sum()} of {holds.size} values of k_t{but}"


def _statements_16(frame: pl.DataFrame) -> Iterator[Finding]:
    soft, middle, stiff = grid = _velocities(frame)
    yield Finding("reduction", grid.max() < 1.5, f"V_p is at most {grid.max():.3f} m/s on the curves")
    falls = [np.flatnonzero(steps <= 0) for steps in np.diff(grid)]
    rising = [float(COUPLING_STIFFNESSES[at[-1] + 1 if at.size else 0]) for at in falls]  # N/m, from where V_p rises
    settled = np.diff(_velocities(frame, distance=SETTLED)) > 0
    yield Finding("stiffness", max(rising) == 5.0,
        "with k_c = 1e3, 1e4, 1e5 V_p rises from {:g}, {:g}, {:g} N/m on".format(*rising),
        reading=(settled.all(), f"V_p rises at {settled.sum()} of {settled.size} steps"))  # fmt: skip
    order = (soft > middle) & (middle > stiff)
    yield Finding("contact_stiffness", order.all(), f"holds {_places(order)}")
    again = where(frame.filter(pl.col("contacts") > 1), distance=scenes.DISTANCE)
    energies = (again["object_velocity"] / again["after_first"]) ** 2
    yield Finding("rebounds", energies.size and (energies > 1.0).all(),
        f"up to {energies.max(initial=0.0):.2f} times the energy after the first contact, on {energies.size} "
        "scenes with several contacts")  # fmt: skip


def _curves(frame: pl.DataFrame, name: str, restitution: float) -> Picture:
    sheet = Sheet(figsize=(5.6, 3.68))
    axes, ends = sheet.subplots(), []
    for colour, k_c, line in zip(SERIES, CONTACT_STIFFNESSES, _velocities(frame), strict=False):
        axes.plot(COUPLING_STIFFNESSES, line, color=colour, label=f"k_c = {k_c:g} N/m^1.5")
        ends.append(f"from {line[0]:.2f} to {line[-1]:.2f} m/s with k_c = {k_c:g} N/m^1.5")
    axes.set(xlabel="coupling stiffness k_t (N/m)", ylabel="final object velocity V_p (m/s)")
    axes.legend(fontsize=9)
    caption = f"V_p against the stiffness of the coupling; zeta = 1, e = {restitution:g}."
    return picture(name, sheet, caption, f"Curves of V_p over k_t: {', '.join(ends)}.")


def _statements_18(frame: pl.DataFrame) -> Iterator[Finding]:
    soft, middle, stiff = _velocities(frame)
    order, unbraked = (soft < middle) & (middle < stiff), _velocities(frame, braked=False)
    ordered = (np.diff(unbraked, axis=0) > 0).all(axis=0)
    yield Finding("contact_stiffness", order.all(), f"holds {_places(order)}",
        why=[ordered.sum(), ordered.size])  # fmt: skip


def figure_17(model: Model = PAPER) -> pl.DataFrame:
    """Simulate Fig. 17a and 17b."""
    return histories(model, {"a": scene(1e5, 1.0, SPRING), "b": scene(1e4, 1.0, SPRING)})


def _statements_17(frame: pl.DataFrame) -> Iterator[Finding]:
    a, b = runs_of(frame)
    before = a.part(np.cumsum(a.contact) == 0)
    stretch = 1e3 * (before.tool_position - before.flange_position)
    yield Finding("compressed", stretch.min() < 0.0 and stretch.max() <= 1e-6,
        f"the tool lags by up to {-stretch.min():.2f} mm")  # fmt: skip
    ahead = (before.tool_velocity - before.flange_velocity)[before.time > MOTION.speed / MOTION.acceleration]
    share = 100.0 * np.mean(ahead > 0.0)  # %, share of points, and so of time: points are 1 ms apart
    yield Finding("faster", share > 95.0 and 0.0 < ahead.max() < 0.1 and ahead[-1] > 0.0,
        f"higher during {share:.0f} % of that time, by {ahead.max():.3f} m/s at most")  # fmt: skip
    yield Finding("deceleration", a.deceleration > b.deceleration,
        f"{a.deceleration:.0f} m/s^2 against {b.deceleration:.0f} m/s^2")  # fmt: skip
    times = [1e3 * (run.first_contact.time - run.first_contact.time[0]) for run in (a, b)]
    pressed = [1e3 * (run.first_contact.flange_position - run.first_contact.tool_position) for run in (a, b)]
    reached = [np.interp(min(a.duration, b.duration), *points) for points in zip(times, pressed, strict=True)]
    most = [values.max() for values in pressed]
    yield Finding("compression", most[0] > most[1], f"at most {most[0]:.1f} mm in (a), {most[1]:.1f} mm in (b)",
        reading=(reached[0] > reached[1], f"{reached[0]:.1f} mm in (a), {reached[1]:.1f} mm in (b)"))  # fmt: skip
    yield Finding("relative_velocity", max(abs(run.restitution - 1.0) for run in (a, b)) < 0.05,
        f"after / before: {a.restitution:.3f} in (a), {b.restitution:.3f} in (b)")  # fmt: skip


def figure_19(model: Model = PAPER) -> pl.DataFrame:
    """Simulate Fig. 19a and 19b with their restitution and with restitution 1, each with and without a brake."""
    cases = {"a": scene(1e5, INELASTIC, SPRING), "b": scene(1e3, INELASTIC, SPRING)}
    cases |= {"a, e = 1": scene(1e5, 1.0, SPRING), "b, e = 1": scene(1e3, 1.0, SPRING)}
    never = {f"{case}, no brake": approach for case, approach in cases.items()}
    return pl.concat([histories(model, cases), histories(model, never, CONSTANT_SPEED)])


def _statements_19(frame: pl.DataFrame) -> Iterator[Finding]:
    both = a, b = runs_of(frame)
    braked = [run.final_velocity for run in (a, b, *(Run(frame, f"{case}, e = 1") for case in "ab"))]
    yield Finding("inelastic", braked[0] < braked[2] and braked[1] < braked[3],
        "{0:.4f} against {2:.4f}; {1:.4f} against {3:.4f} m/s".format(*braked))  # fmt: skip
    slower = [(run.trace.flange_velocity < MOTION.speed) & (run.contact > 0) for run in both]
    shares = [100.0 * run.trace.object_velocity[when.argmax()] / run.final_velocity if when.any() else 100.0
              for run, when in zip(both, slower, strict=True)]  # fmt: skip
    yield Finding("contributions", all(5.0 < share < 95.0 for share in shares),
        "{:.0f} % of V_p in (a) and {:.0f} % in (b) before the robot brakes".format(*shares))  # fmt: skip
    yield Finding("longer", b.duration > a.duration, f"{b.duration:.1f} ms against {a.duration:.1f} ms")
    yield Finding("synchronous", max(a.restitution, b.restitution) < 0.2,
        f"{a.restitution:.3f} of it in (a), {b.restitution:.3f} in (b)")  # fmt: skip
    touching = [run.first_contact for run in both]
    behind = [int(np.argmax(each.tool_velocity < each.flange_velocity)) for each in touching]
    push = [each.coupling_force[start:].min() for each, start in zip(touching, behind, strict=True)]
    yield Finding("pushes", min(push) > 0.0, f"at least {push[0]:.2f} N in (a), {push[1]:.2f} N in (b)")
    stretch = [1e3 * np.max(each.tool_position - each.flange_position) for each in touching]
    yield Finding("compressed", max(stretch) < 0.0,
        "largest extension {:.2f} mm in (a), {:.2f} mm in (b)".format(*stretch))  # fmt: skip
    gain = [(each.tool_velocity - each.flange_velocity)[start:] for each, start in zip(touching, behind, strict=True)]
    until = [1e3 * (each.time[start + np.argmax(ahead >= 0.0)] - each.time[0])
             for each, start, ahead in zip(touching, behind, gain, strict=True)]  # fmt: skip
    yield Finding("slower", max(map(np.max, gain)) < 0.0,
        f"for the first {until[0]:.0f} of {a.duration:.0f} ms in (a), {until[1]:.0f} of {b.duration:.0f} in (b)"
    )  # fmt: skip
    steady = [Run(frame, f"{case}, no brake").final_velocity for case in ("a", "b", "a, e = 1", "b, e = 1")]
    saved = 100.0 * (1.0 - np.divide(braked, steady))  # %
    yield Finding("control", saved[0] > saved[2] and saved[1] > saved[3],
        "by {:.0f} % in (a) and {:.0f} % in (b), with e = 1 by {:.0f} and {:.0f} %".format(*saved))  # fmt: skip
    yield Finding("order", (a.impulse - b.impulse) * (a.final_velocity - b.final_velocity) > 0.0,
        f"{a.impulse:.4f}, {b.impulse:.4f} N s; {a.final_velocity:.4f}, {b.final_velocity:.4f} m/s")  # fmt: skip
    by_22 = [run.equation_22(INELASTIC) for run in both]
    yield Finding("equation_22", (np.abs(np.divide(by_22, braked[:2]) - 1.0) < 0.05).all(),
        f"eq. 22: {by_22[0]:.4f}, {by_22[1]:.4f} m/s; V_p: {a.final_velocity:.4f}, {b.final_velocity:.4f} m/s"
    )  # fmt: skip


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
    held = rows["force"] >= scenes.HOLD
    lag, velocity = (rows["lag"][~held].min(), rows["lag"][held].max()), rows["object_velocity"][held]
    yield Finding("keeps", lag[0] > 0.1 > lag[1],
        f"below {scenes.HOLD:g} N it lags by at least {lag[0]:.2f} mm, above by at most {lag[1]:.3f} mm")  # fmt: skip
    yield Finding("least", (np.diff(velocity) > 0.0).all(),
        f"{1e3 * OBJECT_MASS * velocity[0]:.1f} N ms with {rows['force'][held][0]:.2f} N, "
        f"{1e3 * OBJECT_MASS * velocity[-1]:.1f} N ms with {rows['force'][-1]:.2f} N")  # fmt: skip
    contacts = where(frame.filter(pl.col("contacts").is_not_null()))["contacts"]
    yield Finding("no_rebounds", contacts.max() == 1,
        f"one contact in {(contacts == 1).sum()} of {contacts.size} scenes")  # fmt: skip


FIGURES = (
    Figure(figure_16, _statements_16, partial(_curves, restitution=1.0)),
    Figure(figure_17, _statements_17, partial(
        two_runs, titles=("(a, c) k_c = 1e5 N/m^1.5", "(b, d) k_c = 1e4 N/m^1.5"), forces=True,
        common="k_t = 150 N/m, zeta = 1, e = 1")),
    Figure(figure_18, _statements_18, partial(_curves, restitution=INELASTIC)),
    Figure(figure_19, _statements_19, partial(
        two_runs, titles=("(a, c) k_c = 1e5 N/m^1.5", "(b, d) k_c = 1e3 N/m^1.5"), forces=True,
        common="k_t = 150 N/m, zeta = 1, e = 0.1")),
    Figure(figure_23, _statements_23, partial(
        two_runs, titles=("(a, c) bistable mechanism", "(b, d) linear spring-damper"), common="e = 0.1, k_c = 1e3",
        forces=True)),
    Figure(beyond_holding, _statements_holding),
)  # fmt: skip
