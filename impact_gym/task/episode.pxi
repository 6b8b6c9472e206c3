"""Play the episode of a row, one environment of a batch."""


cpdef int64_t readings_in_transit(double reaction_delay, double control_period) noexcept nogil:
    """Return how many readings are under way to the controller at a time."""
    return <int64_t> floor(reaction_delay / control_period + 1e-9)


cdef void begin_episode(Row *row, const ChainModel *model, Record drawn) noexcept nogil:
    """Reset a row with the numbers `drawn`, and write the first observation."""
    cdef Episode *episode = row.episode
    cdef double period = row.task.control_period, delay = drawn.reaction_delay, damping
    cdef int64_t k
    memset(episode, 0, sizeof(Episode))
    memset(row.readings, 0, row.slots * sizeof(Reading))
    episode.drawn = drawn
    damping = exact_damping(drawn.restitution) if row.task.exact else hu_guo(drawn.restitution)
    episode.contact = contact_of(drawn.contact_stiffness, damping, 1.5, 1.5, row.task.reference_velocity)
    episode.alarm = episode.last_alarm = INFINITY
    episode.readings_taken = readings_in_transit(delay, period)
    for k in range(episode.readings_taken):
        row.readings[k].time = (k + 1) * period - delay
    episode.next_sample = (episode.readings_taken + 1) * period - delay
    episode.approach_time = row.task.horizon
    episode.slide = episode.rest_time = INFINITY
    reset_chain(row.chain, model, drawn.distance, drawn.friction)
    if row.task.range_sensor:
        begin_range(row)
    if row.task.operator_kind:
        begin_link(row)
        process_events(row)
    observe(row)


cdef double snap(double time, double onto) noexcept nogil:
    """Return the earlier of `time` and `onto`; if they differ only by rounding, return `onto`."""
    return onto if time > onto - ROUNDING else time


cdef void sample(const Run *run, Row *row) noexcept nogil:
    """Read the sensors; the reading reaches the controller `reaction_delay` later."""
    cdef Chain *chain = row.chain
    cdef Episode *episode = row.episode
    cdef bint shifted = not isinf(chain.detection) and not row.task.alarm_by_reading
    cdef double delay = episode.drawn.reaction_delay, period = row.task.control_period, last, following
    cdef double force = take_peak(run, chain) if row.task.alarm_by_reading else sensed_force(run, chain)
    row.readings[episode.readings_taken % row.slots] = Reading(
        chain.time, force, chain.peak_force, chain.deflection - chain.flange_offset
    )
    episode.readings_taken += 1
    # Each reading is taken one `reaction_delay` before the observation that shows it. The alarm of a force switch
    # shifts the control steps; the observation at this alarm shows a reading from the time of detection.
    if isinf(chain.detection) or row.task.operator_kind:
        last = row.task.horizon - delay
    else:
        last = chain.detection + row.task.after_alarm
    if not shifted:
        following = (floor((chain.time + delay + ROUNDING) / period) + 1.0) * period - delay
        if chain.time < last - ROUNDING and last < following - ROUNDING:  # the next reading is for the last observation
            following = last
        episode.next_sample = following
    else:
        following = snap(max(episode.next_sample, chain.detection) + period, last)
        episode.next_sample = following if chain.time < last else INFINITY


cdef void receive(Row *row) noexcept nogil:
    """Deliver the oldest reading in transit, with force errors; with `alarm="reading"` it can raise the alarm."""
    cdef Episode *episode = row.episode
    cdef Sensors *sensors = &episode.sensors
    cdef const Reading *reading = &row.readings[episode.readings_delivered % row.slots]
    cdef double error = episode.drawn.force_error, seed = episode.drawn.noise_seed
    cdef double noise = episode.drawn.force_noise
    cdef int64_t number = 2 * episode.readings_delivered
    cdef double[2] uniform
    if noise > 0.0:
        uniform[0], uniform[1] = hashed(seed, number), hashed(seed, number + 1)
        error += noise * normal(uniform)
    sensors.force_3, sensors.force_2, sensors.force_1 = sensors.force_2, sensors.force_1, sensors.force
    sensors.deflection_3, sensors.deflection_2 = sensors.deflection_2, sensors.deflection_1
    sensors.deflection_1 = sensors.deflection
    sensors.force = max(reading.force + error, 0.0)
    if row.task.alarm_by_reading:
        sensors.force_peak = max(sensors.force_peak, sensors.force)
        if sensors.force > episode.drawn.alarm_threshold:
            raise_alarm(episode, row.chain.time)
    else:
        sensors.force_peak = max(sensors.force_peak, reading.peak + error)
    sensors.deflection = reading.deflection
    episode.readings_delivered += 1


