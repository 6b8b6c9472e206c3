"""Integrate a contact, or a flight that has no formula, to the next event."""

cdef double FIRST_STEP = 0.3  # length of the first step to try in a contact, in the variable s (see `contact.pxi`)
cdef double FIRST_FLIGHT = 0.1  # first trial step of a flight, in units of 1 / highest angular frequency of the chain
cdef double LARGEST_STEP = 1.0  # same unit; a longer step is tried only if it cannot contain a touch
# With friction, the duration (about z ds) of a contact's step is at most OVERSHOOT times the time left in the piece.
# In a longer step, the end of the piece could not be located.
cdef double OVERSHOOT = 1e3

cdef enum:
    TRACE_POINTS = 8  # number of trace points in a step of a contact; 1.5 times as many in a step by Taylor series
    EVENTS_IN_TURN = 20  # number of events to try in turn as the end of a step, before a shorter step is tried


cdef int integrate(Run *run, Chain *chain, double acceleration, double until, bint flying) noexcept nogil:
    """Advance `chain` through one smooth piece: to time `until` (s) or to the first event; return the status."""
    cdef Work *work = run.work
    cdef Piece piece
    cdef Events[2] both
    cdef Events *start = &both[0]
    cdef Events *end = &both[1]
    cdef Finding found
    cdef bint undetected = not flying and isinf(chain.detection)
    cdef double taken, peak = 0.0, top = 0.0, h = FIRST_FLIGHT if flying else chain.memory.step
    run.contact.damping = chain.damping
    begin_piece(run, chain, acceleration, until, flying, &piece)
    load(&piece, chain, work.x)
    rates(&piece, work.x, work.rate)
    evaluate_events(&piece, work.x, work.rate, start)
    if flying and work.x[ROOT] == 0.0 and work.x[RATE] < 0.0 < work.rate[RATE]:
        h = min(h, -work.x[RATE] / work.rate[RATE])  # the step ends by about the time when the gap stops opening
    if not flying:
        peak = start.height[FORCE]  # if the damping exponent n is 0, a contact begins with a force above 0
        if undetected and start.value[FORCE] >= 0.0:
            chain.detection = chain.time
            return DETECTED
        if piece.has_friction and piece.object_state == STUCK and work.x[ROOT] == 0.0 and start.value[SLIP] > 0.0:
            return conclude(run, chain, SLIP, until)
    work.memory, work.expanded = chain.memory, False
    while True:
        chain.steps += 1
        found.event = NOTHING
        if h < 1e-300:
            work.x[RATE] = NAN
        if h < 1e-300 or chain.steps > run.max_steps:
            break
        if not good_step(&piece, work, start, end, undetected, &h, &taken, &found):
            continue
        if found.detection <= work.trial[TIME]:
            chain.detection = chain.time + found.detection * piece.units.time
            undetected, until = False, min(until, chain.detection + run.reaction)
            piece.horizon = min(piece.horizon, found.detection + piece.reaction)
        if run.recorder.trace_rows > 0 and taken > 0.0:
            trace_step(run, &piece, chain, taken)
        if not flying:
            peak = max(max(peak, end.height[FORCE]), found.peak if found.peak_at <= taken else 0.0)
            if piece.has_friction and piece.object_state == SLIDING:
                top = max(max(top, end.height[TOP]), found.top if found.top_at <= taken else 0.0)
        memcpy(work.x, work.trial, sizeof(work.x))
        memcpy(work.rate, work.trial_rate, sizeof(work.x))
        work.expanded = False
        start, end = end, start
        if found.event != NOTHING:
            break
    if piece.has_friction and not flying:
        add_ground_impulse(&piece, run, chain, work.x)
    store(&piece, chain, work.x, chain)
    chain.memory = work.memory
    chain.memory.step = h
    if not flying:
        chain.contact_peak_force = max(chain.contact_peak_force, peak * piece.units.force)
        chain.peak_force = max(chain.peak_force, chain.contact_peak_force)
        chain.unread_force = max(chain.unread_force, peak * piece.units.force)
        chain.peak_object_velocity = max(chain.peak_object_velocity, top * piece.units.velocity)
    if not isfinite(chain.penetration_rate + chain.deflection_rate):
        return NOT_FINITE
    return conclude(run, chain, found.event, until)


cdef void add_ground_impulse(const Piece *piece, const Run *run, Chain *chain, const double *x) noexcept nogil:
    """Add the ground's impulse: if the object sticks, the contact force's impulse, else mu m_p g times the duration."""
    if piece.object_state == STUCK:
        chain.ground_impulse += x[IMPULSE] * piece.units.force * piece.units.time
    else:
        chain.ground_impulse += run.object_mass * run.ground * x[TIME] * piece.units.time


cdef void come_to_rest(Chain *chain) noexcept nogil:
    """Let the object stick to the ground from now on."""
    chain.object_state, chain.object_rest_time = STUCK, chain.time
    chain.penetration_rate = tool_velocity(chain)


