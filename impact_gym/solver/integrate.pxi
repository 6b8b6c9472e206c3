"""The one loop that integrates: a contact, or the flight of a chain without a closed form, from event to event."""

cdef double FIRST_STEP = 0.3  # of the variable s of a contact
cdef double FIRST_FLIGHT = 0.1  # of a flight, over the inverse of the chain's highest angular frequency
cdef double LARGEST_STEP = 1.0
# Likewise, stops apart. Within it the gap's third
# derivative hardly changes sign twice, which is what the search for a touch relies on; a step too short for the tool to
# get there need not be searched, and may be larger.

cdef enum:
    TRACE_POINTS = 8  # in a step of a contact


cdef int integrate(Run *run, Chain *chain, double acceleration, double until, bint flying) noexcept nogil:
    """Advance `chain` through one smooth piece: to time `until` (s) or to the first event; return what came of it."""
    cdef Work *work = run.work
    cdef Piece now
    cdef Sight[2] sights
    cdef Sight *start = &sights[0]
    cdef Sight *end = &sights[1]
    cdef Finding found
    cdef int other
    cdef bint unfelt = not flying and isinf(chain.detection)
    cdef double h = FIRST_FLIGHT if flying else chain.memory.step
    cdef double left, taken, error, factor, following, peak = 0.0
    begin_piece(run, chain, acceleration, until, flying, &now)
    load(&now, chain, work.x)
    rates(&now, work.x, work.rate)
    look(&now, work.x, work.rate, start)
    if flying and work.x[ROOT] == 0.0 and work.x[RATE] < 0.0 < work.rate[RATE]:  # soon back: first to where it turns
        h = min(h, -work.x[RATE] / work.rate[RATE])
    if not flying:
        peak = start.height[FORCE]  # a linear contact begins with one
        if unfelt and start.value[FORCE] > 0.0:
            chain.detection = chain.time
            return DETECTED
    work.memory = chain.memory
    while True:
        chain.steps += 1
        if chain.steps > run.max_steps:
            found.event = NOTHING
            break
        left = INFINITY
        if flying:
            left = now.horizon - work.x[TIME]
            if h > LARGEST_STEP:
                h = longest_blind_step(&now, work.x, min(h, left), LARGEST_STEP)
        taken = min(h, left)
        work.method = method_now(&work.memory)
        error = attempt(&now, work, taken)
        factor = judge(&now, work, taken, &error)
        if error > 1.0:
            h = taken * factor
            if h < 1e-300:
                found.event = NOTHING
                work.x[RATE] = NAN
                break
            continue
        following = max(h, factor * taken) if taken < h else factor * taken
        look(&now, work.trial, work.trial_rate, end)
        found = search(&now, work, taken, start, end, unfelt)
        if found.event == SHORTER:
            h = found.share * taken
            continue
        while found.event != NOTHING:
            taken = land(&now, work, &found, taken, &error)
            look(&now, work.trial, work.trial_rate, end)
            other = before_landing(&now, end, found.event, unfelt)
            if other == NOTHING:
                break
            found.event, found.share, found.within = other, crossing_share(&now, work, taken, other, start, end, 1.0), 1.0
        if error > 1.0:  # shorter, but not as good as it looked
            h = taken * step_factor(work, error)
            continue
        if run.recorder.trace_rows > 0:
            trace_step(run, &now, chain, taken)
        if not flying:
            peak = max(max(peak, end.height[FORCE]), found.peak if found.peak_at <= taken else 0.0)
        memcpy(work.x, work.trial, sizeof(work.x))
        memcpy(work.rate, work.trial_rate, sizeof(work.x))
        start, end = end, start
        h = following
        if found.event != NOTHING:
            break
        if taken >= left:
            found.event = CLOCK
            break
    store(&now, chain, work.x, chain)
    chain.memory = work.memory
    chain.memory.step = h
    if not flying:
        chain.contact_peak_force = max(chain.contact_peak_force, peak * now.units.force)
        chain.peak_force = max(chain.peak_force, chain.contact_peak_force)
    if not isfinite(chain.penetration_rate + chain.deflection_rate):
        return NOT_FINITE
    return conclude(run, chain, found.event, until)


cdef int conclude(Run *run, Chain *chain, int event, double until) noexcept nogil:
    """Let an event have its effect on `chain`; return what the caller is to know of it."""
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
        chain.holding = 1 - chain.holding
    elif event == ALIGNMENT:
        chain.side = -chain.side
        if chain.snaps < run.recorder.snap_rows:
            run.recorder.snaps[chain.snaps] = chain.time
        chain.snaps += 1
    else:
        chain.pressed = FREE if chain.pressed != FREE else FRONT if event == FRONT_STOP else REAR
    return SWITCHED


cdef void trace_step(Run *run, const Piece *now, Chain *chain, double taken) noexcept nogil:
    """Trace points along the step just found good, each on the integrator's polynomial."""
    cdef Chain ghost = chain[0]
    cdef Sight sight
    cdef int64_t point, points = TRACE_POINTS
    if now.flying:
        points = <int64_t> ceil(taken * now.units.time / run.recorder.interval)
    for point in range(1, points + 1):
        if point < points:
            probe(now, run.work, taken, <double> point / points)
        else:
            memcpy(run.work.probe, run.work.trial, sizeof(run.work.probe))
            memcpy(run.work.probe_rate, run.work.trial_rate, sizeof(run.work.probe))
        store(now, chain, run.work.probe, &ghost)
        sight.height[FORCE] = 0.0
        if not now.flying:
            look(now, run.work.probe, run.work.probe_rate, &sight)
        trace(run, chain, &ghost, now.acceleration, max(sight.height[FORCE], 0.0) * now.units.force)
