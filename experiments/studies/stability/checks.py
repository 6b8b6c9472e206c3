"""Simulate random approaches, and check each result by laws of physics.

Energy. M is the reduced mass of tool and object, delta the penetration, v_in and v_out are the velocities of approach
and separation. All forces but the contact force give the tool the acceleration a, relative to the object. The contact
force is F = M (a - delta''). So the contact takes from the bodies the energy

    integral of F d(delta) = (M v_in^2 - M v_out^2) / 2 + M integral of a d(delta)

This energy must not be negative. The first term uses the velocities in a `ContactRecord`; the second is a sum over the
points of a `Trace`. The doubt of the sum is the change if every second point is left out, plus the rounding error.

Momentum. Friction decelerates the object by at most mu g (mu: coefficient of friction), so the contact's impulse may
exceed the object's gain in momentum by at most the impulse of friction.
"""

import math
from collections.abc import Callable
from time import thread_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_gym as ig
from experiments import reference
from experiments.lab.study import Row
from experiments.reference.laws import damping_factor
from experiments.studies.solvers.approaches import Approach, Solution, random_approach
from impact_gym.physics.impact import GRAVITY

NEVER = 1e6  # s, taken as the end of an unfinished contact
AGAIN_OVER = 20.0  # ms; a longer run is timed again, because a first run also loads modules and tables
LONGEST_TRACE = 50_000  # largest number of steps of a run with a trace; a longer trace would fill the memory
FINER = 1e-10  # `rtol` of a second run, made for each scene that has a trace
STIFF = 20.0  # damping factor d above which the independent solver uses Radau
CHECKS = ("momentum_error", "energy_created", "energy_doubt", "pull")
"""Columns with the checks of a run: ratios for the worst contact, or 0 if there was no contact.

`momentum_error`: residual of the paper's eq. 20, or difference of impulse and the object's gain in momentum beyond what
friction explains, whichever is larger, divided by the impulse; inf if one is nan. `energy_created`: energy that the
contact created (below 0: lost), divided by the energy exchanged; nan without a trace. `energy_doubt`: doubt of
`energy_created`; nan without a trace. `pull`: the largest of three ratios: a contact force below 0, divided by the peak
force; a decrease of the object's velocity that friction does not explain, divided by v; a negative impulse, divided by
the object's mass times v. Here v is the object's velocity after the previous contact plus the approach velocity.
"""

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)


def run(approach: Approach, rtol: float = 1e-8) -> tuple[ig.Outcome | None, str, float]:
    """Return the outcome or None, the error or "", and the processor time (ms) of a call of `simulate`."""
    begun, outcome, problem = thread_time(), None, ""
    try:
        outcome = ig.simulate(*approach, rtol)
    except Exception as error:  # becomes `failure` in the row of the scene
        problem = f"{type(error).__name__}: {error}".replace("\n", " ")
    return outcome, problem, 1e3 * (thread_time() - begun)


def row_of(approach: Approach, simulate: Callable[..., ig.Outcome] = ig.simulate) -> Row:
    """Return the results of a scene as a row; the run with a trace uses `simulate`."""
    outcome, problem, milliseconds = run(approach)
    if milliseconds >= AGAIN_OVER:
        milliseconds = min(milliseconds, run(approach)[2])
    row: dict[str, Any] = {**approach.about, "failure": problem, "milliseconds": milliseconds}
    if outcome is None:
        return row
    v_p, is_finite, traced = outcome.object_velocity, finite(outcome), outcome.steps <= LONGEST_TRACE
    row |= {"steps": outcome.steps, "contacts": len(outcome.contacts), "passes": len(outcome.snap_through)}
    row |= {"object_velocity": v_p}
    if traced:
        outcome, (finer, *_) = simulate(*approach, trace=True), run(approach, FINER)
        is_finite = is_finite and finite(outcome)
        velocity = finer.object_velocity if finer else math.nan
        row["finer_change"] = abs(velocity - v_p) / max(abs(v_p), 1e-6 * approach.motion.speed)
    return row | {"finite": is_finite, "traced": traced} | checked(approach.scene, outcome)


def scene_row(number: int) -> list[Row]:
    """Return the row of scene `number`, in a list."""
    return [row_of(random_approach(number))]


def truth_row(number: int) -> list[Row]:
    """Return the row of the independent solver for scene `number`, in a list."""
    approach = random_approach(number)
    law = approach.scene.contact
    d = damping_factor(law.dissipation, law.restitution, law.stiffness_exponent, law.damping_exponent)
    method, rtol = ("Radau", 1e-10) if d > STIFF else ("DOP853", 1e-11)
    solution = Solution.of(reference.simulate(*approach, rtol=rtol, method=method), approach.duration)
    return [{**approach.about, "failure": "", "method": method, **solution._asdict()}]


def finite(outcome: ig.Outcome) -> bool:
    """Return whether all numbers of an outcome, except `rest_time`, are finite."""
    outcome = outcome._replace(rest_time=None)  # `rest_time` is inf if the tool moves at the end
    records = [record for record in (outcome, *outcome.contacts, outcome.trace) if record is not None]
    values = [value for record in records for value in record]
    return all(bool(np.all(np.isfinite(value))) for value in values if isinstance(value, float | np.ndarray))


