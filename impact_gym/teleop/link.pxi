"""An operator behind two channels: commands, their packets, and the assistance at the arm."""

cpdef enum:
    NO_OPERATOR, REPLAY, PERSON, STEADY, REACH, SECOND_ORDER_LAG, TRACKER  # operators

cpdef enum:
    LONGEST_JITTER = 12  # means; a longer random delay is cut to this

cdef double MUSCLE = 0.04  # s, time constant of each of two lags between control and motion (Todorov 2005)
cdef double WITHDRAWAL = 0.3  # m/s, the fastest
cdef double FADE = 0.1  # s, in which a withdrawal ends
FASTEST_WITHDRAWAL, WITHDRAWAL_FADE = WITHDRAWAL, FADE
cdef double IDLE = 0.3  # s, an operator who has commanded 0 for so long is done
cdef double BESIDE = 5e-3  # m, penetration or gap of a tool that stands at the object
cdef double STANDING = 0.01  # m/s, fastest flange of such a tool


cdef double chance(Row *row, int64_t stream, int64_t count) noexcept nogil:
    """Uniform number in [0, 1), the `count`-th of a stream of the episode; force noise has the stream 0."""
    return hashed(row.episode.drawn.noise_seed, (stream << 40) + count)


cdef double normal_chance(Row *row, int64_t stream, int64_t count) noexcept nogil:
    """Standard normal number, likewise."""
    cdef double[2] uniform
    uniform[0], uniform[1] = chance(row, stream, 2 * count), chance(row, stream, 2 * count + 1)
    return normal(uniform)


cdef double delay_of(Row *row, const ChannelNumbers *channel, const Table *trace, int64_t stream, int64_t count,
                     double time) noexcept nogil:
    """Delay of the `count`-th packet of a channel, sent at `time`, s: the trace's, or the least and a random one."""
    cdef double mean, begin
    if trace.points > 0:
        begin = chance(row, stream + 3, 0) * trace.length
        return look_up(trace, row.tables, fmod(begin + time, trace.length))
    if channel.jitter == channel.tail == 0.0:
        return channel.delay
    mean = channel.tail if chance(row, stream, 2 * count) < channel.tail_share else channel.jitter
    return channel.delay + mean * min(-log1p(-chance(row, stream, 2 * count + 1)), <double> LONGEST_JITTER)


cdef double mean_delay(const ChannelNumbers *channel, const Table *trace) noexcept nogil:
    """Mean delay of a channel's packets, s."""
    if trace.points > 0:
        return trace.mean
    return channel.delay + channel.jitter + channel.tail_share * (channel.tail - channel.jitter)


cdef bint is_lost(Row *row, const ChannelNumbers *channel, int64_t *was_lost, int64_t stream,
                  int64_t count) noexcept nogil:
    """Whether a packet is lost, from whether the one before was (Gilbert 1960): `loss` of all, `burst` in a row."""
    cdef double share = channel.loss
    if share == 0.0:
        return False
    if count > 0:
        share = 1.0 - 1.0 / channel.burst if was_lost[0] else min(1.0, share / (channel.burst * (1.0 - share)))
    was_lost[0] = chance(row, stream + 1, count) < share
    return was_lost[0]


cdef double look_up(const Table *table, const double *tables, double time) noexcept nogil:
    """Value of a table at a time, linear between its points, the last one beyond."""
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


cdef void begin_link(Row *row) noexcept nogil:
    """Reset the link at t = 0, with no packet in transit."""
    cdef Link *link = row.link
    cdef const Record *drawn = &row.episode.drawn
    cdef const OperatorNumbers *numbers = &drawn.operator
    cdef double way, lag = mean_delay(&drawn.uplink, &row.task.uplink) + mean_delay(&drawn.downlink, &row.task.downlink)
    memset(link, 0, sizeof(Link))
    link.sent = -1.0
    link.stop = link.idle_since = link.next_arrival = link.expires = INFINITY
    link.alarmed = -INFINITY
    way = link.believed = max(drawn.distance + numbers.place_error, 0.0)
    link.duration = 1.875 * way / numbers.speed if numbers.speed > 0.0 else INFINITY
    link.duration *= 1.0 + numbers.lag_slope * lag
    row.episode.late = lag + numbers.reaction


