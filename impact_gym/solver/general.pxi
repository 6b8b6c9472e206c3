"""Equations of motion of every chain in a contact with any law, and of an integrated chain also in flight.

An integrated chain has a coupling with stops, a compliant robot with an elastic coupling, or a robot table with a
rigid coupling. Contacts of other chains use these equations unless m = n = 3/2 (`series.pxi`). Forces are computed in
SI units, then scaled. The state has z, w, t, the impulse p on the object, the deflection y, its rate v, and the
coupling's impulse s on the tool. If a robot's mass depends on its position, j is the momentum of the mass that has
joined the moving part. q is the flange's offset from the imposed motion, r its rate. Components that stay 0 are not
computed (`Piece.deflects`, `Piece.yields`).
"""


cdef struct GeneralRates:
    double z, w, t, p, y, v, s, j, q, r


cdef struct ChainMotion:  # motion of the chain, SI units
    double x_r, v_r  # m, m/s, of the imposed motion
    double y, y_dot, q, q_dot  # m, m/s: deflection y and flange offset q, and their rates
    RobotNow robot


cdef struct Accelerations:  # accelerations are scaled, forces are in N
    double tool, flange  # relative to the imposed motion
    double gap  # acceleration of the tool relative to the object
    double pull  # N, of the coupling on the tool; with a rigid coupling, of the robot on flange and tool
    double joined  # N, momentum per time that joining robot mass brings into the moving part


cdef inline ChainMotion chain_motion(
    const Piece *piece, double t, double y, double v, double q, double r
) noexcept nogil:
    """Convert components of the scaled state to SI units, and look up the robot's parameters."""
    cdef ChainMotion at
    cdef double elapsed = t * piece.units.time
    at.x_r = piece.position + elapsed * (piece.velocity + 0.5 * piece.acceleration * elapsed)
    at.v_r = piece.velocity + piece.acceleration * elapsed
    at.y, at.y_dot = y * piece.units.length, v * piece.units.velocity
    at.q, at.q_dot = q * piece.units.length, r * piece.units.velocity
    if piece.robot.intervals == 1:
        at.robot = piece.lumped
    elif piece.robot.intervals:
        at.robot = robot_within(&piece.robot, piece.interval, at.x_r)
    return at


cdef inline double coupling_pull(const Piece *piece, double stretch, double stretch_rate) noexcept nogil:
    """Return the force of the coupling on the tool, N (paper, right side of eq. 17, or eq. 23)."""
    if piece.model.stops:
        return mechanism_pull(&piece.model.mechanism, piece.pressed, stretch, stretch_rate)
    return -piece.model.stiffness * stretch - piece.model.damping * stretch_rate


cdef inline Accelerations motion(const Piece *piece, const ChainMotion *at, double push) noexcept nogil:
    """Return accelerations and forces (paper, eq. 8, 16, 17) under the contact force `push`, N."""
    cdef Accelerations move
    cdef const RobotNow *robot = &at.robot
    cdef double flange_rate
    move.flange = move.joined = 0.0
    if not piece.model.coupled:
        move.pull = -robot.stiffness * at.y - robot.damping * at.y_dot
        move.gap = (move.pull - push) * piece.per_acceleration / (robot.mass + piece.model.tool_mass)
        move.joined = robot.mass_slope * at.v_r * (at.v_r + at.y_dot)
    else:
        move.pull = coupling_pull(piece, at.y - at.q, at.y_dot - at.q_dot)
        move.gap = (move.pull - push) * piece.tool_rate
        if piece.robot.intervals:
            flange_rate = piece.per_acceleration / robot.mass  # to divide before the pull is known is faster
            move.flange = (-robot.stiffness * at.q - robot.damping * at.q_dot - move.pull) * flange_rate - piece.push
    move.tool = move.gap - piece.push
    move.gap += piece.ground - push * piece.object_rate
    return move


cdef inline GeneralRates general_rates(
    const Piece *piece, double z, double w, double t, double y, double v, double q, double r
) noexcept nogil:
    """Return the derivative of the scaled state: in a contact by the variable s of `contact.pxi`, in flight by time."""
    cdef GeneralRates rates
    cdef ChainMotion at
    cdef double pace = 1.0 if piece.flying else z
    cdef double force = 0.0 if piece.flying else contact_force(&piece.contact, z, w)
    cdef Accelerations move
    rates.z = w if piece.flying else 0.5 * w
    rates.t = pace
    rates.p = pace * force
    if not piece.deflects:
        rates.w = pace * (piece.ground - force * piece.units.force * piece.object_rate)
        rates.y = rates.v = rates.s = rates.j = rates.q = rates.r = 0.0
        return rates
    at = chain_motion(piece, t, y, v, q, r)
    move = motion(piece, &at, force * piece.units.force)
    rates.w = pace * move.gap
    rates.y = pace * v
    rates.v = pace * move.tool
    rates.s = pace * move.pull * piece.per_force
    rates.j = pace * move.joined * piece.per_force
    rates.q = pace * r
    rates.r = pace * move.flange
    return rates


cdef struct Gradient:  # derivatives of a force (N) or of an acceleration (m/s^2)
    double y, y_dot  # with respect to the deflection (per m) and its rate (per m/s)
    double q, q_dot  # with respect to the flange offset (per m) and its rate (per m/s)
    double time  # with respect to time (per s)


