"""The approach in a room that moves: flange, tool and object have its velocity from the start.

A scene begins at rest, so that the public functions offer no other frame; the kernels do.
"""

import math

import numpy as np

from experiments.speed_vs_error.scenes import Approach
from impact_gym.kernel import kernel
from impact_gym.lowering import chain_law, contact_law
from impact_gym.physics.coupling import Law
from impact_gym.simulation import MAX_STEPS, profile_of
from impact_gym.solver import stepper
from impact_gym.solver.advance import command, reset
from impact_gym.solver.approach import Profile
from impact_gym.solver.contact import ARRIVED, DETECTED
from impact_gym.solver.recording import object_velocity
from impact_gym.solver.state import CHAIN, LOCAL_SHARE, Array, Bodies, Recorder, Run, Tolerance, recorder


@kernel
def boosted(
    law: Law,
    bodies: Bodies,
    chains: Array,
    distance: float,
    profile: Profile,
    duration: float,
    tolerance: Tolerance,
    log: Recorder,
    boost: float,
) -> float:
    """Return V_p (m/s) as `solver.approach` would find it, all velocities and targets raised by `boost` (m/s)."""
    chain = chains[0]
    run = Run(law, bodies, profile.threshold, tolerance, log, stepper.workspace(law))
    reset(chain, distance)
    chain.flange_velocity = boost
    target, acceleration, brake_at = profile.speed + boost, profile.acceleration, math.inf
    while chain.time < duration:
        status = command(run, chain, target, acceleration, min(brake_at, duration))
        if status == DETECTED:
            brake_at = chain.detection + profile.delay
        elif status != ARRIVED:
            return math.nan
        if chain.time >= brake_at:
            target, acceleration, brake_at = boost, profile.deceleration, math.inf
    return object_velocity(chain)


def velocity_in_frame(approach: Approach, boost: float, rtol: float) -> float:
    """V_p as someone at rest in the room finds it, m/s."""
    scene = approach.scene
    law = chain_law(scene.tool.mass, scene.coupling, scene.robot)
    bodies = Bodies(scene.object.mass, contact_law(scene.contact))
    profile, tolerance = profile_of(approach.motion), Tolerance(LOCAL_SHARE * rtol, MAX_STEPS)
    found = boosted(
        law, bodies, np.zeros(1, CHAIN), scene.object.distance, profile, approach.duration, tolerance, recorder(), boost
    )
    return float(found) - boost
