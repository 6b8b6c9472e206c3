"""Flight until tool and object touch or the time is up: one exact step, or integrated where there is no closed form."""

import math

from impact_gym.kernel import by_type, inner_kernel
from impact_gym.physics import contact
from impact_gym.physics.coupling import MechanismLaw, RigidLaw, RobotLaw, SpringDamperLaw, VaryingLaw
from impact_gym.solver import chain_bounds, chained, coupled, events, slider, stepper
from impact_gym.solver import collision as scaled
from impact_gym.solver.chained import ChainedLaw, Flight, Piece
from impact_gym.solver.collision import RATE, ROOT, TIME, Origin
from impact_gym.solver.dop853 import STAGES, STATE, TRIAL
from impact_gym.solver.recording import trace, trace_flight
from impact_gym.solver.state import Chain, Run, Status

FIRST_STEP, LARGEST_STEP = 0.1, 1.0
"""Steps over the inverse of the chain's highest angular frequency, stops apart. Within the largest the gap's third
derivative hardly changes sign twice, which is what the search for a touch relies on; a step too short for the tool to
get there need not be searched, and may be larger."""

ARRIVED = int(Status.ARRIVED)
TOUCHED = int(Status.TOUCHED)
SWITCHED = int(Status.SWITCHED)
STEP_LIMIT = int(Status.STEP_LIMIT)
NOT_FINITE = int(Status.NOT_FINITE)


@inner_kernel
def closed_form(law: RigidLaw | SpringDamperLaw, run: Run, chain: Chain, acceleration: float, until: float) -> int:
    """Fly to the first touch or to time `until` (s), exactly."""
    left = until - chain.time
    touch = coupled.touch_time(run.law, chain, acceleration, left)
    flight = min(touch, left)
    trace_flight(run, chain, acceleration, flight)
    coupled.drift(run.law, chain, acceleration, flight)
    if touch <= left:
        return TOUCHED
    chain.time = until
    trace(run, chain, acceleration, 0.0)
    return ARRIVED


@inner_kernel
def integrated(law: ChainedLaw, run: Run, chain: Chain, acceleration: float, until: float) -> int:
    """Fly to the first touch or to time `until` (s), in smooth pieces between the switches of stops."""
    trace(run, chain, acceleration, 0.0)
    status = SWITCHED
    while status == SWITCHED and chain.time < until:
        status = glide(law, run, chain, acceleration, until)
    return ARRIVED if status == SWITCHED else status


fly = by_type(
    {
        RigidLaw: closed_form,
        SpringDamperLaw: closed_form,
        MechanismLaw: integrated,
        RobotLaw: integrated,
        VaryingLaw: integrated,
    }
)
"""Fly to the first touch (TOUCHED) or to a time (ARRIVED)."""


@inner_kernel
def flight_units(law: ChainedLaw, chain: Chain, acceleration: float) -> contact.Scales:
    """Return natural units of a flight: the chain's fastest motion, and the largest velocity at hand."""
    time = 1.0 / chain_bounds.highest_frequency(law, chain)
    closing = abs(chain.penetration_rate - chain.deflection_rate)
    own = max(abs(chain.deflection_rate), abs(chain.flange_offset_rate))
    pushed = abs(acceleration) * time
    v = max(closing, own, pushed, abs(chain.flange_velocity), contact.APPROACH_VELOCITY_FLOOR)
    return contact.Scales(v * time, time, v, v / time)