def checked(scene: ig.Scene, outcome: ig.Outcome) -> dict[str, float]:
    """Return the values of CHECKS for a run, from contact records and, if recorded, the trace."""
    if not outcome.contacts:
        return dict.fromkeys(CHECKS, 0.0)
    budgets, energies, pulls = [], [], [0.0]
    before, since, m_p, trace = 0.0, 0.0, scene.object.mass, outcome.trace
    slowing = GRAVITY * (scene.object.friction or 0.0)  # m/s^2, by friction
    for contact in outcome.contacts:
        after, striking = contact.object_velocity, before + contact.approach_velocity
        until = NEVER if contact.end is None else contact.end
        rubbed = slowing * (until - since)  # m/s, largest possible loss of the object's velocity by friction
        lost = contact.impulse - m_p * (after - before)
        impulse_error = max(-lost, lost - m_p * rubbed, 0.0) / max(contact.impulse, 1e-300)
        budgets.append(_worst(abs(contact.momentum_error), impulse_error))
        pulls += [(before - after - rubbed) / striking, -contact.impulse / (m_p * striking)]
        before, since = after, until
        if trace is not None:
            energies.append(energy(scene, trace, contact))
    if trace is not None:
        pulls.append(-float(trace.contact_force.min()) / max(outcome.peak_force, 1e-300))
    created, doubt = max(energies, key=lambda parts: _worst(parts[0] - parts[1]), default=(math.nan, math.nan))
    return dict(zip(CHECKS, (max(budgets), created, doubt, max(pulls, key=_worst)), strict=True))


def _worst(*values: float) -> float:
    return math.inf if any(map(math.isnan, values)) else max(values)


def energy(scene: ig.Scene, trace: ig.Trace, contact: ig.ContactRecord) -> tuple[float, float]:
    """Return `energy_created` and `energy_doubt` of CHECKS for one contact."""
    first = int(np.searchsorted(trace.time, contact.start, side="right")) - 1
    last = np.searchsorted(trace.time, math.inf if contact.end is None else contact.end, side="left")
    inside = slice(first, int(last) + 1)
    mass = _reduced_mass(scene, trace.command_position[inside])
    delta = (trace.tool_position - trace.object_position)[inside]
    rate = (trace.tool_velocity - trace.object_velocity)[inside]
    columns = trace.time[inside], mass, delta, rate, trace.object_velocity[inside], trace.contact_force[inside]
    parts, given = _work(scene.object, *columns)
    work = float(np.sum(parts))
    coarse, _ = _work(scene.object, *(np.append(values[:-1:2], values[-1]) for values in columns))
    doubt = abs(work - float(np.sum(coarse)))
    rounding = 4 * EPS * np.sqrt(len(mass)) * np.abs(given).max() * np.abs(rate).max()
    rate[0], rate[-1] = contact.approach_velocity, -contact.separation_velocity
    kinetic = float(np.sum((mass[1:] + mass[:-1]) / 2 * np.diff(rate**2 / 2)))
    exchanged = mass.max() * contact.approach_velocity**2 / 2 + float(np.sum(np.abs(parts)))
    return (kinetic - work) / exchanged, (doubt + rounding) / exchanged


def _work(
    target: ig.Object, time: Array, mass: Array, delta: Array, rate: Array, velocity: Array, force: Array
) -> tuple[Array, Array]:
    """Return the work M a d(delta) (J) between points, and momentum plus friction impulse of the object (N s)."""
    # contact impulse = change of momentum + friction impulse; without sliding, friction equals the contact force
    friction, passed = GRAVITY * target.mass * (target.friction or 0.0), np.diff(time)
    slides = velocity[1:] + velocity[:-1] != 0.0
    held = np.where(slides, friction * np.sign(velocity[1:] + velocity[:-1]), (force[1:] + force[:-1]) / 2)
    taken = np.cumsum(held * passed) if friction else np.zeros(len(time) - 1)
    given = target.mass * velocity + np.concatenate(([0.0], taken))
    push = (mass[1:] + mass[:-1]) / 2 * np.diff(rate) + np.diff(given)
    return np.divide(push * np.diff(delta), passed, out=np.zeros_like(push), where=passed > 0), given


def _reduced_mass(scene: ig.Scene, command: Array) -> Array:
    """Return M (kg) at each commanded position (m); a tool that is fixed to a rigid robot has an infinite mass."""
    mass, m_p, robot = np.full_like(command, scene.tool.mass), scene.object.mass, scene.robot
    if isinstance(scene.coupling, ig.Rigid):
        if robot is None:
            return np.full_like(command, m_p)
        if isinstance(robot, ig.RobotTable):
            mass += robot.splines(np.clip(command, robot.position[0], robot.position[-1]))[:, 0]
        else:
            mass += robot.mass
    return mass * m_p / (mass + m_p)
