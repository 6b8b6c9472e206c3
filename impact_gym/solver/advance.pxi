"""The outer loop: impose a velocity on the flange, while flights and contacts alternate."""

cdef double GRAZE = 1e-12  # m/s, least approach velocity of a contact; at 0, z and w (`contact.pxi`) would stay 0
# The flight of a spring chain fails (NOT_FINITE) if |acceleration| / frequency^2 > LOST * (|object position| + SHORT).
cdef double LOST = 1e11  # at this ratio, rounding errors are about 1e-5 of the position
cdef double SHORT = 1e-6  # m, because the object's position can be 0


cdef void reset_memory(Memory *memory, double step) noexcept nogil:
    """Reset the step control; `step` is the length of the first step to try."""
    memset(memory, 0, sizeof(Memory))
    memory.step, memory.method, memory.attempts_before_check = step, EXPLICIT, UNCHECKED


cdef double REST_SPEED = 1e-3  # m/s; a tool that can no longer exceed this speed counts as at rest
cdef double REST_STEP = 1e-3  # s, between two checks whether the tool is at rest


cdef void reset_chain(Chain *chain, const ChainModel *model, double distance, double friction) noexcept nogil:
    """Put a chain at rest, `distance` (m) before an object on ground with the coefficient `friction`."""
    memset(chain, 0, sizeof(Chain))
    chain.penetration = -distance
    chain.object_state = STUCK if friction > 0.0 else SLIDING
    chain.tool_rest_time = INFINITY
    chain.pressed = FRONT if model.bistable else FREE
    chain.side = 1
    chain.first_contact = chain.detection = INFINITY
    reset_memory(&chain.memory, FIRST_FLIGHT)


cdef void begin_contact(const Run *run, Chain *chain) noexcept nogil:
    """Begin a contact in the present state: its units, damping factor and start values."""
    cdef double mass = run.object_mass
    chain.touching = chain.force_active = 1
    chain.penetration = 0.0
    chain.penetration_rate = max(chain.penetration_rate, GRAZE)
    if run.model.kind != RIGID_CHAIN:  # the contact force accelerates the object, but not the tool of a rigid chain
        mass = parallel(moving_mass(run, chain.flange_position), mass)
    chain.units = natural_units(&run.contact, mass, chain.penetration_rate)
    chain.start = chain.time
    chain.approach_velocity = chain.penetration_rate
    chain.start_tool_velocity = tool_velocity(chain)
    chain.start_object_velocity = object_velocity(chain)
    chain.start_deflection = chain.deflection
    chain.start_flange_position = chain.flange_position
    chain.damping = damping_at(&run.contact, chain.units.velocity)
    chain.impulse = chain.ground_impulse = chain.deflection_integral = chain.pull_impulse = chain.joined = 0.0
    chain.contact_peak_force = 0.0
    reset_memory(&chain.memory, FIRST_STEP)
    chain.contacts += 1
    chain.first_contact = min(chain.first_contact, chain.time)


cdef double sensed_force(const Run *run, const Chain *chain) noexcept nogil:
    """Return the present contact force, N."""
    cdef Contact contact = run.contact
    cdef double root
    if not chain.touching or not chain.force_active:
        return 0.0
    contact.damping = chain.damping
    root = sqrt(max(chain.penetration, 0.0) / chain.units.length)
    return chain.units.force * max(contact_force(&contact, root, chain.penetration_rate / chain.units.velocity), 0.0)


cdef double take_peak(const Run *run, Chain *chain) noexcept nogil:
    """Return the largest contact force since the last call, N."""
    cdef double taken = max(chain.unread_force, sensed_force(run, chain))
    chain.unread_force = 0.0
    return taken


cdef int command(Run *run, Chain *chain, double target, double acceleration, double until) noexcept nogil:
    """Ramp the imposed velocity to `target` (m/s) and hold it. Return ARRIVED at `until` (s), or an earlier status."""
    cdef double change, ramp, end
    cdef bint ramp_ends
    cdef int status
    while chain.time < until:
        change = target - chain.flange_velocity
        ramp = copysign(acceleration, change) if change != 0.0 else 0.0
        end = chain.time + fabs(change) / acceleration
        ramp_ends = change != 0.0 and end <= until
        status = advance(run, chain, ramp, end if ramp_ends else until)
        if status != ARRIVED:
            return status
        if ramp_ends:
            round_off(run.model, chain, target)
    return ARRIVED


