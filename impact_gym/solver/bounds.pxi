"""Bounds on the motion of chains that deflect, by their energy (see `general.pxi`)."""


cdef inline double coupling_energy(const ChainModel *model, double stretch) noexcept nogil:
    """Return the energy of the coupling and its stops, J."""
    if model.stops:
        return mechanism_energy(&model.mechanism, stretch)
    return 0.5 * model.stiffness * stretch * stretch


cdef inline double coupling_reach(const ChainModel *model, double stretch, double kinetic) noexcept nogil:
    """Return a bound on the future stretch, m, given the present stretch and `kinetic` energy (J)."""
    if model.stops:
        return mechanism_reach(&model.mechanism, stretch, kinetic)
    if model.stiffness == 0.0:  # a damper without spring
        return fabs(stretch) + sqrt(2.0 * kinetic * model.tool_mass) / model.damping
    return sqrt(stretch * stretch + 2.0 * kinetic / model.stiffness)


cdef inline double moving_mass(const Run *run, double position) noexcept nogil:
    """Return the mass that strikes the object, kg: the tool's; with a rigid coupling also a compliant robot's."""
    cdef RobotTable table
    if run.model.coupled:
        return run.model.tool_mass
    table = robot_table(run)
    return run.model.tool_mass + robot_at(&table, position).mass


cdef double highest_frequency(const Run *run, double position) noexcept nogil:
    """Estimate the highest angular frequency of the chain without its stops, rad/s."""
    cdef const ChainModel *model = run.model
    cdef RobotTable table = robot_table(run)
    cdef double square = model.stiffest if model.intervals else 0.0, k = model.stiffness
    if model.coupled:
        if model.stops:
            k = stiffness_bound(&model.mechanism)
        square += k / model.tool_mass
        if model.intervals:
            square += k / robot_at(&table, position).mass
    return max(sqrt(square), model.damping / model.tool_mass if k == 0.0 else 0.0)  # the decay of a damper alone


cdef Units flight_units(const Run *run, const Chain *chain, double acceleration) noexcept nogil:
    """Return units of a flight, from the present speeds and the chain's highest frequency."""
    cdef Units units
    units.time = 1.0 / highest_frequency(run, chain.flange_position)
    units.velocity = max(fabs(chain.penetration_rate - chain.deflection_rate), fabs(chain.flange_velocity))
    units.velocity = max(units.velocity, max(fabs(chain.deflection_rate), fabs(chain.flange_offset_rate)))
    units.velocity = max(units.velocity, max(fabs(acceleration) * units.time, APPROACH_VELOCITY_FLOOR))
    units.length = units.velocity * units.time
    units.force = units.velocity / units.time
    return units


cdef enum:
    TABLE = 2  # safety factor on the energy, because the robot's parameters vary within an interval of its table


cdef double longest_blind_step(const Piece *piece, const double *x, double longest, double shortest) noexcept nogil:
    """Return a scaled step, `longest` or shorter, in which a flight cannot touch the object. `shortest`: none found."""
    cdef const ChainModel *model = piece.model
    cdef ChainMotion at = chain_motion(piece, x[TIME], x[DEFLECTION], x[DEFLECTION_RATE], x[OFFSET], x[OFFSET_RATE])
    cdef double touching = model.tool_mass, mass = model.tool_mass, energy, floor = 0.0, barrier = INFINITY
    cdef double closing = (x[RATE] - x[DEFLECTION_RATE]) * piece.units.velocity, gap = -x[ROOT] * piece.units.length
    cdef double span, gained, fed, h = longest, ground = piece.ground * piece.units.velocity / piece.units.time
    if piece.robot.intervals:
        mass += at.robot.mass
    if model.coupled:
        energy = coupling_energy(model, at.y - at.q) + 0.5 * model.tool_mass * at.y_dot * at.y_dot
        if piece.robot.intervals:
            energy += 0.5 * (at.robot.mass * at.q_dot * at.q_dot + at.robot.stiffness * at.q * at.q)
        if model.stops:
            floor, barrier = mechanism_floor(&model.mechanism, piece.side)
    else:
        touching = mass
        energy = 0.5 * (mass * at.y_dot * at.y_dot + at.robot.stiffness * at.y * at.y)
    # E is `energy`, in the frame of the imposed motion; sqrt(E) grows by at most |acceleration| sqrt(mass / 2) per s
    while h > shortest:
        span = h * piece.units.time
        gained = fabs(piece.acceleration) * sqrt(0.5 * mass) * span
        fed = sqrt(TABLE * max(energy - floor, 0.0)) + gained
        if floor + fed * fed >= barrier:  # the slider can pass its alignment, and the energy can then be below `floor`
            fed = sqrt(TABLE * energy) + gained
        if span * (closing + (fabs(piece.acceleration) + ground) * span + fed * sqrt(2.0 / touching)) < gap:
            return h
        h *= 0.5
    return shortest


cdef double deflection_reach(const Run *run, const Chain *chain) noexcept nogil:
    """Return a bound on the future deflection, m, if the imposed motion stays at rest and no contact occurs."""
    cdef const ChainModel *model = run.model
    cdef RobotTable table = robot_table(run)
    cdef RobotNow robot
    cdef double energy, stretch = chain.deflection - chain.flange_offset
    cdef double outside = 0.5 * model.tool_mass * chain.deflection_rate * chain.deflection_rate
    if not model.intervals:
        return coupling_reach(model, stretch, outside)
    robot = robot_at(&table, chain.flange_position)
    if not model.coupled:
        return hypot(chain.deflection, chain.deflection_rate * sqrt((robot.mass + model.tool_mass) / robot.stiffness))
    outside += 0.5 * robot.mass * chain.flange_offset_rate * chain.flange_offset_rate
    outside += 0.5 * robot.stiffness * chain.flange_offset * chain.flange_offset
    energy = outside + coupling_energy(model, stretch)
    return coupling_reach(model, stretch, outside) + sqrt(2.0 * energy / robot.stiffness)