cdef double step_response(double omega, double zeta, double time) noexcept nogil:
    """Response of a spring and damper of angular frequency omega (rad/s) to a unit step of its target at time 0."""
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
    """Command of the operator's model, m/s, before noise."""
    cdef const OperatorNumbers *numbers = &row.episode.drawn.operator
    cdef Link *link = row.link
    cdef double speed = numbers.speed, share, omega, zeta
    if row.task.operator_kind == PERSON:
        return link.person_command
    if row.task.operator_kind == REPLAY:  # at the tick's own time, whatever rounding the clock has gathered
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
        share = exp(-M_PI * zeta / sqrt(1.0 - zeta * zeta)) if zeta < 1.0 else 0.0  # by which it overshoots
        speed /= 1.0 + share
        share = time - link.believed / speed  # since the target has arrived
        speed *= step_response(omega, zeta, time) - step_response(omega, zeta, share)
        return max(speed, numbers.creep) if omega * share > 1.0 else speed
    return min(max(numbers.gain * (link.believed - seen_position(row, time)), numbers.creep), speed)


cdef double seen_position(Row *row, double time) noexcept nogil:
    """Position of the flange that the operator sees, m: of the newest packet displayed a reaction time ago."""
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


cdef double commanded(Row *row, double time) noexcept nogil:
    """Command of the operator now, m/s: the model's with the noise of control."""
    cdef const OperatorNumbers *numbers = &row.episode.drawn.operator
    cdef Link *link = row.link
    cdef int64_t count = link.packets
    cdef double limit = numbers.speed if numbers.speed > 0.0 else INFINITY
    cdef double least = max(-limit, row.task.velocity.low), speed, rate, share
    if link.stopped:
        return 0.0
    speed = intended(row, time)
    if numbers.noise > 0.0:  # white, 10 ms of it as in the source, through two lags
        rate = row.task.control_period / MUSCLE
        rate = rate / (1.0 + rate)
        share = numbers.noise * sqrt(0.01 / row.task.control_period)
        link.muscle += rate * (share * normal_chance(row, 12, count) - link.muscle)
        link.tremor += rate * (link.muscle - link.tremor)
        speed *= 1.0 + link.tremor
    return min(max(speed, least), limit)


cdef double send_display(Row *row) noexcept nogil:
    """Send a packet to the display; return when it arrives, s. The first to arrive after a touch shows it."""
    cdef Link *link = row.link
    cdef const ChannelNumbers *channel = &row.episode.drawn.downlink
    cdef double now = row.chain.time
    cdef double arrives = now + delay_of(row, channel, &row.task.downlink, 8, link.display_packets, now)
    if is_lost(row, channel, &link.downlink_lost, 8, link.display_packets):
        arrives = INFINITY
    link.display_packets += 1
    if row.chain.contacts > 0 and row.task.operator_kind > PERSON:
        link.stop = min(link.stop, arrives + row.episode.drawn.operator.reaction)
    return arrives


cdef void send(Row *row, bint regular) noexcept nogil:
    """Send a command now, which may be lost; at a `regular` tick the arm sends a packet to the display too."""
    cdef Link *link = row.link
    cdef Chain *chain = row.chain
    cdef const ChannelNumbers *channel = &row.episode.drawn.uplink
    cdef Packet *packet = &row.packets[link.packets % row.packet_slots]
    packet.sent, packet.position = chain.time, chain.flange_position
    packet.displayed = send_display(row) if regular else INFINITY
    link.last_sent = packet.command = commanded(row, chain.time)
    packet.arrives = chain.time + delay_of(row, channel, &row.task.uplink, 4, link.packets, chain.time)
    if is_lost(row, channel, &link.uplink_lost, 4, link.packets):
        packet.arrives = INFINITY
    link.packets += 1
    link.next_arrival = min(link.next_arrival, packet.arrives)


