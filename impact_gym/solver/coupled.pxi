"""Functions whose formulas differ between kinds of chain, or between analytic and general pieces (`Piece.analytic`)."""


cdef void begin_piece(
    const Run *run, const Chain *chain, double acceleration, double until, bint flying, Piece *now
) noexcept nogil:
    """Set the constants `now` for the integration from the state of `chain` to `until` (s) or to an earlier event."""
    cdef const Law *law = run.law
    now.law, now.flying, now.acceleration = law, flying, acceleration
    now.units = flight_units(run, chain, acceleration) if flying else chain.units
    now.grip, now.contact = &run.contact, run.contact
    if not chain.holding:
        now.contact.held = now.contact.damping = 0.0
    now.tolerance = run.tolerance
    now.analytic = has_series(run)
    now.width = WIDTHS[law.kind]
    now.threshold = run.threshold / now.units.force
    now.horizon = (until - chain.time) / now.units.time
    now.push = acceleration * now.units.time / now.units.velocity
    now.position, now.velocity = chain.flange_position, chain.flange_velocity
    now.rough, now.object_state = run.ground > 0.0, <int> chain.object_state
    now.ground = (run.ground if chain.object_state != STUCK else 0.0) * now.units.time / now.units.velocity
    now.friction = run.object_mass * run.ground / now.units.force
    now.standstill = STANDSTILL * (1.0 + fabs(chain.flange_velocity) / now.units.velocity)
    if law.kind == RIGID:  # as if the tool were infinitely heavy, and moved by inertia only
        now.ground, now.push = now.ground + now.push, 0.0
    if now.analytic:
        begin_analytic(run, now)
    else:
        begin_general(run, chain, now)


cdef void begin_general(const Run *run, const Chain *chain, Piece *now) noexcept nogil:
    cdef double direction = chain.flange_velocity if chain.flange_velocity != 0.0 else now.acceleration
    now.robot = robot_table(run)
    now.deflects, now.yields = run.law.kind != RIGID, now.robot.intervals > 0
    if now.yields:
        now.place = robot_place(&now.robot, chain.flange_position, direction)
        now.lumped = robot_within(&now.robot, now.place, chain.flange_position)
    now.per_acceleration = now.units.time / now.units.velocity
    now.per_force = 1.0 / now.units.force
    now.tool_rate = now.per_acceleration / run.law.tool_mass if now.deflects else 0.0
    now.object_rate = now.per_acceleration / run.object_mass if chain.object_state != STUCK else 0.0
    now.pressed, now.side = <int> chain.pressed, <int> chain.side


cdef void load(const Piece *now, const Chain *chain, double *x) noexcept nogil:
    memset(x, 0, sizeof(double) * WIDTH)
    if now.flying:
        x[ROOT] = min(chain.penetration, 0.0) / now.units.length
    else:
        x[ROOT] = sqrt(max(chain.penetration, 0.0) / now.units.length)
    x[RATE] = chain.penetration_rate / now.units.velocity
    x[DEFLECTION] = chain.deflection / now.units.length
    x[DEFLECTION_RATE] = chain.deflection_rate / now.units.velocity
    if not now.analytic:
        x[OFFSET] = chain.flange_offset / now.units.length
        x[OFFSET_RATE] = chain.flange_offset_rate / now.units.velocity


cdef void store(const Piece *now, const Chain *base, const double *x, Chain *chain) noexcept nogil:
    """Write the scaled state `x` into `chain`. `base` is the chain at the start of the piece, or `chain` itself."""
    cdef double elapsed = x[TIME] * now.units.time, impulse = now.units.force * now.units.time
    if now.analytic:
        chain.deflection_integral = base.deflection_integral
        chain.deflection_integral += x[DEFLECTION_INTEGRAL] * now.units.length * now.units.time
    else:
        chain.flange_offset = x[OFFSET] * now.units.length
        chain.flange_offset_rate = x[OFFSET_RATE] * now.units.velocity
        chain.pull_impulse = base.pull_impulse + x[PULL_IMPULSE] * impulse
        chain.joined = base.joined + x[JOINED] * impulse
    chain.time = base.time + elapsed
    chain.flange_position = base.flange_position + elapsed * (base.flange_velocity + 0.5 * now.acceleration * elapsed)
    chain.flange_velocity = base.flange_velocity + now.acceleration * elapsed
    chain.deflection = x[DEFLECTION] * now.units.length
    chain.deflection_rate = x[DEFLECTION_RATE] * now.units.velocity
    chain.penetration_rate = x[RATE] * now.units.velocity
    if now.flying:
        chain.penetration = x[ROOT] * now.units.length
    else:
        chain.penetration = x[ROOT] * x[ROOT] * now.units.length
        chain.impulse = base.impulse + x[IMPULSE] * now.units.force * now.units.time


