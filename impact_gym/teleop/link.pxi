"""The link between operator and arm: events, packets in transit, assistance at the arm, end of the task."""

cdef double WITHDRAWAL = 0.3  # m/s, fastest withdrawal of the flange by the assistance
cdef double FADE = 0.1  # s, time in which a withdrawal falls to 0
FASTEST_WITHDRAWAL, WITHDRAWAL_FADE = WITHDRAWAL, FADE
cdef double IDLE = 0.3  # s; the operator has finished if, after a motion, the arrived command has been 0 for this time
cdef double BESIDE = 5e-3  # m, largest gap or penetration of a tool that has finished, see `task_done`
cdef double STANDING = 0.01  # m/s, largest speed of the flange's commanded motion if the tool has finished


cdef void begin_link(Row *row) noexcept nogil:
    """Reset the link and the operator's belief at the start of an episode."""
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
    row.episode.stop_delay = lag + numbers.reaction


cdef double send_display(Row *row) noexcept nogil:
    """Send a packet to the display; return its arrival, s (inf: lost). After a touch, also store when a model stops."""
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
    """Send a command, which may be lost; if `regular`, the arm also sends a packet to the display."""
    cdef Link *link = row.link
    cdef Chain *chain = row.chain
    cdef const ChannelNumbers *channel = &row.episode.drawn.uplink
    cdef Packet *packet = &row.packets[link.packets % row.packet_slots]
    packet.sent, packet.position = chain.time, chain.flange_position
    packet.displayed = send_display(row) if regular else INFINITY
    link.last_sent = packet.command = operator_command(row, chain.time)
    packet.arrives = chain.time + delay_of(row, channel, &row.task.uplink, 4, link.packets, chain.time)
    if is_lost(row, channel, &link.uplink_lost, 4, link.packets):
        packet.arrives = INFINITY
    link.packets += 1
    link.next_arrival = min(link.next_arrival, packet.arrives)


cdef void receive_commands(Row *row) noexcept nogil:
    """Use the command that was sent last among all that have arrived, and drop the others."""
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
    """Return the time of the next event of the link, s: a command is sent, arrives or expires."""
    cdef const Link *link = row.link
    cdef double sends = min(link.next_sent, link.stop if not link.stopped else INFINITY)
    return min(min(sends, link.next_arrival), link.expires)


cdef void process_events(Row *row) noexcept nogil:
    """Process what is due now: sending, arrival and expiry of commands."""
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
    """Return the flange's command: gain * `command` - withdrawal, clipped; a stop if `command` is 0 or expired."""
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
    """Set the assistance. The withdrawal is 0 before an alarm. It fades to 0 once `after_alarm` (s) has passed."""
    cdef double since
    row.link.gain, row.link.acceleration = gain, acceleration
    row.link.withdrawal = 0.0
    if row.chain.time >= row.episode.alarm:
        row.link.alarmed = row.episode.alarm
    since = row.chain.time - row.link.alarmed - row.task.after_alarm
    if since < FADE:
        row.link.withdrawal = withdrawal * min(1.0, 1.0 - since / FADE)


cdef void add_to_withheld_share(Row *row, double time) noexcept nogil:
    """Count the way (m) of the last `time` (s) that was commanded, and what the assistance withheld of it."""
    row.link.commanded_way += time * fabs(row.link.effective)
    row.link.withheld_way += time * fabs(row.link.effective - row.episode.sensors.executed)


cdef void observe_link(Row *row) noexcept nogil:
    """Write what the controller observes of the link into the sensors."""
    cdef Link *link = row.link
    cdef Sensors *sensors = &row.episode.sensors
    sensors.command = link.command
    sensors.command_age = row.chain.time - max(link.sent, 0.0)
    sensors.command_age_mean = link.age_mean
    sensors.command_age_spread = sqrt(link.age_squares / link.arrived) if link.arrived > 0 else 0.0
    row.episode.withheld_share = link.withheld_way / link.commanded_way if link.commanded_way > 0.0 else 0.0


cdef bint task_done(Row *row) noexcept nogil:
    """Return whether the object rests, and the operator has finished or (only after a touch) the tool has finished."""
    cdef Chain *chain = row.chain
    cdef bint idle = chain.time >= row.link.idle_since + IDLE - ROUNDING
    if chain.contacts == 0:
        return idle
    if chain.object_state != STUCK:
        return False
    return idle or (fabs(chain.penetration) <= BESIDE and fabs(chain.flange_velocity) <= STANDING)
