"""A smooth piece of a contact or a flight: its constants, and its scaled state."""

cdef enum:
    DEFLECTION = 4, DEFLECTION_RATE = 5  # indices in the scaled state (after z, w, t, impulse): deflection and its rate
    DEFLECTION_INTEGRAL = 6  # only in an analytic piece
    PULL_IMPULSE = 6, JOINED = 7, OFFSET = 8, OFFSET_RATE = 9  # only in a general piece, see `general.pxi`

cdef int[3] WIDTHS  # numbers of components that can differ from 0 and count for the error, by kind of chain
WIDTHS[:] = [IMPULSE + 1, PULL_IMPULSE + 1, OFFSET_RATE + 1]

cdef double STANDSTILL = 1e-13  # (rounding error of the object's speed as a slip starts) / (approach + flange speed)


cdef struct Piece:
    const ChainModel *model
    int width  # of WIDTHS
    Units units
    bint analytic  # 1: m = n = 3/2 in a rigid or spring chain, see `series.pxi`; 0: a general piece, see `general.pxi`
    Polynomial polynomial  # the equations of an analytic piece
    double log_width, log_left_out  # base 2, of `width`; of the truncation error allowed, divided by ORDER + 1
    bint flying  # whether the piece is a flight; then scaled penetration replaces z, and scaled time replaces s
    const Contact *unclamped  # the contact law (see `contact.pxi`); its force f can be negative
    Contact contact  # the same law, but f = 0 while `Chain.force_active` is 0
    int first_row, end_row  # all rows that can have events are from the first to before the end, see `acts`
    bint has_friction  # whether there is friction under the object
    int object_state  # SLIDING or STUCK
    double friction  # scaled largest friction force on the object, mu m_p g
    double push  # scaled acceleration of the imposed motion; 0 in a rigid chain, where `ground` contains it
    double ground  # scaled deceleration of the object by friction, 0 if the object sticks
    double standstill  # scaled speed; a sliding object counts as at rest when it moves backwards faster than this
    double tolerance  # -, allowed local error of a step
    double threshold, reaction  # scaled `Run.threshold` and `Run.reaction`
    double horizon  # scaled duration of the piece, unless an event ends it earlier
    double position, velocity, acceleration  # m, m/s, m/s^2, of the imposed motion, at the start of the piece

    # only in a general piece
    bint deflects  # whether the tool can leave the imposed motion: not in a rigid chain
    bint yields  # whether the chain is integrated and has a compliant robot
    RobotTable robot
    int interval  # index of the interval in the robot's table that applies in this piece
    RobotNow lumped  # the robot's parameters, if its table has one interval
    double per_acceleration  # scaled value of 1 m/s^2
    double tool_rate, object_rate  # scaled acceleration by a force of 1 N, of the tool (0 in a rigid chain) and object
    double per_force  # scaled value of 1 N
    int pressed, side  # `Chain.pressed`, `Chain.side`


cdef inline bint has_series(const Run *run) noexcept nogil:
    """Return whether contacts have a Taylor series (`taylor.h`)."""
    return run.model.kind != INTEGRATED_CHAIN and is_hertz(&run.contact)


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
    piece.reaction = run.reaction / piece.units.time
    piece.horizon = (until - chain.time) / piece.units.time
    piece.push = acceleration * piece.units.time / piece.units.velocity
    piece.position, piece.velocity = chain.flange_position, chain.flange_velocity
    piece.has_friction, piece.object_state = run.ground > 0.0, <int> chain.object_state
    piece.ground = (run.ground if chain.object_state != STUCK else 0.0) * piece.units.time / piece.units.velocity
    piece.friction = run.object_mass * run.ground / piece.units.force
    piece.first_row = CLOCK if not flying else FRONT_STOP if model.stops else TOUCH
    piece.end_row = ROWS if flying else TOUCH if model.stops else FRONT_STOP if piece.has_friction else SLIP
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
