"""The commands of each kind of operator, with motor noise."""

cpdef enum:
    NO_OPERATOR, REPLAY, PERSON, STEADY, REACH, SECOND_ORDER_LAG, TRACKER  # kinds of operator

cdef double MUSCLE = 0.04  # s, time constant of each of two first-order lags from control to motion (Todorov 2005)


cdef double step_response(double omega, double zeta, double time) noexcept nogil:
    """Return the position at `time` (s) of an oscillator (`omega` in rad/s) after a step of its target to 1 at 0 s."""
    cdef double decay = zeta * omega, root = omega * sqrt(fabs(1.0 - zeta * zeta)), slow, fast
    if time <= 0.0:
        return 0.0
    if root == 0.0:
        return 1.0 - exp(-decay * time) * (1.0 + decay * time)
    if zeta < 1.0:
        return 1.0 - exp(-decay * time) * (cos(root * time) + decay / root * sin(root * time))
    slow, fast = decay - root, decay + root
    return 1.0 - (fast * exp(-slow * time) - slow * exp(-fast * time)) / (fast - slow)


cdef double intended(Row *row, double time) noexcept nogil:
    """Return the operator's command before noise, m/s."""
    cdef const OperatorNumbers *numbers = &row.episode.drawn.operator
    cdef Link *link = row.link
    cdef double speed = numbers.speed, share, omega, zeta
    if row.task.operator_kind == PERSON:
        return link.person_command
    if row.task.operator_kind == REPLAY:  # time in the recordings, from `ticks` because `time` has rounding errors
        time = floor(numbers.recording) * row.task.replay.length + (link.ticks - 1) * row.task.control_period
        return look_up(&row.task.replay, row.tables, time)
    if row.task.operator_kind == STEADY:
        return speed
    if row.task.operator_kind == REACH:
        share = time / link.duration if link.duration > 0.0 else 1.0
        speed = 30.0 * link.believed / link.duration * (share * (1.0 - share)) ** 2 if share < 1.0 else 0.0
        return max(speed, numbers.creep) if share > 0.5 else speed
    if row.task.operator_kind == SECOND_ORDER_LAG:
        omega, zeta = sqrt(numbers.stiffness), 0.5 * numbers.damping / sqrt(numbers.stiffness)
        share = exp(-M_PI * zeta / sqrt(1.0 - zeta * zeta)) if zeta < 1.0 else 0.0  # overshoot as a fraction of a step
        speed /= 1.0 + share
        share = time - link.believed / speed  # s, since the moving target was at the assumed position; negative: before
        speed *= step_response(omega, zeta, time) - step_response(omega, zeta, share)
        return max(speed, numbers.creep) if omega * share > 1.0 else speed
    return min(max(numbers.gain * (link.believed - seen_position(row, time)), numbers.creep), speed)


cdef double seen_position(Row *row, double time) noexcept nogil:
    """Return the newest flange position (m) that was displayed a reaction time ago or earlier; 0: none."""
    cdef double then = time - row.episode.drawn.operator.reaction + ROUNDING
    cdef Link *link = row.link
    cdef Packet *packet
    cdef int64_t k
    for k in range(link.packets, max(link.seen_packet, link.packets - row.packet_slots), -1):
        packet = &row.packets[k % row.packet_slots]
        if packet.displayed <= then:
            link.seen_packet, link.seen_position = k, packet.position
            break
    return link.seen_position


cdef double operator_command(Row *row, double time) noexcept nogil:
    """Return the velocity that the operator commands at `time` (s), m/s, with motor noise."""
    cdef const OperatorNumbers *numbers = &row.episode.drawn.operator
    cdef Link *link = row.link
    cdef int64_t count = link.packets
    cdef double limit = numbers.speed if numbers.speed > 0.0 else INFINITY
    cdef double least = max(-limit, row.task.velocity.low), speed, rate, share
    if link.stopped:
        return 0.0
    speed = intended(row, time)
    if numbers.noise > 0.0:  # white noise after two lags; Todorov (2005) gives its size for steps of 10 ms
        rate = row.task.control_period / MUSCLE
        rate = rate / (1.0 + rate)
        share = numbers.noise * sqrt(0.01 / row.task.control_period)
        link.muscle += rate * (share * normal_chance(row, 12, count) - link.muscle)
        link.tremor += rate * (link.muscle - link.tremor)
        speed *= 1.0 + link.tremor
    return min(max(speed, least), limit)
