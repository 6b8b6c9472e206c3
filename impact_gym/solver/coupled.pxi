"""Functions whose formulas differ between RIGID, SPRING and INTEGRATED chains."""


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
    now.analytic = law.kind != INTEGRATED and is_hertz(&run.contact)  # flights of these chains are not integrated
    now.threshold = run.threshold / now.units.force
    now.horizon = (until - chain.time) / now.units.time
    now.push = acceleration * now.units.time / now.units.velocity
    now.position, now.velocity = chain.flange_position, chain.flange_velocity
    now.rough, now.object_state, now.share = run.ground > 0.0, <int> chain.object_state, 1.0
    now.ground = (run.ground if chain.object_state != STUCK else 0.0) * now.units.time / now.units.velocity
    now.friction = run.object_mass * run.ground / now.units.force
    now.standstill = STANDSTILL * (1.0 + fabs(chain.flange_velocity) / now.units.velocity)
    if law.kind == RIGID:
        now.width = IMPULSE + 1
        if chain.object_state == STUCK:
            now.share = 0.0
    elif law.kind == SPRING:
        now.width = DEFLECTION_INTEGRAL + 1
        now.pull_y = -law.frequency * law.frequency * now.units.time * now.units.time
        now.pull_y_dot = -2.0 * law.damping_ratio * law.frequency * now.units.time
        now.tool_share = run.object_mass / (law.tool_mass + run.object_mass)
        if chain.object_state == STUCK:
            now.share = now.tool_share
    else:
        now.width = OFFSET_RATE + 1
        begin_integrated(run, chain, now)


cdef void begin_integrated(const Run *run, const Chain *chain, Piece *now) noexcept nogil:
    cdef double direction = chain.flange_velocity if chain.flange_velocity != 0.0 else now.acceleration
    now.robot = robot_table(run)
    if now.robot.intervals:
        now.place = robot_place(&now.robot, chain.flange_position, direction)
        now.lumped = robot_within(&now.robot, now.place, chain.flange_position)
    now.per_acceleration = now.units.time / now.units.velocity
    now.per_force = 1.0 / now.units.force
    now.tool_rate = now.per_acceleration / run.law.tool_mass
    now.object_rate = now.per_acceleration / run.object_mass if chain.object_state != STUCK else 0.0
    now.pressed, now.side = <int> chain.pressed, <int> chain.side


cdef void load(const Piece *now, const Chain *chain, double *x) noexcept nogil:
    memset(x, 0, sizeof(double) * WIDTH)
    if now.flying:
        x[ROOT] = min(chain.penetration, 0.0) / now.units.length
    else:
        x[ROOT] = sqrt(max(chain.penetration, 0.0) / now.units.length)
    x[RATE] = chain.penetration_rate / now.units.velocity
    if now.law.kind != RIGID:
        x[DEFLECTION] = chain.deflection / now.units.length
        x[DEFLECTION_RATE] = chain.deflection_rate / now.units.velocity
    if now.law.kind == INTEGRATED:
        x[OFFSET] = chain.flange_offset / now.units.length
        x[OFFSET_RATE] = chain.flange_offset_rate / now.units.velocity


cdef void store(const Piece *now, const Chain *base, const double *x, Chain *chain) noexcept nogil:
    """Write the scaled state `x` into `chain`. `base` is the chain at the start of the piece, or `chain` itself."""
    cdef double impulse = now.units.force * now.units.time
    if now.law.kind == SPRING:
        chain.deflection_integral = base.deflection_integral
        chain.deflection_integral += x[DEFLECTION_INTEGRAL] * now.units.length * now.units.time
    if now.law.kind == INTEGRATED:
        chain.flange_offset = x[OFFSET] * now.units.length
        chain.flange_offset_rate = x[OFFSET_RATE] * now.units.velocity
        chain.pull_impulse = base.pull_impulse + x[PULL_IMPULSE] * impulse
        chain.joined = base.joined + x[JOINED] * impulse
    store_common(now, base, x, chain)
    if now.law.kind != RIGID:
        chain.deflection = x[DEFLECTION] * now.units.length
        chain.deflection_rate = x[DEFLECTION_RATE] * now.units.velocity


cdef void rates(const Piece *now, const double *x, double *out) noexcept nogil:
    cdef RigidRates of_rigid
    cdef SpringRates of_spring
    cdef IntegratedRates of_all
    if now.law.kind == RIGID:
        of_rigid = rigid_rates(now, x[0], x[1])
        memcpy(out, &of_rigid, sizeof(RigidRates))
    elif now.law.kind == SPRING:
        of_spring = spring_rates(now, x[0], x[1], x[4], x[5])
        memcpy(out, &of_spring, sizeof(SpringRates))
    else:
        of_all = integrated_rates(now, x[0], x[1], x[2], x[4], x[5], x[8], x[9])
        memcpy(out, &of_all, sizeof(IntegratedRates))


