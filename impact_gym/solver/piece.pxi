"""The constants of one smooth piece of a contact or a flight, and functions that are the same for all chains."""

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
    bint flying  # whether the piece is a flight; then scaled penetration replaces z, and scaled time replaces s
    const Contact *unclamped  # the contact model (see `contact.pxi`); its force f can be negative
    Contact contact  # the same model, but f = 0 while `Chain.force_active` is 0
    bint has_friction  # whether there is friction under the object
    int object_state  # SLIDING or STUCK
    double friction  # scaled largest friction force on the object, mu m_p g
    double push  # scaled acceleration of the imposed motion; 0 in a rigid chain, where `ground` contains it
    double ground  # scaled deceleration of the object by friction, 0 if the object sticks
    double standstill  # scaled speed; a sliding object counts as at rest when it moves backwards faster than this
    double tolerance  # -, allowed local error of a step
    double threshold  # scaled force threshold, `Run.threshold` / `units.force`
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
