"""The constants of one smooth piece of a contact or a flight, and functions that are the same for all chains."""

cdef enum:
    DEFLECTION = 4, DEFLECTION_RATE = 5  # indices in the scaled state (after z, w, t, impulse): deflection and its rate
    DEFLECTION_INTEGRAL = 6  # only in a SPRING chain
    PULL_IMPULSE = 6, JOINED = 7, OFFSET = 8, OFFSET_RATE = 9  # only in an INTEGRATED chain, see `integrated.pxi`

cdef double STANDSTILL = 1e-13  # (rounding error of the object's speed as a slip starts) / (approach + flange speed)


cdef struct Piece:
    const Law *law
    int width  # number of components of the scaled state
    Units units
    bint analytic  # whether steps can use Taylor series (`taylor.h`): m = n = 3/2 in a RIGID or SPRING chain
    bint flying  # whether the piece is a flight; then scaled penetration replaces z, and scaled time replaces s
    const Contact *grip  # the contact law (see `contact.pxi`); its force f can be negative
    Contact contact  # the same law, but f = 0 while `Chain.holding` is 0
    bint rough  # whether there is friction under the object
    int object_state  # SLIDING or STUCK
    double friction  # scaled largest friction force on the object, mu m_p g
    double ground  # scaled deceleration of the object by friction; 0 if the object sticks
    double standstill  # scaled speed; a sliding object counts as at rest when it moves backwards faster than this
    double share  # scaled deceleration of the tool relative to the object, per unit of f; 1 if the object slides
    double tolerance  # -, allowed local error of a step
    double threshold  # scaled force threshold, `Run.threshold` / `units.force`
    double horizon  # scaled duration of the piece, unless an event ends it earlier
    double position, velocity, acceleration  # m, m/s, m/s^2, of the imposed motion, at the start of the piece

    # scaled with `units`; the last three numbers are set only in a SPRING chain
    double push  # acceleration of the imposed motion
    double pull_y, pull_y_dot  # acceleration of the tool per deflection (spring), per deflection rate (damper)
    double tool_share  # ratio of the reduced mass of tool and object to the tool mass

    # only in an INTEGRATED chain
    RobotTable robot
    int place  # index of the interval in the robot's table that applies in this piece
    RobotNow lumped  # the robot's parameters, if its table has one interval
    double per_acceleration  # scaled value of 1 m/s^2
    double tool_rate, object_rate  # scaled acceleration of tool, and of object, by a force of 1 N
    double per_force  # scaled value of 1 N
    int pressed, side  # `Chain.pressed`, `Chain.side`


cdef void store_common(const Piece *now, const Chain *base, const double *x, Chain *chain) noexcept nogil:
    """Write into `chain` the components of `x` that all chains have; `base` is the chain at the start of the piece."""
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
    """Return the velocity of the object, m/s; exactly 0 before the first contact and while the object sticks."""
    if chain.contacts == 0 or chain.object_state == STUCK:
        return 0.0
    return tool_velocity(chain) - chain.penetration_rate


cdef inline double tool_velocity(const Chain *chain) noexcept nogil:
    return chain.flange_velocity + chain.deflection_rate


cdef inline double tool_position(const Chain *chain) noexcept nogil:
    return chain.flange_position + chain.deflection


cdef inline double flange_velocity(const Law *law, const Chain *chain) noexcept nogil:
    """Return the true velocity of the flange, m/s; `chain.flange_velocity` is the imposed one."""
    return tool_velocity(chain) if law.with_tool else chain.flange_velocity + chain.flange_offset_rate


cdef inline double flange_position(const Law *law, const Chain *chain) noexcept nogil:
    """Return the true position of the flange, m; `chain.flange_position` is the imposed one."""
    return tool_position(chain) if law.with_tool else chain.flange_position + chain.flange_offset


cdef inline double parallel(double first, double second) noexcept nogil:
    """Return the reduced mass of two bodies, kg."""
    return first * second / (first + second)
