"""Convert a mount (tool, coupling and robot as a user describes them) to a `ChainModel`, the simplest equivalent."""

cdef double STANDARD_GRAVITY = 9.80665  # m/s^2
cdef double EVERYWHERE = 1e9  # m, half the length of the one interval in the table of a ROBOT


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


cdef void pack_model(const Mount *mount, ChainModel *model) noexcept nogil:
    """Write the simplest chain that is equivalent to `mount` into `model`."""
    cdef const RobotNumbers *robot = &mount.robot
    memset(model, 0, sizeof(ChainModel))
    model.tool_mass = mount.tool_mass
    model.coupled = 1
    model.with_tool = mount.robot_kind != RIGID_ROBOT and mount.coupling_kind == RIGID
    if mount.robot_kind == RIGID_ROBOT and mount.coupling_kind == RIGID:
        model.kind = RIGID_CHAIN
    elif mount.robot_kind == RIGID_ROBOT and mount.coupling_kind == SPRING_DAMPER and mount.coupling.stroke == 0.0:
        model.kind, model.damping_ratio = SPRING_CHAIN, mount.coupling.damping_ratio
        model.stiffness = mount.coupling.stiffness
        model.damping = 2.0 * model.damping_ratio * sqrt(model.stiffness * model.tool_mass)
        model.frequency = sqrt(mount.coupling.stiffness / mount.tool_mass)
    elif mount.robot_kind == ROBOT and mount.coupling_kind == RIGID:
        model.kind, model.tool_mass = SPRING_CHAIN, robot.mass + mount.tool_mass
        model.stiffness, model.damping = robot.stiffness, robot.damping
        model.frequency = sqrt(robot.stiffness / model.tool_mass)
        model.damping_ratio = 0.5 * robot.damping / sqrt(robot.stiffness * model.tool_mass)
    else:
        model.kind = INTEGRATED_CHAIN
        pack_coupling(mount, model)
        pack_robot(mount, model)


cdef void pack_coupling(const Mount *mount, ChainModel *model) noexcept nogil:
    """Set the coupling of an integrated chain."""
    cdef const CouplingNumbers *given = &mount.coupling
    cdef double m = mount.tool_mass, stop_damping = 2.0 * given.stop_damping_ratio * sqrt(given.stop_stiffness * m)
    model.coupled, model.bistable = mount.coupling_kind != RIGID, mount.coupling_kind == BISTABLE
    if mount.coupling_kind == SPRING_DAMPER:
        model.stiffness, model.damping = given.stiffness, 2.0 * given.damping_ratio * sqrt(given.stiffness * m)
        model.stops = given.stroke > 0.0
        model.mechanism = Mechanism(
            given.stiffness, 0.0, 0.0, 0.0, given.stroke, -given.stroke, given.stop_stiffness, stop_damping,
            1, model.damping,
        )
    elif model.bistable:
        model.stops = 1
        model.mechanism = Mechanism(
            given.stiffness, given.free_length, given.height,
            rest_of(given.stiffness, given.free_length, given.height, given.front_stop, given.stop_stiffness),
            given.front_stop, given.rear_stop, given.stop_stiffness, stop_damping, 0, 0.0,
        )


cdef void pack_robot(const Mount *mount, ChainModel *model) noexcept nogil:
    """Set the robot's table in an integrated chain."""
    cdef const RobotNumbers *robot = &mount.robot
    if mount.robot_kind == ROBOT:
        model.table, model.intervals, model.stiffest = -1, 1, robot.stiffness / robot.mass
        model.lumped.begin, model.lumped.end = -EVERYWHERE, EVERYWHERE
        model.lumped.mass[0], model.lumped.stiffness[0] = robot.mass, robot.stiffness
        model.lumped.damping[0] = robot.damping
    elif mount.robot_kind == ROBOT_TABLE:
        model.table, model.intervals, model.stiffest = mount.table, mount.intervals, mount.stiffest
