"""Record contacts and trace points. Rows beyond the end of an array are counted, not stored. If the trace array is
empty, no trace point is computed."""


cdef void close_contact(const Run *run, Chain *chain, double end) noexcept nogil:
    """Add the present contact to the totals of `chain` and to the contact log. `end` (s): nan if unfinished."""
    cdef double impulse = coupling_impulse(run, chain)
    cdef double given = run.object_mass * (object_velocity(chain) - chain.start_object_velocity)
    cdef double residual = tool_momentum(run, chain) + given - impulse  # N s, of the momentum balance (paper, eq. 20)
    if run.ground > 0.0:
        residual += chain.ground_impulse
    cdef double error = fabs(residual) / chain.impulse if chain.impulse > 0.0 else 0.0
    chain.momentum_error = max(chain.momentum_error, error)
    chain.coupling_impulse += impulse
    if chain.logged < run.recorder.contact_rows:
        run.recorder.contacts[chain.logged] = ContactRow(
            chain.start, end, chain.approach_velocity, -chain.penetration_rate, chain.contact_peak_force,
            chain.impulse, object_velocity(chain), impulse, error,
        )
    chain.logged += 1


cdef void trace(const Run *run, Chain *counter, const Chain *chain, double acceleration, double push) noexcept nogil:
    """Append the state of `chain` and the contact force `push` (N) to the trace; count the row in `counter.traced`."""
    cdef TraceRow *row
    if run.recorder.trace_rows == 0:
        return
    if counter.traced < run.recorder.trace_rows:
        row = &run.recorder.trace[counter.traced]
        row.time = chain.time
        row.flange_position = flange_position(run.model, chain)
        row.flange_velocity = flange_velocity(run.model, chain)
        row.tool_position = tool_position(chain)
        row.tool_velocity = tool_velocity(chain)
        row.object_position = row.tool_position - chain.penetration
        row.object_velocity = object_velocity(chain)
        row.contact_force = push
        row.coupling_force = coupling_force(run, chain, acceleration, push)
        row.command_position = chain.flange_position
        row.command_velocity = chain.flange_velocity
    counter.traced += 1


cdef void trace_flight(const Run *run, Chain *chain, double acceleration, double duration) noexcept nogil:
    """Record trace points of the next `duration` (s) of a rigid or spring chain's flight, at most `interval` apart."""
    cdef Chain ghost
    cdef int64_t point, points
    if run.recorder.trace_rows == 0:
        return
    points = <int64_t> ceil(duration / run.recorder.interval)
    for point in range(points):
        ghost = chain[0]
        drift(run, &ghost, acceleration, duration * point / points)
        trace(run, chain, &ghost, acceleration, 0.0)
