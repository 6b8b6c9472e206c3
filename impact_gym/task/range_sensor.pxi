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
    cdef double rho = sensor.correlation if episode.control_steps > 0 else 0.0  # the first error has no predecessor
    cdef int64_t first = RANGE_STREAM + 3 * episode.control_steps
    cdef double[2] uniform
    uniform[0], uniform[1] = hashed(seed, first + 1), hashed(seed, first + 2)
    episode.range_error = rho * episode.range_error + sqrt(1.0 - rho * rho) * normal(uniform)
    if hashed(seed, first) >= sensor.dropout and sensor.nearest <= gap <= sensor.farthest:
        gap += sensor.scale * gap + sensor.bias + (sensor.noise + sensor.share * gap) * episode.range_error
        gap = max(gap, 0.0)
        if sensor.resolution > 0.0:
            gap = rint(gap / sensor.resolution) * sensor.resolution
        row.ranges[episode.ranges_taken % row.range_slots] = RangeReading(time, gap)
        episode.ranges_taken += 1
    while episode.ranges_delivered < episode.ranges_taken:
        reading = &row.ranges[episode.ranges_delivered % row.range_slots]
        if reading.time + sensor.delay > time + ROUNDING:
            break
        episode.sensors.range, episode.range_time = reading.gap, reading.time
        episode.ranges_delivered += 1
    episode.sensors.range_age = time - episode.range_time
