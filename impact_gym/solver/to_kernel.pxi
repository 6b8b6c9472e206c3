"""Convert a mount (tool, coupling and robot as a user describes them) to the simplest equivalent chain (`Law`)."""

cdef double STANDARD_GRAVITY = 9.80665  # m/s^2
cdef double EVERYWHERE = 1e9  # m, half the length of the one interval in the table of a LUMPED robot


cpdef double rest_of(
    double stiffness, double free_length, double height, double front_stop, double stop_stiffness
) noexcept nogil:
    """Return the position (m) of the slider at which the front stop balances the spring."""
    cdef Mechanism law = Mechanism(stiffness, free_length, height, 0.0, front_stop, 0.0, stop_stiffness, 0.0, 0, 0.0)
    cdef double depth = sqrt((free_length - height) * (free_length + height)) - front_stop, net, lower
    while True:  # the net force is concave in `depth`, so Newton's method lowers `depth` to the only zero
        net = bistable_force(stiffness, free_length, height, front_stop + depth) - stop_stiffness * depth
        lower = depth - net / (spring_slope(&law, front_stop + depth) - stop_stiffness)
        if not lower < depth:
            return front_stop + depth
        depth = lower


cdef void law_to_kernel(const Mount *mount, Law *law) noexcept nogil:
    cdef const RobotNumbers *robot = &mount.robot
    memset(law, 0, sizeof(Law))
    law.tool_mass = mount.tool_mass
    law.coupled = 1
    law.with_tool = mount.robot_kind != STIFF_ROBOT and mount.coupling_kind == DIRECT
    if mount.robot_kind == STIFF_ROBOT and mount.coupling_kind == DIRECT:
        law.kind = RIGID
    elif mount.robot_kind == STIFF_ROBOT and mount.coupling_kind == SPRING_DAMPER and mount.coupling.stroke == 0.0:
        law.kind, law.damping_ratio = SPRING, mount.coupling.damping_ratio
        law.stiffness = mount.coupling.stiffness
        law.damping = 2.0 * law.damping_ratio * sqrt(law.stiffness * law.tool_mass)
        law.frequency = sqrt(mount.coupling.stiffness / mount.tool_mass)
    elif mount.robot_kind == LUMPED and mount.coupling_kind == DIRECT:
        law.kind, law.tool_mass = SPRING, robot.mass + mount.tool_mass
        law.stiffness, law.damping = robot.stiffness, robot.damping
        law.frequency = sqrt(robot.stiffness / law.tool_mass)
        law.damping_ratio = 0.5 * robot.damping / sqrt(robot.stiffness * law.tool_mass)
    else:
        law.kind = INTEGRATED
        coupling_to_kernel(mount, law)
        robot_to_kernel(mount, law)


cdef void coupling_to_kernel(const Mount *mount, Law *law) noexcept nogil:
    cdef const CouplingNumbers *given = &mount.coupling
    cdef double m = mount.tool_mass, stop_damping = 2.0 * given.stop_damping_ratio * sqrt(given.stop_stiffness * m)
    law.coupled, law.bistable = mount.coupling_kind != DIRECT, mount.coupling_kind == MECHANISM
    if mount.coupling_kind == SPRING_DAMPER:
        law.stiffness, law.damping = given.stiffness, 2.0 * given.damping_ratio * sqrt(given.stiffness * m)
        law.stops = given.stroke > 0.0
        law.mechanism = Mechanism(
            given.stiffness, 0.0, 0.0, 0.0, given.stroke, -given.stroke, given.stop_stiffness, stop_damping, 1, law.damping
        )
    elif law.bistable:
        law.stops = 1
        law.mechanism = Mechanism(
            given.stiffness, given.free_length, given.height,
            rest_of(given.stiffness, given.free_length, given.height, given.front_stop, given.stop_stiffness),
            given.front_stop, given.rear_stop, given.stop_stiffness, stop_damping, 0, 0.0,
        )


cdef void robot_to_kernel(const Mount *mount, Law *law) noexcept nogil:
    cdef const RobotNumbers *robot = &mount.robot
    if mount.robot_kind == LUMPED:
        law.table, law.intervals, law.stiffest = -1, 1, robot.stiffness / robot.mass
        law.lumped.begin, law.lumped.end = -EVERYWHERE, EVERYWHERE
        law.lumped.mass[0], law.lumped.stiffness[0], law.lumped.damping[0] = robot.mass, robot.stiffness, robot.damping
    elif mount.robot_kind == TABLE_OF_POSITION:
        law.table, law.intervals, law.stiffest = mount.table, mount.intervals, mount.stiffest
