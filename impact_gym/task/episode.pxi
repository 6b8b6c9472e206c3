"""One episode, one row: how it begins, what a control step does, how it ends. Every front end runs these kernels."""

cpdef enum:
    LINEAR, LOGARITHM, LOGARITHM_OF_ONE_MORE  # curves of an observation's entry

cdef double ROUNDING = 1e-9  # s, spans shorter than this are rounding of the clock


cdef struct Row:  # everything of one environment
    const Task *task
    Chain *chain
    Episode *episode
    Reading *readings  # a ring of so many slots
    int64_t slots
    const Entry *entries  # of the observation
    int64_t length
    float *observation
    Link *link  # with an operator
    Packet *packets  # a ring of so many slots
    int64_t packet_slots
    const double *tables


cpdef int64_t samples_under_way(double reaction_delay, double control_period) noexcept nogil:
    """Readings between sensor and controller at t = 0."""
    return <int64_t> floor(reaction_delay / control_period + 1e-9)


cdef void begin_episode(Row *row, const Law *law, Record drawn) noexcept nogil:
    """Put everything at rest at t = 0."""
    cdef Episode *episode = row.episode
    cdef double period = row.task.control_period, delay = drawn.reaction_delay
    cdef int64_t k
    memset(episode, 0, sizeof(Episode))
    memset(row.readings, 0, row.slots * sizeof(Reading))
    episode.drawn = drawn
    episode.damping = exact_damping(drawn.restitution) if row.task.exact else hu_guo(drawn.restitution)
    episode.alarm = INFINITY
    episode.pushed = samples_under_way(delay, period)
    for k in range(episode.pushed):
        row.readings[k].time = (k + 1) * period - delay
    episode.next_sample = (episode.pushed + 1) * period - delay
    episode.approach_time = row.task.horizon
    episode.slide = episode.rest_time = INFINITY
    reset_chain(row.chain, law, drawn.distance, drawn.friction)
    if row.task.operator_kind:
        begin_link(row)
        process_events(row)
    observe(row)


cpdef double decode(double action, double low, double high, double resolution) noexcept nogil:
    """Return the physical command of an action, clipped to [-1, 1], on a grid."""
    cdef double value = low + 0.5 * (min(1.0, max(-1.0, action)) + 1.0) * (high - low)
    return rint(value / resolution) * resolution


cdef double snap(double time, double onto) noexcept nogil:
    """The earlier of `time` and `onto`; `onto` too if only rounding would lie between them."""
    return onto if time > onto - ROUNDING else time


cdef void sample(const Run *run, Row *row) noexcept nogil:
    """Read the sensors now; the controller gets the reading `reaction_delay` later.

    There is a reading one delay before each observation that may come, at times known a delay ahead, because the alarm,
    which shifts the clock, comes a delay after its cause. Each carries its time: an observation gets the last one that
    is due, and one for an observation that did not come (at the horizon, with an alarm under way) is passed over.
    An alarm by the readings comes with an observation and shifts nothing.
    """
    cdef Chain *chain = row.chain
    cdef Episode *episode = row.episode
    cdef bint shifted = not isinf(chain.detection) and not row.task.alarm_by_reading
    cdef double delay = episode.drawn.reaction_delay, period = row.task.control_period, last, following
    cdef double force = take_peak(run, chain) if row.task.alarm_by_reading else sensed_force(run, chain)
    row.readings[episode.pushed % row.slots] = Reading(
        chain.time, force, chain.peak_force, chain.deflection - chain.flange_offset
    )
    episode.pushed += 1
    if isinf(chain.detection) or row.task.operator_kind:
        last = row.task.horizon - delay
    else:
        last = chain.detection + row.task.after_alarm
    if not shifted:
        following = (floor((chain.time + delay + ROUNDING) / period) + 1.0) * period - delay
        # the end is an observation of its own
        if chain.time < last - ROUNDING and last < following - ROUNDING:
            following = last
        episode.next_sample = following
    else:
        following = snap(max(episode.next_sample, chain.detection) + period, last)
        episode.next_sample = following if chain.time < last else INFINITY


cdef void receive(Row *row) noexcept nogil:
    """Let the oldest reading under way reach the controller, with the sensor's errors; forces never fall below zero.

    One above the threshold raises an alarm by the readings, if none is on.
    """
    cdef Episode *episode = row.episode
    cdef Sensors *sensors = &episode.sensors
    cdef const Reading *reading = &row.readings[episode.popped % row.slots]
    cdef double error = episode.drawn.force_error, seed = episode.drawn.noise_seed
    cdef double noise = episode.drawn.force_noise
    cdef double[2] uniform
    if noise > 0.0:
        uniform[0], uniform[1] = hashed(seed, 2 * episode.popped), hashed(seed, 2 * episode.popped + 1)
        error += noise * normal(uniform)
    sensors.force_3, sensors.force_2, sensors.force_1 = sensors.force_2, sensors.force_1, sensors.force
    sensors.deflection_3, sensors.deflection_2 = sensors.deflection_2, sensors.deflection_1
    sensors.deflection_1 = sensors.deflection
    sensors.force = max(reading.force + error, 0.0)
    if row.task.alarm_by_reading:
        sensors.force_peak = max(sensors.force_peak, sensors.force)
        if sensors.force > episode.drawn.alarm_threshold:
            episode.alarm = min(episode.alarm, row.chain.time)
    else:
        sensors.force_peak = max(sensors.force_peak, reading.peak + error)
    sensors.deflection = reading.deflection
    episode.popped += 1


