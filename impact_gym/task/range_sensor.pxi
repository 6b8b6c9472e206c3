"""The range sensor reads the gap at every observation. The observation contains the newest reading that has arrived."""

cdef int64_t RANGE_STREAM = 1 << 40  # index of the first random number for range readings, in the noise seed's stream


cdef void begin_range(Row *row) noexcept nogil:
    """Reset the sensor: no reading has arrived yet."""
    row.episode.sensors.range, row.episode.range_time = INFINITY, -INFINITY


cdef void sense_range(Row *row) noexcept nogil:
    """Take a reading, which may be lost, and deliver the readings that are due."""
    cdef Episode *episode = row.episode
    cdef const RangeSensorNumbers *sensor = &episode.drawn.range_sensor
    cdef const RangeReading *reading
    cdef double seed = episode.drawn.noise_seed, gap = max(-row.chain.penetration, 0.0), time = row.chain.time
    cdef int64_t first = RANGE_STREAM + 3 * episode.control_steps
    cdef double[2] uniform
    if hashed(seed, first) >= sensor.dropout:
        uniform[0], uniform[1] = hashed(seed, first + 1), hashed(seed, first + 2)
        gap += sensor.bias + (sensor.noise + sensor.share * gap) * normal(uniform)
        row.ranges[episode.ranges_taken % row.range_slots] = RangeReading(time, max(gap, 0.0))
        episode.ranges_taken += 1
    while episode.ranges_delivered < episode.ranges_taken:
        reading = &row.ranges[episode.ranges_delivered % row.range_slots]
        if reading.time + sensor.delay > time + ROUNDING:
            break
        episode.sensors.range, episode.range_time = reading.gap, reading.time
        episode.ranges_delivered += 1
    episode.sensors.range_age = time - episode.range_time
