"""Velocities, masses and forces of a chain at a time, and changes of its state between pieces."""


cdef inline double object_velocity(const Chain *chain) noexcept nogil:
    """Return the velocity of the object, m/s; exactly 0 before the first contact and while the object sticks."""
    if chain.contacts == 0 or chain.object_state == STUCK:
        return 0.0
    return tool_velocity(chain) - chain.penetration_rate


cdef inline double tool_velocity(const Chain *chain) noexcept nogil:
    return chain.flange_velocity + chain.deflection_rate


cdef inline double tool_position(const Chain *chain) noexcept nogil:
    return chain.flange_position + chain.deflection


cdef inline double flange_velocity(const ChainModel *model, const Chain *chain) noexcept nogil:
    """Return the true velocity of the flange, m/s; `chain.flange_velocity` is the imposed one."""
    return tool_velocity(chain) if model.with_tool else chain.flange_velocity + chain.flange_offset_rate


cdef inline double flange_position(const ChainModel *model, const Chain *chain) noexcept nogil:
    """Return the true position of the flange, m; `chain.flange_position` is the imposed one."""
    return tool_position(chain) if model.with_tool else chain.flange_position + chain.flange_offset


cdef inline double parallel(double first, double second) noexcept nogil:
    """Return the reduced mass of two bodies, kg."""
    return first * second / (first + second)


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
