"""Writing down what happens: finished contacts and the trace. Rows that do not fit are counted, not written."""

import math

import numpy as np

from impact_gym.kernel import kernel
from impact_gym.physics import budget
from impact_gym.solver import coupled
from impact_gym.solver.coupled import Law
from impact_gym.solver.state import CHAIN, Bodies, Chain, Recorder


@kernel
def object_velocity(chain: Chain) -> float:
    """Velocity of the object, m/s."""
    return chain.flange_velocity + chain.deflection_rate - chain.penetration_rate


@kernel
def close_contact(law: Law, bodies: Bodies, chain: Chain, recorder: Recorder, end: float) -> None:
    """Enter the contact under way into the totals of `chain` and the contact log; `end` (s) is nan if unfinished."""
    impulse = coupled.coupling_impulse(law, chain)
    tool_change = law.tool_mass * (chain.flange_velocity + chain.deflection_rate - chain.start_tool_velocity)
    object_change = bodies.object_mass * (object_velocity(chain) - chain.start_object_velocity)
    residual = budget.momentum_residual(tool_change, object_change, impulse)
    if chain.impulse > 0.0:
        chain.momentum_error = max(chain.momentum_error, abs(residual) / chain.impulse)
    chain.coupling_impulse += impulse
    row = chain.logged
    chain.logged += 1
    if row < recorder.contacts.shape[0]:
        log = recorder.contacts[row]
        log[0] = chain.start
        log[1] = end
        log[2] = chain.approach_velocity
        log[3] = -chain.penetration_rate
        log[4] = chain.contact_peak_force
        log[5] = chain.impulse
        log[6] = object_velocity(chain)


@kernel
def trace(law: Law, chain: Chain, recorder: Recorder, acceleration: float, contact_force: float) -> None:
    """Append the state of `chain` to the trace."""
    if recorder.trace.shape[0] == 0:
        return
    row = chain.traced
    chain.traced += 1
    if row < recorder.trace.shape[0]:
        line = recorder.trace[row]
        line[0] = chain.time
        line[1] = chain.flange_position
        line[2] = chain.flange_velocity
        line[3] = chain.flange_position + chain.deflection
        line[4] = chain.flange_velocity + chain.deflection_rate
        line[5] = line[3] - chain.penetration
        line[6] = object_velocity(chain)
        line[7] = contact_force
        line[8] = coupled.coupling_force(law, chain, acceleration, contact_force)


@kernel
def trace_flight(law: Law, chain: Chain, recorder: Recorder, acceleration: float, duration: float) -> None:
    """Trace the `duration` (s) of flight ahead of `chain`, a point every `recorder.interval` at least."""
    if recorder.trace.shape[0] == 0:
        return
    ghost = np.empty(1, CHAIN)
    points = math.ceil(duration / recorder.interval)
    for point in range(points):
        traced = chain.traced
        ghost[0] = chain
        coupled.drift(law, ghost[0], acceleration, duration * point / points)
        trace(law, ghost[0], recorder, acceleration, 0.0)
        chain.traced = traced + 1
