"""Functions whose formulas differ between kinds of chain, or between analytic and general pieces (`Piece.analytic`)."""


cdef void begin_piece(
    const Run *run, const Chain *chain, double acceleration, double until, bint flying, Piece *piece
) noexcept nogil:
    """Set the constants `piece` for the integration from the state of `chain` to `until` (s) or to an earlier event."""
    cdef const ChainModel *model = run.model
    piece.model, piece.flying, piece.acceleration = model, flying, acceleration
    piece.units = flight_units(run, chain, acceleration) if flying else chain.units
    piece.unclamped, piece.contact = &run.contact, run.contact
    if not chain.force_active:
        piece.contact.active = piece.contact.damping = 0.0
    piece.tolerance = run.tolerance
    piece.analytic = has_series(run)
    piece.width = WIDTHS[model.kind]
    piece.threshold = run.threshold / piece.units.force
    piece.horizon = (until - chain.time) / piece.units.time
    piece.push = acceleration * piece.units.time / piece.units.velocity
    piece.position, piece.velocity = chain.flange_position, chain.flange_velocity
    piece.has_friction, piece.object_state = run.ground > 0.0, <int> chain.object_state
    piece.ground = (run.ground if chain.object_state != STUCK else 0.0) * piece.units.time / piece.units.velocity
    piece.friction = run.object_mass * run.ground / piece.units.force
    piece.standstill = STANDSTILL * (1.0 + fabs(chain.flange_velocity) / piece.units.velocity)
    if model.kind == RIGID_CHAIN:  # as if the tool were infinitely heavy, and moved by inertia only
        piece.ground, piece.push = piece.ground + piece.push, 0.0
    if piece.analytic:
        begin_analytic(run, piece)
    else:
        begin_general(run, chain, piece)


cdef void begin_general(const Run *run, const Chain *chain, Piece *piece) noexcept nogil:
    """Set the constants of a general piece."""
    cdef double direction = chain.flange_velocity if chain.flange_velocity != 0.0 else piece.acceleration
    piece.robot = robot_table(run)
    piece.deflects, piece.yields = run.model.kind != RIGID_CHAIN, piece.robot.intervals > 0
    if piece.yields:
        piece.interval = interval_at(&piece.robot, chain.flange_position, direction)
        piece.lumped = robot_within(&piece.robot, piece.interval, chain.flange_position)
    piece.per_acceleration = piece.units.time / piece.units.velocity
    piece.per_force = 1.0 / piece.units.force
    piece.tool_rate = piece.per_acceleration / run.model.tool_mass if piece.deflects else 0.0
    piece.object_rate = piece.per_acceleration / run.object_mass if chain.object_state != STUCK else 0.0
    piece.pressed, piece.side = <int> chain.pressed, <int> chain.side


cdef void load(const Piece *piece, const Chain *chain, double *x) noexcept nogil:
    """Write the state of `chain`, scaled, into `x`."""
    memset(x, 0, sizeof(double) * WIDTH)
    if piece.flying:
        x[ROOT] = min(chain.penetration, 0.0) / piece.units.length
    else:
        x[ROOT] = sqrt(max(chain.penetration, 0.0) / piece.units.length)
    x[RATE] = chain.penetration_rate / piece.units.velocity
    x[DEFLECTION] = chain.deflection / piece.units.length
    x[DEFLECTION_RATE] = chain.deflection_rate / piece.units.velocity
    if not piece.analytic:
        x[OFFSET] = chain.flange_offset / piece.units.length
        x[OFFSET_RATE] = chain.flange_offset_rate / piece.units.velocity


cdef void store(const Piece *piece, const Chain *base, const double *x, Chain *chain) noexcept nogil:
    """Write the scaled state `x` into `chain`. `base` is the chain at the start of the piece, or `chain` itself."""
    cdef double elapsed = x[TIME] * piece.units.time, impulse = piece.units.force * piece.units.time
    if piece.analytic:
        chain.deflection_integral = base.deflection_integral
        chain.deflection_integral += x[DEFLECTION_INTEGRAL] * piece.units.length * piece.units.time
    else:
        chain.flange_offset = x[OFFSET] * piece.units.length
        chain.flange_offset_rate = x[OFFSET_RATE] * piece.units.velocity
        chain.pull_impulse = base.pull_impulse + x[PULL_IMPULSE] * impulse
        chain.joined = base.joined + x[JOINED] * impulse
    chain.time = base.time + elapsed
    chain.flange_position = base.flange_position + elapsed * (base.flange_velocity + 0.5 * piece.acceleration * elapsed)
    chain.flange_velocity = base.flange_velocity + piece.acceleration * elapsed
    chain.deflection = x[DEFLECTION] * piece.units.length
    chain.deflection_rate = x[DEFLECTION_RATE] * piece.units.velocity
    chain.penetration_rate = x[RATE] * piece.units.velocity
    if piece.flying:
        chain.penetration = x[ROOT] * piece.units.length
    else:
        chain.penetration = x[ROOT] * x[ROOT] * piece.units.length
        chain.impulse = base.impulse + x[IMPULSE] * piece.units.force * piece.units.time