cdef inline Gradient pull_gradient(const Piece *piece, const ChainMotion *at) noexcept nogil:
    """Return the derivatives of `Accelerations.pull`, N."""
    cdef double k, c
    cdef RobotSlopes slopes
    if not piece.model.coupled:
        slopes = robot_slopes(&piece.robot, piece.interval, at.x_r)
        return Gradient(
            -at.robot.stiffness, -at.robot.damping, 0.0, 0.0,
            -(slopes.stiffness * at.y + slopes.damping * at.y_dot) * at.v_r,
        )
    k, c = piece.model.stiffness, piece.model.damping
    if piece.model.stops:
        k = -spring_slope(&piece.model.mechanism, piece.model.mechanism.rest + at.y - at.q)
        c = piece.model.mechanism.damping
        if piece.pressed != FREE:
            k, c = k + piece.model.mechanism.stop_stiffness, c + piece.model.mechanism.stop_damping
    return Gradient(-k, -c, k, c, 0.0)


cdef inline Gradient flange_gradient(
    const Piece *piece, const ChainMotion *at, const Gradient *pull, double T
) noexcept nogil:
    """Return the derivatives of the flange's acceleration; `pull` has the derivatives of the coupling's force T (N)."""
    cdef const RobotNow *robot = &at.robot
    cdef RobotSlopes slopes = robot_slopes(&piece.robot, piece.interval, at.x_r)
    cdef double m = robot.mass, force = -robot.stiffness * at.q - robot.damping * at.q_dot - T
    cdef double change = -slopes.stiffness * at.q - slopes.damping * at.q_dot - force * robot.mass_slope / m
    return Gradient(
        -pull.y / m, -pull.y_dot / m, -(pull.q + robot.stiffness) / m, -(pull.q_dot + robot.damping) / m,
        change * at.v_r / m,
    )


cdef inline void gradient_row(const Piece *piece, const Gradient *part, double scale, double *row) noexcept nogil:
    """Write the columns t, y, v, q, r of a row of the Jacobian. `scale`: scaled rate of the row, per N or m/s^2."""
    row[DEFLECTION] = scale * part.y * piece.units.length
    row[DEFLECTION_RATE] = scale * part.y_dot * piece.units.velocity
    row[OFFSET] = scale * part.q * piece.units.length
    row[OFFSET_RATE] = scale * part.q_dot * piece.units.velocity
    row[TIME] = scale * part.time * piece.units.time


cdef inline void contact_rows(const Piece *piece, const double *x, double[WIDTH] *J) noexcept nogil:
    """Write those rows of a contact's Jacobian that belong to z, t and the impulse."""
    cdef double f_z, f_w, z = x[ROOT]
    f_z, f_w = contact_gradient(&piece.contact, z, x[RATE])
    J[ROOT][RATE] = 0.5
    J[TIME][ROOT] = 1.0
    J[IMPULSE][ROOT] = contact_force(&piece.contact, z, x[RATE]) + z * f_z
    J[IMPULSE][RATE] = z * f_w


cdef void general_jacobian(const Piece *piece, const double *x, double[WIDTH] *J) noexcept nogil:
    """Write the derivatives of `general_rates` into `J`, whose elements are 0."""
    cdef ChainMotion at = chain_motion(piece, x[TIME], x[DEFLECTION], x[DEFLECTION_RATE], x[OFFSET], x[OFFSET_RATE])
    cdef double z = x[ROOT], pace = 1.0 if piece.flying else z, push = 0.0, tool_rate = piece.tool_rate, f_z, f_w
    cdef Accelerations move
    cdef Gradient pull = pull_gradient(piece, &at), tool = pull, flange, joined
    cdef const RobotNow *robot = &at.robot
    if not piece.flying:
        push = contact_force(&piece.contact, z, x[RATE]) * piece.units.force
    move = motion(piece, &at, push)
    if not piece.model.coupled:
        tool_rate = piece.per_acceleration / (robot.mass + piece.model.tool_mass)
        tool.time -= (move.pull - push) * robot.mass_slope * at.v_r / (robot.mass + piece.model.tool_mass)
        joined = Gradient(
            0.0, robot.mass_slope * at.v_r, 0.0, 0.0,
            robot_slopes(&piece.robot, piece.interval, at.x_r).mass_bend * at.v_r * at.v_r * (at.v_r + at.y_dot)
            + robot.mass_slope * piece.acceleration * (2.0 * at.v_r + at.y_dot),
        )
        gradient_row(piece, &joined, pace * piece.per_force, J[JOINED])
    elif piece.robot.intervals:
        flange = flange_gradient(piece, &at, &pull, move.pull)
        gradient_row(piece, &flange, pace * piece.per_acceleration, J[OFFSET_RATE])
    gradient_row(piece, &tool, pace * tool_rate, J[RATE])
    gradient_row(piece, &tool, pace * tool_rate, J[DEFLECTION_RATE])
    gradient_row(piece, &pull, pace * piece.per_force, J[PULL_IMPULSE])
    J[DEFLECTION][DEFLECTION_RATE] = J[OFFSET][OFFSET_RATE] = pace
    if piece.flying:
        J[ROOT][RATE] = 1.0
        return
    contact_rows(piece, x, J)
    f_z, f_w = contact_gradient(&piece.contact, z, x[RATE])
    f_z, f_w = z * f_z * piece.units.force, z * f_w * piece.units.force
    J[RATE][ROOT] = move.gap - (tool_rate + piece.object_rate) * f_z
    J[RATE][RATE] = -(tool_rate + piece.object_rate) * f_w
    J[DEFLECTION][ROOT] = x[DEFLECTION_RATE]
    J[DEFLECTION_RATE][ROOT] = move.tool - tool_rate * f_z
    J[DEFLECTION_RATE][RATE] = -tool_rate * f_w
    J[PULL_IMPULSE][ROOT] = move.pull * piece.per_force
    J[JOINED][ROOT] = move.joined * piece.per_force
    J[OFFSET][ROOT] = x[OFFSET_RATE]
    J[OFFSET_RATE][ROOT] = move.flange