cdef void observe(Row *row) noexcept nogil:
    """Write what the controller sees at the present time."""
    cdef Chain *chain = row.chain
    cdef const Record *drawn = &row.episode.drawn
    cdef Sensors *sensors = &row.episode.sensors
    cdef const double *values = <const double *> row.episode
    cdef const Entry *entry
    cdef double value
    cdef int64_t k
    sensors.position, sensors.velocity, sensors.time = chain.flange_position, chain.flange_velocity, chain.time
    sensors.alarm = chain.time >= row.episode.alarm
    sensors.time_since_alarm = chain.time - row.episode.alarm if sensors.alarm else 0.0
    sensors.distance_estimate = drawn.distance_estimate - chain.flange_position
    sensors.distance = drawn.distance - chain.flange_position
    if row.task.operator_kind:
        observe_link(row)
    sensors.time_since_touch = max(chain.time - chain.detection - drawn.reaction_delay, 0.0)
    for k in range(row.length):
        entry = &row.entries[k]
        value = values[entry.place]
        if entry.curve == LOGARITHM:
            if row.episode.control_steps > 0:
                continue  # what is shown so stays as it is
            value = log(value)
        elif entry.curve == LOGARITHM_OF_ONE_MORE and value != 0.0:
            value = log1p(value)
        value = entry.scaled_low + entry.gain * (value - entry.low)
        row.observation[k] = <float> min(1.0, max(entry.scaled_low, value))


cdef inline double end_with(const Row *row, double detection) noexcept nogil:
    """End of an episode whose contact force exceeded the threshold at some time, s; with an operator it goes on."""
    if isinf(detection) or row.task.operator_kind:
        return row.task.horizon
    return detection + row.episode.drawn.reaction_delay + row.task.after_alarm


cdef double play_step(Run *run, Row *row, const double *action) noexcept nogil:
    """Play one control step: command, advance, sense, and at the end settle. Returns the reward.

    The action has a velocity and an acceleration, with an operator a gain, an acceleration and a withdrawal.
    """
    cdef const Task *task = row.task
    cdef Chain *chain = row.chain
    cdef Episode *episode = row.episode
    cdef Command asked
    cdef double begun = chain.time, alarm, until, time_cost
    asked.velocity = decode(action[0], task.velocity.low, task.velocity.high, task.command_resolution)
    asked.acceleration = decode(action[1], task.acceleration.low, task.acceleration.high, task.command_resolution)
    if task.operator_kind:
        assist(row, action[0], asked.acceleration, action[2])
    alarm = drive(run, row, asked)
    if task.alarm_by_reading:
        if chain.time >= episode.alarm + task.after_alarm - ROUNDING:
            episode.alarm = INFINITY
    elif isinf(episode.alarm) and chain.time >= alarm:
        episode.alarm = alarm
    until = chain.time - episode.drawn.reaction_delay + ROUNDING
    while episode.popped < episode.pushed and row.readings[episode.popped % row.slots].time <= until:
        receive(row)
    episode.control_steps += 1
    observe(row)
    episode.approach_time = min(chain.first_contact, task.horizon)
    episode.object_velocity = kept_velocity(run, chain)
    episode.terminated = episode.status < 0 or chain.time >= end_with(row, chain.detection)
    if task.operator_kind:
        episode.terminated = episode.terminated or task_done(row)
        episode.done_time = chain.time
        time_cost = episode.drawn.time_weight * (chain.time - begun)
    else:
        time_cost = episode.drawn.time_weight * (min(chain.time, chain.first_contact) - min(begun, chain.first_contact))
    episode.time_cost += time_cost
    episode.truncated = task.max_steps > 0 and episode.control_steps >= task.max_steps
    if episode.terminated:
        finish(run, row)
    return -time_cost - episode.missed_cost - episode.velocity_cost - episode.force_cost


cdef double drive(Run *run, Row *row, Command asked) noexcept nogil:
    """Follow a command to the end of the control step, reading the sensors on the way; return the time of the alarm, s.

    With an operator the command is what the link makes of the action, at every moment at which that changes.
    """
    cdef Chain *chain = row.chain
    cdef Episode *episode = row.episode
    cdef bint linked = row.task.operator_kind != NO_OPERATOR
    cdef double period_end = chain.time + row.task.control_period, alarm = chain.detection + episode.drawn.reaction_delay
    cdef bint shifts = not row.task.alarm_by_reading
    cdef double until, end, begun, late = 0.0 if shifts else ROUNDING
    cdef int status
    if shifts and isinf(episode.alarm) and not isinf(alarm):
        end = snap(period_end, alarm)
    else:
        end = snap(period_end, end_with(row, chain.detection))
    while chain.time < end:
        until = min(end, max(episode.next_sample, chain.time))
        if linked:
            process_events(row)
            asked = flange_command(row)
            until = snap(min(until, max(next_event(row), chain.time)), end)  # else what comes at the end had no time
        begun = chain.time
        status = command(run, chain, asked.velocity, asked.acceleration, until) if until > chain.time else ARRIVED
        if linked and chain.contacts == 0 or status == TOUCHED:
            add_to_withheld_share(row, chain.time - begun)
        if status < 0:
            episode.status = status
            if not begun <= chain.time <= until:  # nan or worse
                chain.time = until
            break
        if status == TOUCHED:
            send_display(row)
        if status == DETECTED:
            alarm = chain.detection + episode.drawn.reaction_delay
            if shifts:
                end = snap(period_end, alarm)
                episode.next_sample = chain.time
            else:
                end = snap(period_end, end_with(row, chain.detection))
        if chain.time >= episode.next_sample - late:
            sample(run, row)
    if linked:
        process_events(row)
    return alarm