cdef int advance(Run *run, Chain *chain, double acceleration, double until) noexcept nogil:
    """Advance to `until` (s) under a constant acceleration (m/s^2). Return ARRIVED, or an earlier status."""
    cdef double end
    cdef int status = ARRIVED
    cdef bint undetected = isinf(chain.detection)
    while chain.time < until:
        end = smooth_until(run, chain, acceleration, until)
        if not chain.touching:
            if run.model.kind == INTEGRATED_CHAIN and status != SWITCHED:
                trace(run, chain, chain, acceleration, 0.0)
            status = fly(run, chain, acceleration, end)
        else:
            status = integrate(run, chain, acceleration, end, False)
        if status == TOUCHED:
            begin_contact(run, chain)
            trace(run, chain, chain, acceleration, 0.0)
            if run.tell_touch and chain.contacts == 1:
                return TOUCHED
        elif status == PARTED:
            close_contact(run, chain, chain.time)
            chain.touching = 0
            reset_memory(&chain.memory, FIRST_FLIGHT)
        elif status != ARRIVED and status != SWITCHED:
            return status
        if undetected and not isinf(chain.detection):
            return DETECTED
    return ARRIVED


cdef int fly(Run *run, Chain *chain, double acceleration, double until) noexcept nogil:
    """Advance a flight to the first event, the object's rest or `until` (s); return the status."""
    cdef double rest = INFINITY
    cdef int status
    if ground_now(run, chain) > 0.0:
        rest = chain.time + max(object_velocity(chain), 0.0) / run.ground
    status = fly_on(run, chain, acceleration, min(rest, until))
    if status == ARRIVED and chain.time >= rest:
        come_to_rest(chain)
    return status


cdef int fly_on(Run *run, Chain *chain, double acceleration, double until) noexcept nogil:
    """Advance a flight, during which the object neither starts nor stops, to the first event or to `until` (s)."""
    cdef double distance, touch, left = until - chain.time
    if run.model.kind == INTEGRATED_CHAIN:
        return integrate(run, chain, acceleration, until, True)
    if run.model.kind != RIGID_CHAIN:
        distance = fabs(tool_position(chain) - chain.penetration) + SHORT
        if fabs(acceleration) > LOST * distance * run.model.frequency * run.model.frequency:
            return NOT_FINITE
    touch = touch_time(run, chain, acceleration, left)
    if isnan(touch):
        return STEP_LIMIT
    trace_flight(run, chain, acceleration, min(touch, left))
    drift(run, chain, acceleration, min(touch, left))
    if touch <= left:
        return TOUCHED
    if not isfinite(chain.penetration_rate + chain.deflection_rate):
        return NOT_FINITE
    chain.time = until
    trace(run, chain, chain, acceleration, 0.0)
    return ARRIVED


cdef double reach_at_rest(const Run *run, const Chain *chain) noexcept nogil:
    """If the tool counts as at rest, return an estimate of its largest future displacement (m), else inf."""
    cdef const ChainModel *model = run.model
    cdef RobotTable table
    cdef RobotNow robot
    cdef Accelerations move
    cdef double k, mass = model.tool_mass, push = sensed_force(run, chain)
    if chain.flange_velocity != 0.0 or (chain.touching and chain.object_state != STUCK):
        return INFINITY
    if model.kind == RIGID_CHAIN:
        return 0.0
    move, k = motion_now(run, chain, 0.0, push), model.stiffness
    if model.intervals:
        table = robot_table(run)
        robot = robot_at(&table, chain.flange_position)
        if not model.coupled:
            k, mass = robot.stiffness, mass + robot.mass
        elif hypot(chain.flange_offset_rate, move.flange * sqrt(robot.mass / robot.stiffness)) > REST_SPEED:
            return INFINITY
    if model.stops:
        k = fabs(spring_slope(&model.mechanism, model.mechanism.rest + chain.deflection - chain.flange_offset))
        k += model.mechanism.stop_stiffness if chain.pressed != FREE else 0.0
    return slow_swing(chain.deflection_rate, move.tool, sqrt(k / mass) if k > 0.0 else model.damping / mass)


cdef inline double slow_swing(double velocity, double acceleration, double frequency) noexcept nogil:
    """Return a bound (m) on the travel of an oscillation at `frequency` (rad/s) or above; inf: above REST_SPEED."""
    cdef double fastest = hypot(velocity, acceleration / frequency)
    return 2.0 * fastest / frequency if fastest <= REST_SPEED else INFINITY


