"""What the equations of motion read during one smooth piece of a contact or of a flight, and what every chain shares."""

cdef enum:
    DEFLECTION = 4, DEFLECTION_RATE = 5  # places of the scaled state behind z, w, t and the impulse: y and y'
    DEFLECTION_INTEGRAL = 6  # of a SPRING chain
    PULL_IMPULSE = 6, JOINED = 7, OFFSET = 8, OFFSET_RATE = 9  # of an INTEGRATED chain, see its module

cdef double STANDSTILL = 1e-13  # of the velocities at hand: an object that slips begins with the rounding of a difference


cdef struct Piece:
    const Law *law
    int width  # places of the scaled state
    Units units
    bint analytic  # polynomial in z, w, y and v: then its steps are those of its Taylor series
    bint flying  # then the first place is the penetration over the unit of length, and s is time
    const Contact *grip  # the law of the contact as it is
    Contact contact  # and as it acts: no force where the surfaces do not hold
    bint rough  # there is friction under the object
    int footing  # of the object
    double friction  # mu m_p g over F0
    double ground  # scaled deceleration of the object by its friction as it slides
    double standstill  # scaled speed backwards at which an object that slid has come to rest
    double share  # of the relative acceleration that the contact force would give without friction
    double tolerance  # -, local error of a step
    double threshold  # alarm threshold over F0
    double horizon  # time left
    double position, velocity, acceleration  # m, m/s, m/s^2, of the imposed motion; the first two where the piece starts

    # of the linear chains, in the piece's units
    double push  # flange acceleration
    double pull_y, pull_y_dot  # force of the spring and damper on the tool over its mass, per deflection and its rate
    double tool_share  # reduced mass over tool mass

    # of an INTEGRATED chain
    RobotTable robot
    int place  # interval of that table
    RobotNow lumped  # what it says everywhere, if it has but one
    double per_acceleration  # scaled acceleration for 1 m/s^2
    double tool_rate, object_rate  # likewise of tool and object for 1 N
    double per_force  # 1 / N
    int pressed, side  # of the slider


cdef void store_common(const Piece *now, const Chain *base, const double *x, Chain *chain) noexcept nogil:
    """Write the places of `x` that every chain has into `chain`; `base` is where the piece started."""
    cdef double elapsed = x[TIME] * now.units.time
    chain.time = base.time + elapsed
    chain.flange_position = base.flange_position + elapsed * (base.flange_velocity + 0.5 * now.acceleration * elapsed)
    chain.flange_velocity = base.flange_velocity + now.acceleration * elapsed
    chain.penetration_rate = x[RATE] * now.units.velocity
    if now.flying:
        chain.penetration = x[ROOT] * now.units.length
    else:
        chain.penetration = x[ROOT] * x[ROOT] * now.units.length
        chain.impulse = base.impulse + x[IMPULSE] * now.units.force * now.units.time


cdef inline double object_velocity(const Chain *chain) noexcept nogil:
    """Velocity of the object, m/s; it rests until it is touched, and where it sticks, whatever rounding says."""
    if chain.contacts == 0 or chain.footing == STUCK:
        return 0.0
    return chain.flange_velocity + chain.deflection_rate - chain.penetration_rate


cdef inline double tool_velocity(const Chain *chain) noexcept nogil:
    """Velocity of the tool, m/s."""
    return chain.flange_velocity + chain.deflection_rate


cdef inline double parallel(double first, double second) noexcept nogil:
    """Mass of the relative motion of two, kg."""
    return first * second / (first + second)