cdef void receive_commands(Row *row) noexcept nogil:
    """Receive the commands that have arrived by now: the newest counts, older ones are dropped."""
    cdef Link *link = row.link
    cdef Packet *packet
    cdef double now = row.chain.time + ROUNDING, age
    cdef int64_t k
    link.next_arrival = INFINITY
    link.oldest = max(link.oldest, link.packets - row.packet_slots)
    for k in range(link.packets - 1, link.oldest - 1, -1):
        packet = &row.packets[k % row.packet_slots]
        if packet.arrives > now:
            link.next_arrival = min(link.next_arrival, packet.arrives)
        else:
            if packet.sent > link.sent:
                if packet.command != 0.0:
                    link.idle_since = INFINITY
                elif link.command != 0.0:
                    link.idle_since = row.chain.time
                link.sent, link.command, link.expired = packet.sent, packet.command, 0
                link.expires = packet.arrives + row.episode.drawn.uplink.timeout
                age = packet.arrives - packet.sent
                link.arrived += 1
                link.age_squares += (age - link.age_mean) * (age - link.age_mean) * (link.arrived - 1) / link.arrived
                link.age_mean += (age - link.age_mean) / link.arrived
            break
    while link.oldest < link.packets and row.packets[link.oldest % row.packet_slots].sent <= link.sent:
        link.oldest += 1


cdef double next_event(const Row *row) noexcept nogil:
    """Time of the link's next event, s: a command is sent, arrives or expires."""
    cdef const Link *link = row.link
    cdef double sends = min(link.next_sent, link.stop if not link.stopped else INFINITY)
    return min(min(sends, link.next_arrival), link.expires)


cdef void process_events(Row *row) noexcept nogil:
    """Process the events of the link that are due."""
    cdef Link *link = row.link
    cdef double now = row.chain.time + ROUNDING
    cdef bint regular = link.next_sent <= now
    if regular or (link.stop <= now and not link.stopped):
        if regular:
            link.ticks += 1
            link.next_sent = link.ticks * row.task.control_period
        link.stopped = link.stop <= now
        send(row, regular)
    if link.next_arrival <= now:
        receive_commands(row)
    if link.expires <= now:
        link.expired, link.expires = 1, INFINITY


cdef Command flange_command(Row *row) noexcept nogil:
    """Command to the flange: a share of the operator's, soon after an alarm minus a withdrawal.

    A command of 0, or one that has expired, stops the flange at the arm's limit, whatever the action is.
    """
    cdef Link *link = row.link
    cdef const Task *task = row.task
    cdef Command sent = Command(0.0, task.full_deceleration)
    link.effective = 0.0 if link.expired else link.command
    if link.effective != 0.0:
        sent.velocity = min(max(link.gain * link.effective - link.withdrawal, task.velocity.low), task.velocity.high)
        sent.acceleration = link.acceleration
    row.episode.sensors.executed = sent.velocity
    return sent


cdef void assist(Row *row, double gain, double acceleration, double withdrawal) noexcept nogil:
    """Take the action of a control step, in SI units; a withdrawal counts for `after_alarm` after an alarm, then fades."""
    cdef double since
    row.link.gain, row.link.acceleration = gain, acceleration
    row.link.withdrawal = 0.0
    if row.chain.time >= row.episode.alarm:
        row.link.alarmed = row.episode.alarm
    since = row.chain.time - row.link.alarmed - row.task.after_alarm
    if since < FADE:
        row.link.withdrawal = withdrawal * min(1.0, 1.0 - since / FADE)


cdef void add_to_withheld_share(Row *row, double time) noexcept nogil:
    """Add a time (s) before the touch to the ways commanded and withheld."""
    row.link.commanded_way += time * fabs(row.link.effective)
    row.link.withheld_way += time * fabs(row.link.effective - row.episode.sensors.executed)


cdef void observe_link(Row *row) noexcept nogil:
    """Write the observed numbers of the operator's commands."""
    cdef Link *link = row.link
    cdef Sensors *sensors = &row.episode.sensors
    sensors.command = link.command
    sensors.command_age = row.chain.time - max(link.sent, 0.0)
    sensors.command_age_mean = link.age_mean
    sensors.command_age_spread = sqrt(link.age_squares / link.arrived) if link.arrived > 0 else 0.0
    row.episode.taken = link.withheld_way / link.commanded_way if link.commanded_way > 0.0 else 0.0


cdef bint task_done(Row *row) noexcept nogil:
    """Done: object at rest and operator or tool finished, or operator gave up untouched."""
    cdef Chain *chain = row.chain
    cdef bint idle = chain.time >= row.link.idle_since + IDLE - ROUNDING
    if chain.contacts == 0:
        return idle
    if chain.object_state != STUCK:
        return False
    return idle or (fabs(chain.penetration) <= BESIDE and fabs(chain.flange_velocity) <= STANDING)
