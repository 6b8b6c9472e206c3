"""Delay and loss of each packet on a channel, from random numbers or a recorded trace."""

cpdef enum:
    LONGEST_JITTER = 12  # largest ratio of the random part of a delay to the mean of the random part


cdef double chance(Row *row, int64_t stream, int64_t count) noexcept nogil:
    """Return number `count`, uniform in [0, 1), of a `stream` (4 to 7: uplink, 8 to 11: downlink, 12: operator)."""
    return hashed(row.episode.drawn.noise_seed, (stream << 40) + count)


cdef double normal_chance(Row *row, int64_t stream, int64_t count) noexcept nogil:
    """Return number `count`, standard normal, of a row's random stream."""
    cdef double[2] uniform
    uniform[0], uniform[1] = chance(row, stream, 2 * count), chance(row, stream, 2 * count + 1)
    return normal(uniform)


cdef double delay_of(Row *row, const ChannelNumbers *channel, const Table *trace, int64_t stream, int64_t count,
                     double time) noexcept nogil:
    """Return the delay (s) of packet `count`, sent at `time` (s); without a trace it is `delay` + a random time."""
    cdef double mean, begin
    if trace.points > 0:
        begin = chance(row, stream + 3, 0) * trace.length
        return look_up(trace, row.tables, fmod(begin + time, trace.length))
    if channel.jitter == channel.tail == 0.0:
        return channel.delay
    mean = channel.tail if chance(row, stream, 2 * count) < channel.tail_share else channel.jitter
    return channel.delay + mean * min(-log1p(-chance(row, stream, 2 * count + 1)), <double> LONGEST_JITTER)


cdef double mean_delay(const ChannelNumbers *channel, const Table *trace) noexcept nogil:
    """Return the mean delay of a channel or of a recorded `trace`, s."""
    if trace.points > 0:
        return trace.mean
    return channel.delay + channel.jitter + channel.tail_share * (channel.tail - channel.jitter)


cdef bint is_lost(Row *row, const ChannelNumbers *channel, int64_t *was_lost, int64_t stream,
                  int64_t count) noexcept nogil:
    """Return whether packet `count` is lost; bursts of losses have the mean length `burst` (Gilbert 1960)."""
    cdef double share = channel.loss
    if share == 0.0:
        return False
    if count > 0:
        share = 1.0 - 1.0 / channel.burst if was_lost[0] else min(1.0, share / (channel.burst * (1.0 - share)))
    was_lost[0] = chance(row, stream + 1, count) < share
    return was_lost[0]


cdef double look_up(const Table *table, const double *tables, double time) noexcept nogil:
    """Return the value of a table at a time: linear between its points, constant before and after."""
    cdef const double *times = tables + table.begin
    cdef const double *values = times + table.points
    cdef int64_t low = 0, high = table.points - 1, middle
    if time >= times[high]:
        return values[high]
    if time <= times[0]:
        return values[0]
    while high - low > 1:
        middle = (low + high) // 2
        if times[middle] <= time:
            low = middle
        else:
            high = middle
    return values[low] + (values[high] - values[low]) * (time - times[low]) / (times[high] - times[low])
