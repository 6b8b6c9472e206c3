"""Write the observation: the numbers that the task observes, each scaled as `task/observation.py` states."""

cpdef enum:
    LINEAR, LOGARITHM, LOGARITHM_OF_ONE_MORE  # functions that are applied to a number before scaling


cdef void observe(Row *row) noexcept nogil:
    """Update the sensors, and write the observation."""
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
    if row.task.range_sensor:
        sense_range(row)
    sensors.time_since_touch = max(chain.time - chain.detection - drawn.reaction_delay, 0.0)
    for k in range(row.length):
        entry = &row.entries[k]
        value = values[entry.index]
        if entry.curve == LOGARITHM:
            if row.episode.control_steps > 0:
                continue  # numbers on a logarithmic scale stay the same during an episode
            value = log(value)
        elif entry.curve == LOGARITHM_OF_ONE_MORE and value != 0.0:
            value = log1p(value)
        value = entry.scaled_low + entry.gain * (value - entry.low)
        row.observation[k] = <float> min(1.0, max(entry.scaled_low, value))