cdef bint good_step(
    const Piece *piece, Work *work, const Events *start, Events *end, bint undetected, double *h, double *taken,
    Finding *found
) noexcept nogil:
    """Try a step of `h`, or less if an event ends it. Return whether to accept the step; set `h` for the next one."""
    cdef double error, factor, tried, left = INFINITY, most = INFINITY
    if piece.flying:
        left = piece.horizon - work.x[TIME]
        if h[0] > LARGEST_STEP:
            h[0] = longest_blind_step(piece, work.x, min(h[0], left), LARGEST_STEP)
    elif piece.has_friction and work.x[ROOT] > 0.0 and piece.horizon > work.x[TIME]:
        most = OVERSHOOT * (piece.horizon - work.x[TIME]) / work.x[ROOT]
    choose_method(piece, work, h)
    taken[0] = tried = min(min(h[0], left), most)
    error = attempt(piece, work, tried)
    factor = judge(piece, work, tried, &error)
    if error > 1.0:
        h[0] = factor * tried
        return False
    evaluate_events(piece, work.trial, work.trial_rate, end)
    found[0] = search(piece, work, tried, start, end, undetected)
    if found.event == SHORTER:
        h[0] = found.fraction * tried
        return False
    if found.event != NOTHING:
        taken[0] = step_onto_first(piece, work, tried, start, end, undetected and isinf(found.detection), found, &error)
        if found.event == SHORTER:
            h[0] = found.fraction * taken[0]
            return False
        if error > 1.0:  # a shorter step can have a larger error
            h[0] = taken[0] * step_factor(work, error)
            return False
    elif tried >= left:
        found.event = CLOCK
    h[0] = max(h[0], factor * tried) if tried < h[0] else factor * tried
    return True


cdef double step_onto_first(
    const Piece *piece, Work *work, double tried, const Events *start, Events *end, bint undetected, Finding *found,
    double *error
) noexcept nogil:
    """Take a step that ends on the first event; return the step's length. `found.event` is SHORTER if that failed."""
    cdef int other
    cdef double taken = tried
    for _ in range(EVENTS_IN_TURN):
        taken = step_onto_event(piece, work, found, taken, error)
        evaluate_events(piece, work.trial, work.trial_rate, end)
        other = earlier_event(piece, end, found.event, undetected)
        if other == NOTHING:
            return taken
        if starts_on(other, taken, start, end.value[other]):
            found.event, found.fraction = SHORTER, 0.5
            return taken
        found.event, found.within = other, 1.0
        found.fraction = crossing_fraction(piece, work, taken, other, start, end, 1.0)
    found.event, found.fraction = SHORTER, 0.5  # the events are too close together, so their order is unknown
    return taken


cdef int conclude(Run *run, Chain *chain, int event, double until) noexcept nogil:
    """Change the discrete state of `chain` at the `event` that ends a piece; return the status."""
    if event == NOTHING:
        return STEP_LIMIT
    if event == CLOCK:
        chain.time = until
        return ARRIVED
    if event == TOUCH or event == SEPARATION:
        chain.penetration = 0.0
        return TOUCHED if event == TOUCH else PARTED
    if event == FORCE:
        chain.detection = chain.time
        return DETECTED
    if event == CLAMP:
        chain.force_active = 1 - chain.force_active
    elif event == SLIP:
        chain.object_state = SLIDING
    elif event == REST:
        come_to_rest(chain)
    elif event == ALIGNMENT:
        chain.side = -chain.side
        if chain.snaps < run.recorder.snap_rows:
            run.recorder.snaps[chain.snaps] = chain.time
        chain.snaps += 1
    else:
        chain.pressed = FREE if chain.pressed != FREE else FRONT if event == FRONT_STOP else REAR
    return SWITCHED


cdef void trace_step(Run *run, const Piece *piece, Chain *chain, double taken) noexcept nogil:
    """Record trace points of the accepted step. A shorter step from the same start computes each point inside."""
    cdef Chain ghost = chain[0]
    cdef Events events
    cdef int64_t point, points = TRACE_POINTS
    if run.work.method == SERIES:  # series steps are longer
        points = 3 * TRACE_POINTS // 2
    if piece.flying:
        points = <int64_t> ceil(taken * piece.units.time / run.recorder.interval)
    for point in range(1, points + 1):
        if point < points:
            probe_exactly(piece, run.work, taken, <double> point / points)
        else:
            memcpy(run.work.probe, run.work.trial, sizeof(run.work.probe))
            memcpy(run.work.probe_rate, run.work.trial_rate, sizeof(run.work.probe))
        store(piece, chain, run.work.probe, &ghost)
        events.height[FORCE] = 0.0
        if not piece.flying:
            evaluate_events(piece, run.work.probe, run.work.probe_rate, &events)
        trace(run, chain, &ghost, piece.acceleration, max(events.height[FORCE], 0.0) * piece.units.force)
