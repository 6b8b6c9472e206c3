"""What physics says about any run, as numbers: momentum, the energy of each contact, a force that only pushes.

Energy. With M the reduced mass of tool and object and a the acceleration of the tool by all but the contact, the
contact force is F = M (a - delta''), so that the contact takes from the bodies

    integral of F d(delta) = (M v_in^2 - M v_out^2) / 2 + M integral of a d(delta)

It may not be negative: a contact that is over has given back less than it took, one that is not holds some still. The
first part is known to rounding from a `ContactRecord`. The second is a sum over the points of a `Trace`, in which M a
follows from the velocities at two points, so that a may jump; its doubt is the change when every second point is left
out. Where the tool is fixed to a robot whose mass varies, M varies with it.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import impact_gym as ig

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Findings:
    """The worst of a run; all zero if there was no contact, no energies if there is no trace."""

    momentum_error: float = 0.0  # -, of eq. 20 by the records, over the impulse of the contact
    impulse_error: float = 0.0  # -, impulse against what the object has gained, over the impulse
    rounding: float = 0.0  # -, of the momenta that were subtracted in that contact, over the impulse
    energy_created: float = 0.0  # -, over all energy that went to and fro in the contact; negative: lost
    energy_doubt: float = 0.0  # -, of that by quadrature, in the same contact
    pull: float = 0.0  # -, contact force below 0 over its peak, or V_p lower after a contact over the speed of the tool
    trace_fall: float = 0.0  # -, of V_p from one point of the trace to the next, over the speed of the tool


def finite(outcome: ig.Outcome) -> bool:
    """Whether all numbers of an outcome are numbers."""
    records = [record for record in (outcome, *outcome.contacts, outcome.trace) if record is not None]
    values = [value for record in records for value in record]
    return all(bool(np.all(np.isfinite(value))) for value in values if isinstance(value, float | np.ndarray))


def examine(scene: ig.Scene, outcome: ig.Outcome) -> Findings:
    """Return what the records and, if there is one, the trace of a run say, each the worst of its contacts."""
    if not outcome.contacts:
        return Findings()
    budgets, energies, pulls, fall = [], [], [0.0], 0.0
    before, m_p, trace = 0.0, scene.object.mass, outcome.trace
    heaviest = scene.tool.mass  # of what moves as one with the tool
    if isinstance(scene.coupling, ig.Rigid) and scene.robot is not None:
        heaviest += float(np.max(scene.robot.mass))
    for contact in outcome.contacts:
        after, striking = contact.object_velocity, before + contact.approach_velocity
        impulse = max(contact.impulse, 1e-300)
        rounding = EPS * (heaviest * abs(striking) + m_p * max(abs(before), abs(after))) / impulse
        gained = m_p * (after - before)
        budgets.append((abs(contact.momentum_error), abs(gained - contact.impulse) / impulse, rounding))
        pulls += [(before - after) / striking, -contact.impulse / (m_p * striking)]
        before = after
        if trace is not None:
            energies.append(energy(scene, trace, contact))
    if trace is not None:
        pulls.append(-float(trace.contact_force.min()) / max(outcome.peak_force, 1e-300))
        fastest = max(float(np.abs(trace.tool_velocity).max()), 1e-300)
        fall = -float(np.diff(trace.object_velocity).min(initial=0.0)) / fastest
    momentum_error, impulse_error, rounding = max(budgets, key=lambda budget: _worst(*budget[:2]))
    created, doubt = max(energies, key=lambda found: _worst(found[0] - found[1]), default=(math.nan, math.nan))
    return Findings(momentum_error, impulse_error, rounding, created, doubt, max(pulls, key=_worst), fall)


def _worst(*values: float) -> float:
    """The largest, what is no number above all."""
    return math.inf if any(map(math.isnan, values)) else max(values)


def energy(scene: ig.Scene, trace: ig.Trace, contact: ig.ContactRecord) -> tuple[float, float]:
    """Return the energy that a contact has created, and its doubt, as in `Findings`."""
    first = int(np.searchsorted(trace.time, contact.start, side="right")) - 1
    last = np.searchsorted(trace.time, math.inf if contact.end is None else contact.end, side="left")
    inside = slice(first, int(last) + 1)
    time, mass = trace.time[inside], reduced_mass(scene, trace.command_position[inside])
    delta = (trace.tool_position - trace.object_position)[inside]
    rate = (trace.tool_velocity - trace.object_velocity)[inside]
    given = scene.object.mass * trace.object_velocity[inside]
    parts = _work(time, mass, delta, rate, given)
    work = float(np.sum(parts))
    every_second = [np.append(values[:-1:2], values[-1]) for values in (time, mass, delta, rate, given)]
    doubt = abs(work - float(np.sum(_work(*every_second))))
    rounding = 4 * EPS * np.sqrt(len(time)) * np.abs(given).max() * np.abs(rate).max()
    rate[0], rate[-1] = contact.approach_velocity, -contact.separation_velocity
    kinetic = float(np.sum((mass[1:] + mass[:-1]) / 2 * np.diff(rate**2 / 2)))
    turned_over = mass.max() * contact.approach_velocity**2 / 2 + float(np.sum(np.abs(parts)))
    return (kinetic - work) / turned_over, (doubt + rounding) / turned_over


def _work(time: Array, mass: Array, delta: Array, rate: Array, given: Array) -> Array:
    """M a d(delta) between the points, J, a as constant there: M a is M delta'' and what the object is given."""
    push = (mass[1:] + mass[:-1]) / 2 * np.diff(rate) + np.diff(given)
    passed = np.diff(time)
    parts: Array = np.divide(push * np.diff(delta), passed, out=np.zeros_like(push), where=passed > 0)
    return parts


def reduced_mass(scene: ig.Scene, command: Array) -> Array:
    """M (kg) at each commanded position (m); a tool fixed to a rigid robot is as if infinitely heavy."""
    mass, m_p, robot = np.full_like(command, scene.tool.mass), scene.object.mass, scene.robot
    if isinstance(scene.coupling, ig.Rigid):
        if robot is None:
            return np.full_like(command, m_p)
        if isinstance(robot, ig.RobotTable):
            mass += robot.splines(np.clip(command, robot.position[0], robot.position[-1]))[:, 0]
        else:
            mass += robot.mass
    return mass * m_p / (mass + m_p)