cdef double play_step(Run *run, Row *row, const double *action) noexcept nogil:
    """Play a control step; if the episode terminates, simulate what follows (`finish`). Return the reward, m/s."""
    cdef const Task *task = row.task
    cdef Chain *chain = row.chain
    cdef Episode *episode = row.episode
    cdef const Record *drawn = &episode.drawn
    cdef double[3] asked
    cdef Terms step = Terms(0.0, 0.0, 0.0, 0.0)
    cdef double begun = chain.time, until
    cdef int64_t k
    run.contact, run.object_mass, run.threshold = episode.contact, drawn.object_mass, drawn.alarm_threshold
    run.ground, run.tolerance = STANDARD_GRAVITY * drawn.friction, task.tolerance
    run.tell_touch = task.operator_kind != NO_OPERATOR
    for k in range(task.action_size):
        asked[k] = decoded(&task.actions[k], action[k])
    if task.operator_kind:
        assist(row, asked[0], asked[1], asked[2])
    drive(run, row, Command(asked[0], asked[1]))
    update_alarm(row)
    until = chain.time - drawn.reaction_delay + ROUNDING
    while episode.readings_delivered < episode.readings_taken:
        if not row.readings[episode.readings_delivered % row.slots].time <= until:
            break
        receive(row)
    episode.control_steps += 1
    episode.done_time = chain.time
    observe(row)
    episode.approach_time = min(chain.first_contact, task.horizon)
    episode.object_velocity = v_p(run, chain)
    episode.terminated = episode.status < 0 or chain.time >= end_time(row, chain.detection)
    if task.operator_kind:
        episode.terminated = episode.terminated or task_done(row)
    step.time = charged_time(chain, begun, task.operator_kind != NO_OPERATOR)
    episode.truncated = task.max_steps > 0 and episode.control_steps >= task.max_steps
    if episode.terminated:
        finish(run, row, &step)
    episode.terms_before = episode.terms
    add_terms(&episode.terms, &step)
    return reward(&step, drawn.time_weight, task.force_weight, &episode.rewards)


cdef void drive(Run *run, Row *row, Command asked) noexcept nogil:
    """Simulate a control step, and read the sensors; with an operator, `flange_command` replaces `asked`."""
    cdef Chain *chain = row.chain
    cdef Episode *episode = row.episode
    cdef bint linked = row.task.operator_kind != NO_OPERATOR
    cdef double period_end = chain.time + row.task.control_period
    cdef bint shifts = not row.task.alarm_by_reading
    cdef double until, end, begun, late = 0.0 if shifts else ROUNDING
    cdef int status
    if shifts and isinf(episode.alarm) and not isinf(chain.detection):
        end = snap(period_end, alarm_time(row))
    else:
        end = snap(period_end, end_time(row, chain.detection))
    while chain.time < end:
        until = min(end, max(episode.next_sample, chain.time))
        if linked:
            process_events(row)
            asked = flange_command(row)
            until = snap(min(until, max(next_event(row), chain.time)), end)  # events at `end` are processed below
        begun = chain.time
        status = command(run, chain, asked.velocity, asked.acceleration, until) if until > chain.time else ARRIVED
        if linked and chain.contacts == 0 or status == TOUCHED:
            add_to_withheld_share(row, chain.time - begun)
        if status < 0:
            episode.status = status
            if not begun <= chain.time <= until:  # the time is nan, or not between `begun` and `until`
                chain.time = until
            break
        if status == TOUCHED:
            send_display(row)
        if status == DETECTED:
            if shifts:
                end = snap(period_end, alarm_time(row))
                episode.next_sample = chain.time
            else:
                end = snap(period_end, end_time(row, chain.detection))
        if chain.time >= episode.next_sample - late:
            sample(run, row)
    if linked:
        process_events(row)
