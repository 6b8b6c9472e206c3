"""One contact, from wherever it stands to the next thing that matters: its end, the alarm threshold, or the clock."""

import math

from impact_gym.kernel import inner_kernel
from impact_gym.physics import contact
from impact_gym.solver import collision as scaled
from impact_gym.solver import coupled, events, slider, stepper
from impact_gym.solver.chained import Piece
from impact_gym.solver.collision import RATE, ROOT, TIME, Collision, Origin
from impact_gym.solver.dop853 import STAGES, STATE, TRIAL
from impact_gym.solver.recording import object_velocity, trace
from impact_gym.solver.state import Chain, Run, Status

FIRST_STEP = 0.1  # of the variable s of physics.contact
GRAZE = 1e-12  # m/s, approach velocity of a touch at rest: from exactly zero the scaled equations never start
TRACE_POINTS = 8  # in a step

ARRIVED = int(Status.ARRIVED)
DETECTED = int(Status.DETECTED)
SEPARATED = int(Status.SEPARATED)
SWITCHED = int(Status.SWITCHED)
STEP_LIMIT = int(Status.STEP_LIMIT)
NOT_FINITE = int(Status.NOT_FINITE)


@inner_kernel
def begin(chain: Chain) -> None:
    """Open a contact at the state of `chain`: fresh approach velocity, empty budget."""
    chain.touching = 1
    chain.penetration = 0.0
    chain.penetration_rate = max(chain.penetration_rate, GRAZE)
    chain.start = chain.time
    chain.approach_velocity = chain.penetration_rate
    chain.start_tool_velocity = chain.flange_velocity + chain.deflection_rate
    chain.start_object_velocity = object_velocity(chain)
    chain.start_deflection = chain.deflection
    chain.start_flange_position = chain.flange_position
    chain.impulse = 0.0
    chain.deflection_integral = 0.0
    chain.pull_impulse = 0.0
    chain.joined = 0.0
    chain.contact_peak_force = 0.0
    chain.step = FIRST_STEP
    chain.contacts += 1
    chain.first_contact = min(chain.first_contact, chain.time)


@inner_kernel
def natural_units(run: Run, chain: Chain) -> contact.Scales:
    """Return the natural units of the contact under way."""
    mass = coupled.reduced_mass(run.law, run.bodies.object_mass, chain)
    return contact.scales(run.bodies.contact, mass, chain.approach_velocity)


@inner_kernel
def sensed_force(run: Run, chain: Chain) -> float:
    """Contact force now, N."""
    if chain.touching == 0:
        return 0.0
    units = natural_units(run, chain)
    root = math.sqrt(max(chain.penetration, 0.0) / units.length)
    return units.force * contact.force(run.bodies.contact, root, chain.penetration_rate / units.velocity)