cdef void jacobian(const Piece *now, const double *x, double[WIDTH] *J) noexcept nogil:
    memset(J, 0, sizeof(double) * WIDTH * WIDTH)
    if now.law.kind == RIGID:
        rigid_jacobian(now, x, J)
    elif now.law.kind == SPRING:
        spring_jacobian(now, x, J)
    else:
        integrated_jacobian(now, x, J)


cdef inline double explicit_step(const Piece *now, Work *work, double h) noexcept nogil:
    if now.law.kind == SPRING:
        return spring_step(now, work, h)
    if now.law.kind == RIGID:
        return rigid_step(now, work, h)
    return integrated_step(now, work, h)


cdef void dense_output(const Piece *now, Work *work, double h) noexcept nogil:
    """Compute the last four coefficients of the polynomial that interpolates the last explicit step."""
    if now.law.kind == SPRING:
        spring_dense(now, work, h)
    elif now.law.kind == RIGID:
        rigid_dense(now, work, h)
    else:
        integrated_dense(now, work, h)


cdef double apparent_eigenvalue(const Piece *now, const Work *work) noexcept nogil:
    """Estimate the largest eigenvalue. A series step uses `fastest`, an explicit step uses its last two stages."""
    if work.method == SERIES:
        return fastest(now, work.trial, work.trial_rate)
    if now.law.kind == SPRING:
        return spring_eigenvalue(work)
    if now.law.kind == RIGID:
        return rigid_eigenvalue(work)
    return integrated_eigenvalue(work)


cdef inline double ground_now(const Run *run, const Chain *chain) noexcept nogil:
    """Return the object's present deceleration by the friction under it, m/s^2; 0 if the object sticks."""
    return run.ground if chain.object_state != STUCK else 0.0


cdef inline void drift(const Run *run, Chain *chain, double acceleration, double time) noexcept nogil:
    if run.law.kind == RIGID:
        rigid_drift(chain, acceleration, ground_now(run, chain), time)
    else:
        spring_drift(run.law, chain, acceleration, ground_now(run, chain), time)


cdef inline double touch_time(const Run *run, const Chain *chain, double acceleration, double horizon) noexcept nogil:
    """Return the time (s) until a RIGID or SPRING chain touches the object; inf: later than `horizon`; nan: unknown."""
    cdef double time, ground = ground_now(run, chain)
    if run.law.kind == SPRING:
        return spring_touch(run.law, chain, acceleration, ground, horizon)
    time = gap_closes(-chain.penetration, chain.penetration_rate, acceleration + ground)
    return time if time <= horizon else INFINITY


cdef double smooth_until(const Run *run, const Chain *chain, double acceleration, double until) noexcept nogil:
    """Return `until` (s), or the earlier time at which the imposed position reaches one of the table's `breaks`."""
    cdef double low, high, ahead = INFINITY, behind = INFINITY, x_r = chain.flange_position, v_r = chain.flange_velocity
    cdef RobotTable table
    if run.law.kind != INTEGRATED or not run.law.intervals:
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
    cdef double reach
    if run.law.kind == RIGID:
        return chain.penetration_rate <= 0.0
    if object_velocity(chain) < 0.0:
        return False
    if run.law.kind == SPRING:
        reach = hypot(chain.deflection, chain.deflection_rate / run.law.frequency)
    else:
        reach = integrated_reach(run, chain)
    return reach <= chain.deflection - chain.penetration


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


cdef double coupling_impulse(const Law *law, const Chain *chain) noexcept nogil:
    cdef double w = law.frequency, stretched = chain.deflection - chain.start_deflection
    if law.kind == RIGID:
        return law.tool_mass * (chain.flange_velocity - chain.start_tool_velocity) + chain.impulse
    if law.kind == SPRING:
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
    """Return accelerations and forces of an INTEGRATED chain under a contact force `push` (N), in SI units."""
    cdef Piece now
    cdef Swing at
    now.law, now.acceleration, now.units = run.law, acceleration, Units(1.0, 1.0, 1.0, 1.0)
    now.position, now.velocity = chain.flange_position, chain.flange_velocity
    now.push, now.ground = acceleration, ground_now(run, chain)
    begin_integrated(run, chain, &now)
    at = swing(&now, 0.0, chain.deflection, chain.deflection_rate, chain.flange_offset, chain.flange_offset_rate)
    return motion(&now, &at, push)


cdef double tool_momentum(const Run *run, const Chain *chain) noexcept nogil:
    """Return the momentum (N s) that `moving_mass` gained in the contact, less that of joining mass (`joined`)."""
    cdef double before = moving_mass(run, chain.start_flange_position) * chain.start_tool_velocity
    return moving_mass(run, chain.flange_position) * tool_velocity(chain) - before - chain.joined