cdef void rates(const Piece *piece, const double *x, double *out) noexcept nogil:
    """Write the derivative of the scaled state `x` into `out`: by s (`contact.pxi`), in flight by scaled time."""
    cdef GeneralRates of_all
    if piece.analytic:
        analytic_rates(&piece.polynomial, x, out)
    else:
        of_all = general_rates(piece, x[0], x[1], x[2], x[4], x[5], x[8], x[9])
        memcpy(out, &of_all, sizeof(GeneralRates))


cdef void jacobian(const Piece *piece, const double *x, double[WIDTH] *J) noexcept nogil:
    """Write the derivatives of `rates` by the scaled state `x` into `J`, a row for each rate."""
    memset(J, 0, sizeof(double) * WIDTH * WIDTH)
    if piece.analytic:
        analytic_jacobian(piece, x, J)
    else:
        general_jacobian(piece, x, J)


cdef double smooth_until(const Run *run, const Chain *chain, double acceleration, double until) noexcept nogil:
    """Return `until` (s), or the earlier time at which the imposed position reaches one of the table's `breaks`."""
    cdef double low, high, ahead = INFINITY, behind = INFINITY, x_r = chain.flange_position, v_r = chain.flange_velocity
    cdef RobotTable table
    if not run.model.intervals:
        return until
    table = robot_table(run)
    low, high = robot_bounds(&table, interval_at(&table, x_r, v_r if v_r != 0.0 else acceleration))
    if high < INFINITY:
        ahead = gap_closes(high - x_r, v_r, acceleration)
    if low > -INFINITY:
        behind = gap_closes(x_r - low, -v_r, -acceleration)
    return min(until, chain.time + min(ahead, behind))


cdef bint cannot_touch(const Run *run, const Chain *chain) noexcept nogil:
    """Return True if no touch is possible while the imposed motion stays at rest; False: possible or unknown."""
    if run.model.kind == RIGID_CHAIN:
        return chain.penetration_rate <= 0.0
    if object_velocity(chain) < 0.0:
        return False
    return deflection_reach(run, chain) <= chain.deflection - chain.penetration


cdef void round_off(const ChainModel *model, Chain *chain, double target) noexcept nogil:
    """Set the imposed velocity to exactly `target` (m/s) after a ramp; a tool on a spring keeps its velocity."""
    cdef double shift = target - chain.flange_velocity
    if model.kind == RIGID_CHAIN:
        chain.penetration_rate += shift
    else:
        chain.deflection_rate -= shift
    if model.coupled and model.intervals:
        chain.flange_offset_rate -= shift
    chain.flange_velocity = target
    if chain.object_state == STUCK:
        chain.penetration_rate = tool_velocity(chain)


cdef double coupling_impulse(const Run *run, const Chain *chain) noexcept nogil:
    """Return the impulse of the coupling on the tool since the start of the contact, N s (paper, eq. 21)."""
    cdef const ChainModel *model = run.model
    cdef double w = model.frequency, stretched = chain.deflection - chain.start_deflection
    if model.kind == RIGID_CHAIN:
        return model.tool_mass * (chain.flange_velocity - chain.start_tool_velocity) + chain.impulse
    if has_series(run):
        return -model.tool_mass * w * (w * chain.deflection_integral + 2.0 * model.damping_ratio * stretched)
    return chain.pull_impulse


cdef double coupling_force(const Run *run, const Chain *chain, double acceleration, double push) noexcept nogil:
    """Return the force of the coupling on the tool under a contact force `push`, N."""
    cdef const ChainModel *model = run.model
    cdef double force
    if model.kind == RIGID_CHAIN:
        return model.tool_mass * acceleration + push
    if model.kind == SPRING_CHAIN:
        force = relative_force(model.frequency, model.damping_ratio, chain.deflection, chain.deflection_rate)
        return model.tool_mass * force
    return motion_now(run, chain, acceleration, push).pull


cdef Accelerations motion_now(const Run *run, const Chain *chain, double acceleration, double push) noexcept nogil:
    """Return accelerations and forces of a spring or integrated chain under a contact force `push` (N), in SI units."""
    cdef Piece piece
    cdef ChainMotion at
    piece.model, piece.acceleration, piece.units = run.model, acceleration, Units(1.0, 1.0, 1.0, 1.0)
    piece.position, piece.velocity = chain.flange_position, chain.flange_velocity
    piece.push, piece.ground = acceleration, ground_now(run, chain)
    begin_general(run, chain, &piece)
    at = chain_motion(
        &piece, 0.0, chain.deflection, chain.deflection_rate, chain.flange_offset, chain.flange_offset_rate
    )
    return motion(&piece, &at, push)


cdef double tool_momentum(const Run *run, const Chain *chain) noexcept nogil:
    """Return the momentum (N s) that `moving_mass` gained in the contact, less that of joining mass (`joined`)."""
    cdef double before = moving_mass(run, chain.start_flange_position) * chain.start_tool_velocity
    return moving_mass(run, chain.flange_position) * tool_velocity(chain) - before - chain.joined
