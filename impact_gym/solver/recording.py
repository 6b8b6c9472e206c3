"""Writing down what happens: finished contacts and the trace. Rows that do not fit are counted, not written."""

import math

import numpy as np

from impact_gym.kernel import inner_kernel
from impact_gym.physics import budget
from impact_gym.solver import coupled
from impact_gym.solver.state import CHAIN, Chain, Run


@inner_kernel
def object_velocity(chain: Chain) -> float:
    """Velocity of the object, m/s; it rests until it is touched, whatever rounding says."""
    if chain.contacts == 0:
        return 0.0
    return chain.flange_velocity + chain.deflection_rate - chain.penetration_rate


@inner_kernel
def close_contact(run: Run, chain: Chain, end: float) -> None:
    """Enter the contact under way into the totals of `chain` and the contact log; `end` (s) is nan if unfinished."""
    impulse = coupled.coupling_impulse(run.law, chain)
    tool_change = coupled.tool_momentum(run.law, chain)
    object_change = run.bodies.object_mass * (object_velocity(chain) - chain.start_object_velocity)
    residual = budget.momentum_residual(tool_change, object_change, impulse)
    error = abs(residual) / chain.impulse if chain.impulse > 0.0 else 0.0
    chain.momentum_error = max(chain.momentum_error, error)
    chain.coupling_impulse += impulse
    row = chain.logged
    chain.logged += 1
    if row < run.recorder.contacts.shape[0]:
        log = run.recorder.contacts[row]
        log[0] = chain.start
        log[1] = end
        log[2] = chain.approach_velocity
        log[3] = -chain.penetration_rate
        log[4] = chain.contact_peak_force
        log[5] = chain.impulse
        log[6] = object_velocity(chain)
        log[7] = impulse
        log[8] = error


@inner_kernel
def trace(run: Run, chain: Chain, acceleration: float, contact_force: float) -> None:
    """Append the state of `chain` to the trace."""
    if run.recorder.trace.shape[0] == 0:
        return
    row = chain.traced
    chain.traced += 1
    if row < run.recorder.trace.shape[0]:
        line = run.recorder.trace[row]
        line[0] = chain.time
        line[1] = chain.flange_position + chain.flange_offset
        line[2] = chain.flange_velocity + chain.flange_offset_rate
        line[3] = chain.flange_position + chain.deflection
        line[4] = chain.flange_velocity + chain.deflection_rate
        line[5] = line[3] - chain.penetration
        line[6] = object_velocity(chain)
        line[7] = contact_force
        line[8] = coupled.coupling_force(run.law, chain, acceleration, contact_force)
        line[9] = chain.flange_position
        line[10] = chain.flange_velocity


@inner_kernel
def trace_flight(run: Run, chain: Chain, acceleration: float, duration: float) -> None:
    """Trace the `duration` (s) of flight ahead of `chain`, a point every `run.recorder.interval` at least."""
    if run.recorder.trace.shape[0] == 0:
        return
    ghost = np.empty(1, CHAIN)
    points = math.ceil(duration / run.recorder.interval)
    for point in range(points):
        traced = chain.traced
        ghost[0] = chain
        coupled.drift(run.law, ghost[0], acceleration, duration * point / points)
        trace(run, ghost[0], acceleration, 0.0)
        chain.traced = traced + 1