cdef void rates(const Piece *now, const double *x, double *out) noexcept nogil:
    """Write the derivative of the scaled state `x` into `out`: by s (`contact.pxi`), in flight by scaled time."""
    cdef GeneralRates of_all
    if now.analytic:
        analytic_rates(&now.polynomial, x, out)
    else:
        of_all = general_rates(now, x[0], x[1], x[2], x[4], x[5], x[8], x[9])
        memcpy(out, &of_all, sizeof(GeneralRates))


cdef void jacobian(const Piece *now, const double *x, double[WIDTH] *J) noexcept nogil:
    """Write the derivatives of `rates` by the scaled state `x` into `J`, a row for each rate."""
    memset(J, 0, sizeof(double) * WIDTH * WIDTH)
    if now.analytic:
        analytic_jacobian(now, x, J)
    else:
        general_jacobian(now, x, J)


cdef double smooth_until(const Run *run, const Chain *chain, double acceleration, double until) noexcept nogil:
    """Return `until` (s), or the earlier time at which the imposed position reaches one of the table's `breaks`."""
    cdef double low, high, ahead = INFINITY, behind = INFINITY, x_r = chain.flange_position, v_r = chain.flange_velocity
    cdef RobotTable table
    if not run.law.intervals:
        return until
    table = robot_table(run)
    low, high = robot_bounds(&table, robot_place(&table, x_r, v_r if v_r != 0.0 else acceleration))
    if high < INFINITY:
        ahead = gap_closes(high - x_r, v_r, acceleration)
    if low > -INFINITY:
        behind = gap_closes(x_r - low, -v_r, -acceleration)
    return min(until, chain.time + min(ahead, behind))


cdef bint cannot_touch(const Run *run, const Chain *chain) noexcept nogil:
    """Return True if no touch is possible while the imposed motion stays at rest; False: possible or unknown."""
    if run.law.kind == RIGID:
        return chain.penetration_rate <= 0.0
    if object_velocity(chain) < 0.0:
        return False
    return deflection_reach(run, chain) <= chain.deflection - chain.penetration


cdef void round_off(const Law *law, Chain *chain, double target) noexcept nogil:
    """Set the imposed velocity to exactly `target` (m/s) after a ramp; a tool on a spring keeps its velocity."""
    cdef double shift = target - chain.flange_velocity
    if law.kind == RIGID:
        chain.penetration_rate += shift
    else:
        chain.deflection_rate -= shift
    if law.coupled and law.intervals:
        chain.flange_offset_rate -= shift
    chain.flange_velocity = target
    if chain.object_state == STUCK:
        chain.penetration_rate = tool_velocity(chain)


cdef double coupling_impulse(const Run *run, const Chain *chain) noexcept nogil:
    """Return the impulse of the coupling on the tool since the start of the contact, N s (paper, eq. 21)."""
    cdef const Law *law = run.law
    cdef double w = law.frequency, stretched = chain.deflection - chain.start_deflection
    if law.kind == RIGID:
        return law.tool_mass * (chain.flange_velocity - chain.start_tool_velocity) + chain.impulse
    if has_series(run):
        return -law.tool_mass * w * (w * chain.deflection_integral + 2.0 * law.damping_ratio * stretched)
    return chain.pull_impulse


cdef double coupling_force(const Run *run, const Chain *chain, double acceleration, double push) noexcept nogil:
    cdef const Law *law = run.law
    if law.kind == RIGID:
        return law.tool_mass * acceleration + push
    if law.kind == SPRING:
        return law.tool_mass * relative_force(law.frequency, law.damping_ratio, chain.deflection, chain.deflection_rate)
    return motion_now(run, chain, acceleration, push).pull


cdef Accelerations motion_now(const Run *run, const Chain *chain, double acceleration, double push) noexcept nogil:
    """Return accelerations and forces of a SPRING or INTEGRATED chain under a contact force `push` (N), in SI units."""
    cdef Piece now
    cdef Swing at
    now.law, now.acceleration, now.units = run.law, acceleration, Units(1.0, 1.0, 1.0, 1.0)
    now.position, now.velocity = chain.flange_position, chain.flange_velocity
    now.push, now.ground = acceleration, ground_now(run, chain)
    begin_general(run, chain, &now)
    at = swing(&now, 0.0, chain.deflection, chain.deflection_rate, chain.flange_offset, chain.flange_offset_rate)
    return motion(&now, &at, push)


cdef double tool_momentum(const Run *run, const Chain *chain) noexcept nogil:
    """Return the momentum (N s) that `moving_mass` gained in the contact, less that of joining mass (`joined`)."""
    cdef double before = moving_mass(run, chain.start_flange_position) * chain.start_tool_velocity
    return moving_mass(run, chain.flange_position) * tool_velocity(chain) - before - chain.joined
