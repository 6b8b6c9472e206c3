"""The loop that hands over: a command to the flange becomes a ramp and a hold, each a run of flights and contacts."""

import math

from impact_gym.kernel import inner_kernel
from impact_gym.physics.coupling import FRONT
from impact_gym.solver import contact, coupled, flight
from impact_gym.solver.contact import ARRIVED, DETECTED, SEPARATED, SWITCHED
from impact_gym.solver.flight import TOUCHED
from impact_gym.solver.recording import close_contact, trace
from impact_gym.solver.state import Chain, Run


@inner_kernel
def reset(chain: Chain, distance: float) -> None:
    """Put `chain` at rest at t = 0, the object `distance` (m) ahead, nothing having happened yet."""
    chain.time = 0.0
    chain.flange_position = 0.0
    chain.flange_velocity = 0.0
    chain.deflection = 0.0
    chain.deflection_rate = 0.0
    chain.penetration = -distance
    chain.penetration_rate = 0.0
    chain.flange_offset = 0.0
    chain.flange_offset_rate = 0.0
    chain.pressed = FRONT  # if there is a mechanism
    chain.side = 1
    chain.touching = 0
    chain.contacts = 0
    chain.first_contact = math.inf
    chain.detection = math.inf
    chain.peak_force = 0.0
    chain.coupling_impulse = 0.0
    chain.momentum_error = 0.0
    chain.steps = 0
    chain.logged = 0
    chain.traced = 0
    chain.snaps = 0


@inner_kernel
def command(run: Run, chain: Chain, target: float, acceleration: float, until: float) -> int:
    """Take the flange to velocity `target` (m/s) at `acceleration` (m/s^2) and hold it, until time `until` (s).

    Comes back earlier, with DETECTED, when the contact force first exceeds the threshold.
    """
    while chain.time < until:
        change = target - chain.flange_velocity
        ramp = math.copysign(acceleration, change) if change != 0.0 else 0.0
        end = until
        ramp_ends = False
        if change != 0.0:
            ramp_end = chain.time + abs(change) / acceleration
            if ramp_end <= until:
                end = ramp_end
                ramp_ends = True
        status = piece(run, chain, ramp, end)
        if status != ARRIVED:
            return status
        if ramp_ends:
            coupled.round_off(run.law, chain, target)
    return ARRIVED


@inner_kernel
def piece(run: Run, chain: Chain, acceleration: float, until: float) -> int:
    """Advance through flights and contacts under one constant acceleration of the flange."""
    while chain.time < until:
        end = coupled.smooth_until(run.law, chain, acceleration, until)
        if chain.touching == 0:
            status = flight.fly(run.law, run, chain, acceleration, end)
            if status == ARRIVED:
                continue
            if status != TOUCHED:
                return status
            contact.begin(chain)
            trace(run, chain, acceleration, 0.0)
            if run.threshold == 0.0 and math.isinf(chain.detection):
                chain.detection = chain.time
                return DETECTED
        status = contact.proceed(run, chain, acceleration, end)
        if status in (ARRIVED, SWITCHED):
            continue
        if status != SEPARATED:
            return status
        close_contact(run, chain, chain.time)
        chain.touching = 0
        chain.penetration = 0.0
    return ARRIVED