@inner_kernel
def proceed(run: Run, chain: Chain, acceleration: float, until: float) -> int:
    """Advance a contact to time `until` (s) or to its end, or to the first crossing of the threshold."""
    law, bodies, work = run.law, run.bodies, run.work
    units = natural_units(run, chain)
    constants = coupled.collision(law, bodies, chain, acceleration, run.threshold, units)
    base = scaled.origin(chain, acceleration)
    horizon = (until - chain.time) / units.time
    unfelt = math.isinf(chain.detection)

    state, trial = work[STATE], work[TRIAL]
    rate, trial_rate = work[0], work[STAGES - 1]
    coupled.load(law, chain, units, state)
    coupled.rate(law, constants, state, rate)
    if unfelt and contact.force(constants.contact, state[ROOT], state[RATE]) > constants.threshold:
        chain.detection = chain.time
        return DETECTED

    gripping = contact.grip(constants.contact, state[ROOT], state[RATE]) > 0.0
    rising = gripping and contact.force_slope(constants.contact, state[ROOT], state[RATE], rate[RATE]) > 0.0
    # a linear contact begins with a force
    peak = max(chain.contact_peak_force / units.force, contact.force(constants.contact, state[ROOT], state[RATE]))
    h = chain.step
    method, seen = stepper.EXPLICIT, 0
    outcome = ARRIVED
    event = events.NONE
    while True:
        chain.steps += 1
        if chain.steps > run.tolerance.max_steps:
            outcome = STEP_LIMIT
            break
        stepper.attempt(method, law, constants, work, h)
        error = stepper.error(method, law, work, h, run.tolerance.relative)
        factor = stepper.factor(method, error)
        if error > 1.0:
            method, seen = stepper.watch(method, seen, law, work, h)
            h *= factor
            if h < 1e-300:
                outcome = NOT_FINITE
                break
            continue

        h_next = factor * h
        taken = h
        event = events.NONE
        if trial[ROOT] <= 0.0:
            taken = events.land(events.SEPARATION, method, law, constants, horizon, work, taken)
            event = events.SEPARATION
        if trial[TIME] >= horizon:
            taken = events.land(events.HORIZON, method, law, constants, horizon, work, taken)
            event = events.HORIZON
        if slider.exists(law):
            if taken > events.SHORTEST_STEP and events.slider_recurs(law, constants, horizon, work):
                h = 0.5 * taken
                continue
            turn = slider.turn(law, constants, state, rate, trial, trial_rate, taken)
            if turn < 1.0:
                taken *= turn
                event = events.TURN
                stepper.attempt(method, law, constants, work, taken)
            if slider.switch(law, constants, trial) > 0.0:
                taken = events.land(events.SWITCH, method, law, constants, horizon, work, taken)
                event = events.SWITCH
            if slider.passing(law, constants, trial) > 0.0:
                taken = events.land(events.PASSAGE, method, law, constants, horizon, work, taken)
                event = events.PASSAGE
        if (contact.grip(constants.contact, trial[ROOT], trial[RATE]) > 0.0) != gripping:
            taken = events.land(events.CLAMP, method, law, constants, horizon, work, taken)
            event = events.CLAMP
        if rising and contact.force_slope(constants.contact, trial[ROOT], trial[RATE], trial_rate[RATE]) < 0.0:
            taken = events.land(events.PEAK, method, law, constants, horizon, work, taken)
            event = events.PEAK
        if unfelt and contact.force(constants.contact, trial[ROOT], trial[RATE]) > constants.threshold:
            taken = events.land(events.THRESHOLD, method, law, constants, horizon, work, taken)
            event = events.THRESHOLD

        if event != events.NONE:
            # the error was judged over a step that may have run through a kink; judge the one that is taken
            error = stepper.error(method, law, work, taken, run.tolerance.relative)
            if error > 1.0:
                h = taken * stepper.factor(method, error)
                continue
        if run.recorder.trace.shape[0] > 0:
            trace_step(run, method, constants, chain, base, units, taken)
        method, seen = stepper.watch(method, seen, law, work, h)
        stepper.accept(law, work)
        h = h_next
        grip = contact.grip(constants.contact, state[ROOT], state[RATE]) > 0.0
        gripping = not gripping if event == events.CLAMP else grip
        slope = contact.force_slope(constants.contact, state[ROOT], state[RATE], rate[RATE])
        rising = gripping and slope > 0.0 and event != events.PEAK
        peak = max(peak, contact.force(constants.contact, state[ROOT], state[RATE]))
        if event == events.SEPARATION:
            state[ROOT] = 0.0
            outcome = SEPARATED
            break
        if event == events.HORIZON:
            break
        if event == events.THRESHOLD:
            outcome = DETECTED
            break
        if event in (events.SWITCH, events.PASSAGE):
            outcome = SWITCHED
            break

    coupled.store(law, chain, base, units, state)
    if outcome == ARRIVED:
        chain.time = until
    if outcome == DETECTED:
        chain.detection = chain.time
    if event == events.SWITCH:
        slider.switch_stop(chain)
    if event == events.PASSAGE:
        slider.record_passage(chain, run.recorder.snaps)
    if not math.isfinite(chain.penetration_rate):
        outcome = NOT_FINITE
    chain.step = h
    chain.contact_peak_force = peak * units.force
    chain.peak_force = max(chain.peak_force, chain.contact_peak_force)
    return outcome


@inner_kernel
def trace_step(
    run: Run, method: int, constants: Collision | Piece, chain: Chain, base: Origin, units: contact.Scales, taken: float
) -> None:
    """Trace points along the step just found good, each a step of the integrator from the same start."""
    trial = run.work[TRIAL]
    for point in range(1, TRACE_POINTS + 1):
        stepper.attempt(method, run.law, constants, run.work, taken * point / TRACE_POINTS)
        coupled.store(run.law, chain, base, units, trial)
        force = contact.force(constants.contact, max(trial[ROOT], 0.0), trial[RATE])
        trace(run, chain, base.acceleration, units.force * force)