@inner_kernel
def glide(law: ChainedLaw, run: Run, chain: Chain, acceleration: float, until: float) -> int:
    """Integrate one smooth piece of a flight: until a touch, a switch of stops or of sides, or time `until` (s)."""
    flight = Flight(law)
    work = run.work
    units = flight_units(law, chain, acceleration)
    now = chained.collision(law, run.bodies, chain, acceleration, math.inf, units)
    base = scaled.origin(chain, acceleration)
    horizon = (until - chain.time) / units.time
    state, trial = work[STATE], work[TRIAL]
    rate = work[0]
    chained.load_flight(law, chain, units, state)
    coupled.rate(flight, now, state, rate)
    h = FIRST_STEP
    method, seen = stepper.EXPLICIT, 0
    outcome = ARRIVED
    event = events.NONE
    while True:
        chain.steps += 1
        if chain.steps > run.tolerance.max_steps:
            outcome = STEP_LIMIT
            break
        left = horizon - state[TIME]
        if h > LARGEST_STEP:
            h = chain_bounds.longest_blind_step(law, now, state, min(h, left), LARGEST_STEP)
        taken = min(h, left)
        stepper.attempt(method, flight, now, work, taken)
        error = stepper.error(method, flight, work, taken, run.tolerance.relative)
        factor = stepper.factor(method, error)
        if error > 1.0:
            method, seen = stepper.watch(method, seen, flight, work, h)
            h = taken * factor
            if h < 1e-300:
                outcome = NOT_FINITE
                break
            continue
        h_next = max(h, factor * taken) if taken < h else factor * taken
        whole = taken
        if taken > events.SHORTEST_STEP and recurs(flight, now, horizon, run):
            h = 0.5 * taken
            continue
        if slider.exists(flight):
            taken = search_slider(flight, method, now, run, taken)
        taken, found = search_touch(flight, method, now, run, taken, event)
        event = found
        if trial[ROOT] > 0.0:
            taken = events.land(events.TOUCH, method, flight, now, horizon, work, taken)
            event = events.TOUCH
        if slider.switch(flight, now, trial) > 0.0:
            taken = events.land(events.SWITCH, method, flight, now, horizon, work, taken)
            event = events.SWITCH
        if slider.passing(flight, now, trial) > 0.0:
            taken = events.land(events.PASSAGE, method, flight, now, horizon, work, taken)
            event = events.PASSAGE
        if taken < whole:
            # the error was judged over a step that may have run through a stop; judge the one that is taken
            error = stepper.error(method, flight, work, taken, run.tolerance.relative)
            if error > 1.0:
                h = taken * stepper.factor(method, error)
                continue
        if run.recorder.trace.shape[0] > 0:
            trace_glide(run, flight, method, now, chain, base, taken)
        method, seen = stepper.watch(method, seen, flight, work, h)
        stepper.accept(flight, work)
        h = h_next
        if event == events.TOUCH:
            state[ROOT] = 0.0
            outcome = TOUCHED
            break
        if event == events.SWITCH:
            slider.switch_stop(chain)
            outcome = SWITCHED
            break
        if event == events.PASSAGE:
            outcome = SWITCHED
            break
        if taken >= left:
            break

    chained.store_flight(law, chain, base, units, state)
    if outcome == ARRIVED:
        chain.time = until
    elif outcome == SWITCHED and event == events.PASSAGE:
        slider.record_passage(chain, run.recorder.snaps)
    if not math.isfinite(chain.penetration_rate + chain.deflection_rate):
        outcome = NOT_FINITE
    return outcome


@inner_kernel
def recurs(flight: Flight, now: Piece, horizon: float, run: Run) -> bool:
    """True if the last attempt starts on an event and ends beyond it."""
    work = run.work
    trial = work[TRIAL]
    if trial[ROOT] > 0.0 and events.starts_on(events.TOUCH, flight, now, horizon, work):
        return work[STATE, RATE] <= 0.0
    return slider.exists(flight) and events.slider_recurs(flight, now, horizon, work)


@inner_kernel
def search_slider(flight: Flight, method: int, now: Piece, run: Run, taken: float) -> float:
    """Shorten the last attempt to where the slider turns round inside it, if it does; return its length."""
    work = run.work
    turn = slider.turn(flight, now, work[STATE], work[0], work[TRIAL], work[STAGES - 1], taken)
    if turn < 1.0:
        taken *= turn
        stepper.attempt(method, flight, now, work, taken)
    return taken


@inner_kernel
def search_touch(flight: Flight, method: int, now: Piece, run: Run, taken: float, before: int) -> tuple[float, int]:
    """Shorten the last attempt so that the gap is monotone or ends closed; return its length and what ended it.

    A gap that opens at both ends may have closed between: then its acceleration changes sign. One that closes first
    and then opens has an extremum between, which tells by its sign whether it was a touch. What ended the step
    `before` is not found again.
    """
    work = run.work
    state, trial, rate, trial_rate = work[STATE], work[TRIAL], work[0], work[STAGES - 1]
    found = events.NONE
    if trial[ROOT] > 0.0:
        return taken, found
    closing = state[RATE] > 0.0 and before != events.TURN
    bends = rate[RATE] > 0.0 and trial_rate[RATE] < 0.0 and before != events.BEND
    if bends and not closing and trial[RATE] <= 0.0 and state[RATE] + taken * rate[RATE] > 0.0:
        taken = events.land(events.BEND, method, flight, now, 0.0, work, taken)
        found = events.BEND
    if closing and trial[RATE] < 0.0:
        taken = events.land(events.TURN, method, flight, now, 0.0, work, taken)
        found = events.TURN
    return taken, found


@inner_kernel
def trace_glide(run: Run, flight: Flight, method: int, now: Piece, chain: Chain, base: Origin, taken: float) -> None:
    """Trace points along the step just found good, each a step of the integrator from the same start."""
    points = math.ceil(taken * now.units.time / run.recorder.interval)
    for point in range(1, points + 1):
        stepper.attempt(method, flight, now, run.work, taken if point == points else taken * point / points)
        chained.store_flight(flight.law, chain, base, now.units, run.work[TRIAL])
        trace(run, chain, base.acceleration, 0.0)