cdef void note_tool_rest(const Run *run, Chain *chain) noexcept nogil:
    """With friction, set `tool_rest_time`, the time (s) from which the tool counts as at rest; inf: not at rest."""
    cdef bint rests = run.ground > 0.0 and reach_at_rest(run, chain) < INFINITY
    chain.tool_rest_time = min(chain.tool_rest_time, chain.time) if rests else INFINITY


cdef void record_rest(const Run *run, Chain *chain, double distance) noexcept nogil:
    """With friction, store `slide` and `rest_time`, as if no contact followed. The object began at `distance` (m)."""
    cdef double rest, speed = max(object_velocity(chain), 0.0)
    if run.ground == 0.0:
        return
    if chain.peak_object_velocity > 0.0:
        chain.slide = tool_position(chain) - chain.penetration - distance
        chain.slide += 0.5 * speed * speed / run.ground
    rest = chain.object_rest_time if chain.object_state == STUCK else chain.time + speed / run.ground
    chain.rest_time = max(chain.tool_rest_time, rest)


cdef struct RunPlan:  # scene and motion of an approach
    Mount mount
    Contact contact
    double object_mass  # kg
    double distance  # m, from tool to object at t = 0
    double friction  # -, mu
    double speed  # m/s, at the end of the ramp, relative to `frame`
    double acceleration  # m/s^2, of the ramp
    double threshold  # N, contact force that triggers the brake; inf: no brake
    double delay  # s, from the first force above `threshold` to the start of the brake
    double deceleration  # m/s^2, of the brake
    int64_t motion, points  # of a `Motion`: index of its first time in `Run.tables`, number of times
    double duration  # s, of the approach
    double frame  # m/s, common velocity of flange, tool and object at t = 0; 0 except in tests


cdef void run_approach(Run *run, Chain *chain, const RunPlan *plan) noexcept nogil:
    """Run an approach: a `Motion`, or a ramp to a speed and perhaps a brake. Record an unfinished contact, too."""
    cdef const double *times = run.tables + plan.motion
    cdef const double *velocities = times + plan.points
    cdef double speed = plan.speed, acceleration = plan.acceleration, brake_at = INFINITY
    cdef int status = ARRIVED
    cdef int64_t k = 0
    cdef double until
    reset_chain(chain, run.model, plan.distance, plan.friction)
    chain.flange_velocity = plan.frame
    while chain.time < plan.duration:
        until = min(brake_at, plan.duration)
        while k < plan.points and times[k] <= chain.time:
            k += 1
        if k < plan.points:
            speed, acceleration = velocities[k], fabs(velocities[k] - velocities[k - 1]) / (times[k] - times[k - 1])
            until = min(until, times[k])
        if run.ground > 0.0 and speed == 0.0 and isinf(chain.tool_rest_time):
            until = min(until, chain.time + REST_STEP)
        status = command(run, chain, plan.frame + speed, acceleration, until)
        if status == DETECTED:
            brake_at = chain.detection + plan.delay
        elif status != ARRIVED:
            break
        if chain.time >= brake_at:
            speed, acceleration, brake_at = 0.0, plan.deceleration, INFINITY
        status = ARRIVED
        note_tool_rest(run, chain)
    record_rest(run, chain, plan.distance)
    if chain.touching:
        close_contact(run, chain, NAN)
    chain.status = status
    chain.final_object_velocity, chain.final_tool_velocity = object_velocity(chain), tool_velocity(chain)
    chain.final_flange_velocity = flange_velocity(run.model, chain)
    if run.ground == 0.0:
        chain.peak_object_velocity, chain.slide, chain.rest_time = chain.final_object_velocity, NAN, NAN


cpdef double separation_velocity(double damping, double stiffness_exponent, double damping_exponent) noexcept:
    """Integrate an isolated contact u'' = -max(u^m + d u^n u', 0); return separation velocity / approach velocity."""
    cdef ChainModel model
    cdef Work work
    cdef Run run
    cdef Chain chain
    memset(&model, 0, sizeof(model))
    memset(&run, 0, sizeof(run))
    model.kind, model.coupled = RIGID_CHAIN, 1
    run.model, run.work = &model, &work
    run.contact = contact_of(1.0, damping, stiffness_exponent, damping_exponent, 0.0)
    run.object_mass, run.threshold, run.tolerance, run.max_steps = 1.0, INFINITY, 1e-13, 1000000
    reset_chain(&chain, &model, 0.0, 0.0)
    chain.flange_velocity = chain.penetration_rate = 1.0
    begin_contact(&run, &chain)
    while integrate(&run, &chain, 0.0, 1e300, False) == SWITCHED:
        pass
    return -chain.penetration_rate
