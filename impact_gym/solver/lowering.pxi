"""From what a user says of coupling and robot to the simplest chain that is the same."""

cdef double EVERYWHERE = 1e9  # m; a lumped robot is a table of one interval, so much to either side


cpdef double rest_of(
    double stiffness, double free_length, double height, double front_stop, double stop_stiffness
) noexcept nogil:
    """Position of a slider where its front stop bears the preload, m.

    The net force is concave in the depth and negative at the stroke: from there Newton's method falls onto its one
    zero and never below, until rounding ends it.
    """
    cdef Mechanism law = Mechanism(stiffness, free_length, height, 0.0, front_stop, 0.0, stop_stiffness, 0.0)
    cdef double depth = sqrt((free_length - height) * (free_length + height)) - front_stop, net, lower
    while True:
        net = bistable_force(stiffness, free_length, height, front_stop + depth) - stop_stiffness * depth
        lower = depth - net / (bistable_slope(&law, front_stop + depth) - stop_stiffness)
        if not lower < depth:
            return front_stop + depth
        depth = lower


cdef void lower(const Holder *holder, Law *law) noexcept nogil:
    """Write the chain that `holder` is."""
    cdef const RobotNumbers *robot = &holder.of_robot
    memset(law, 0, sizeof(Law))
    law.tool_mass = holder.tool_mass
    if holder.robot == STIFF_ROBOT and holder.coupling == DIRECT:
        law.kind = RIGID
    elif holder.robot == STIFF_ROBOT and holder.coupling == SPRING_DAMPER:
        law.kind, law.damping_ratio = SPRING, holder.of_coupling.damping_ratio
        law.frequency = sqrt(holder.of_coupling.stiffness / holder.tool_mass)
    elif holder.robot == LUMPED and holder.coupling == DIRECT:
        law.kind, law.tool_mass = SPRING, robot.mass + holder.tool_mass
        law.frequency = sqrt(robot.stiffness / law.tool_mass)
        law.damping_ratio = 0.5 * robot.damping / sqrt(robot.stiffness * law.tool_mass)
    else:
        law.kind = INTEGRATED
        lower_coupling(holder, law)
        lower_robot(holder, law)


cdef void lower_coupling(const Holder *holder, Law *law) noexcept nogil:
    """Write the coupling of an INTEGRATED chain."""
    cdef const CouplingNumbers *given = &holder.of_coupling
    cdef double m = holder.tool_mass
    law.coupled, law.bistable = holder.coupling != DIRECT, holder.coupling == MECHANISM
    if holder.coupling == SPRING_DAMPER:
        law.stiffness, law.damping = given.stiffness, 2.0 * given.damping_ratio * sqrt(given.stiffness * m)
    elif law.bistable:
        law.mechanism = Mechanism(
            given.stiffness, given.free_length, given.height,
            rest_of(given.stiffness, given.free_length, given.height, given.front_stop, given.stop_stiffness),
            given.front_stop, given.rear_stop, given.stop_stiffness,
            2.0 * given.stop_damping_ratio * sqrt(given.stop_stiffness * m),
        )


cdef void lower_robot(const Holder *holder, Law *law) noexcept nogil:
    """Write the robot of an INTEGRATED chain."""
    cdef const RobotNumbers *robot = &holder.of_robot
    if holder.robot == LUMPED:
        law.table, law.intervals, law.stiffest = -1, 1, robot.stiffness / robot.mass
        law.lumped.begin, law.lumped.end = -EVERYWHERE, EVERYWHERE
        law.lumped.mass[0], law.lumped.stiffness[0], law.lumped.damping[0] = robot.mass, robot.stiffness, robot.damping
    elif holder.robot == TABLE_OF_POSITION:
        law.table, law.intervals, law.stiffest = holder.table, holder.intervals, holder.stiffest
