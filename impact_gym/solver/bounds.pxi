"""Bounds on the motion of chains that deflect, by their energy (see `general.pxi`)."""


cdef inline double coupling_energy(const Law *law, double stretch) noexcept nogil:
    if law.stops:
        return mechanism_energy(&law.mechanism, stretch)
    return 0.5 * law.stiffness * stretch * stretch


cdef inline double coupling_reach(const Law *law, double stretch, double kinetic) noexcept nogil:
    """Return a bound on the future stretch, m, given the present stretch and `kinetic` energy (J)."""
    if law.stops:
        return mechanism_reach(&law.mechanism, stretch, kinetic)
    return sqrt(stretch * stretch + 2.0 * kinetic / law.stiffness)


cdef inline double moving_mass(const Run *run, double position) noexcept nogil:
    """Return the mass that strikes the object, kg: the tool's; with a DIRECT coupling also a compliant robot's."""
    cdef RobotTable table
    if run.law.coupled:
        return run.law.tool_mass
    table = robot_table(run)
    return run.law.tool_mass + robot_at(&table, position).mass


cdef double highest_frequency(const Run *run, double position) noexcept nogil:
    """Estimate the highest angular frequency of the chain without its stops, rad/s."""
    cdef const Law *law = run.law
    cdef RobotTable table = robot_table(run)
    cdef double square = law.stiffest if law.intervals else 0.0, k = law.stiffness
    if law.coupled:
        if law.stops:
            k = stiffness_bound(&law.mechanism)
        square += k / law.tool_mass
        if law.intervals:
            square += k / robot_at(&table, position).mass
    return sqrt(square)


cdef Units flight_units(const Run *run, const Chain *chain, double acceleration) noexcept nogil:
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


cdef double longest_blind_step(const Piece *now, const double *x, double longest, double shortest) noexcept nogil:
    """Return a scaled step, `longest` or shorter, in which a flight cannot touch the object. `shortest`: none found."""
    cdef const Law *law = now.law
    cdef Swing at = swing(now, x[TIME], x[DEFLECTION], x[DEFLECTION_RATE], x[OFFSET], x[OFFSET_RATE])
    cdef double touching = law.tool_mass, mass = law.tool_mass, energy, floor = 0.0, barrier = INFINITY
    cdef double closing = (x[RATE] - x[DEFLECTION_RATE]) * now.units.velocity, gap = -x[ROOT] * now.units.length
    cdef double span, gained, fed, h = longest, ground = now.ground * now.units.velocity / now.units.time
    if now.robot.intervals:
        mass += at.robot.mass
    if law.coupled:
        energy = coupling_energy(law, at.y - at.q) + 0.5 * law.tool_mass * at.y_dot * at.y_dot
        if now.robot.intervals:
            energy += 0.5 * (at.robot.mass * at.q_dot * at.q_dot + at.robot.stiffness * at.q * at.q)
        if law.stops:
            floor, barrier = mechanism_floor(&law.mechanism, now.side)
    else:
        touching = mass
        energy = 0.5 * (mass * at.y_dot * at.y_dot + at.robot.stiffness * at.y * at.y)
    # E is `energy`, in the frame of the imposed motion; sqrt(E) grows by at most |acceleration| sqrt(mass / 2) per s
    while h > shortest:
        span = h * now.units.time
        gained = fabs(now.acceleration) * sqrt(0.5 * mass) * span
        fed = sqrt(TABLE * max(energy - floor, 0.0)) + gained
        if floor + fed * fed >= barrier:  # the slider can pass its alignment, and the energy can then be below `floor`
            fed = sqrt(TABLE * energy) + gained
        if span * (closing + (fabs(now.acceleration) + ground) * span + fed * sqrt(2.0 / touching)) < gap:
            return h
        h *= 0.5
    return shortest


cdef double deflection_reach(const Run *run, const Chain *chain) noexcept nogil:
    """Return a bound on the future deflection, m, if the imposed motion stays at rest and no contact occurs."""
    cdef const Law *law = run.law
    cdef RobotTable table = robot_table(run)
    cdef RobotNow robot
    cdef double energy, stretch = chain.deflection - chain.flange_offset
    cdef double outside = 0.5 * law.tool_mass * chain.deflection_rate * chain.deflection_rate
    if not law.intervals:
        return coupling_reach(law, stretch, outside)
    robot = robot_at(&table, chain.flange_position)
    if not law.coupled:
        return hypot(chain.deflection, chain.deflection_rate * sqrt((robot.mass + law.tool_mass) / robot.stiffness))
    outside += 0.5 * robot.mass * chain.flange_offset_rate * chain.flange_offset_rate
    outside += 0.5 * robot.stiffness * chain.flange_offset * chain.flange_offset
    energy = outside + coupling_energy(law, stretch)
    return coupling_reach(law, stretch, outside) + sqrt(2.0 * energy / robot.stiffness)
