"""A whole approach under the paper's rule: trapezoid, contact alarm, brake."""

import math
from typing import NamedTuple

from impact_gym.kernel import inner_kernel, kernel
from impact_gym.physics.coupling import Law
from impact_gym.solver import stepper
from impact_gym.solver.advance import command, reset
from impact_gym.solver.contact import ARRIVED, DETECTED
from impact_gym.solver.recording import close_contact
from impact_gym.solver.state import Array, Bodies, Chain, Recorder, Run, Tolerance


class Profile(NamedTuple):
    """A trapezoid and its brake for the kernels."""

    speed: float  # m/s
    acceleration: float  # m/s^2
    threshold: float  # N, inf without a brake
    delay: float  # s
    deceleration: float  # m/s^2


@kernel
def approach(
    law: Law,
    bodies: Bodies,
    chains: Array,
    distance: float,
    profile: Profile,
    duration: float,
    tolerance: Tolerance,
    recorder: Recorder,
) -> int:
    """Run `chains[0]` from rest for `duration` (s)."""
    work = stepper.workspace(law)
    return play(Run(law, bodies, profile.threshold, tolerance, recorder, work), chains[0], distance, profile, duration)


@inner_kernel
def play(run: Run, chain: Chain, distance: float, profile: Profile, duration: float) -> int:
    """Run `chain` from rest for `duration` (s); a contact unfinished then is entered with an end of nan."""
    reset(chain, distance)
    speed, acceleration = profile.speed, profile.acceleration
    brake_at = math.inf
    status = ARRIVED
    while chain.time < duration:
        until = min(brake_at, duration)
        status = command(run, chain, speed, acceleration, until)
        if status == DETECTED:
            brake_at = chain.detection + profile.delay
        elif status != ARRIVED:
            break
        if chain.time >= brake_at:
            speed, acceleration = 0.0, profile.deceleration
            brake_at = math.inf
            status = ARRIVED
    if chain.touching == 1:
        close_contact(run, chain, math.nan)
    return status
