"""The contact alarm, and the end of an episode after a contact.

With `alarm="force"` a switch at the tool raises the alarm once, a reaction delay after the contact force first exceeds
the threshold. With `alarm="reading"` a force reading above the threshold raises the alarm when the reading reaches the
controller. This alarm ends after the time `after_alarm`, and can be raised again.
"""

cdef double ROUNDING = 1e-9  # s; smaller differences between times are rounding errors


cdef inline double alarm_time(const Row *row) noexcept nogil:
    """Return when the switch's alarm reaches the controller, s; inf before the force has exceeded the threshold."""
    return row.chain.detection + row.episode.drawn.reaction_delay


cdef inline void raise_alarm(Episode *episode, double time) noexcept nogil:
    """Raise the alarm at `time` (s), unless it is raised already."""
    episode.alarm = episode.last_alarm = min(episode.alarm, time)


cdef void update_alarm(Row *row) noexcept nogil:
    """At the end of a control step, raise the switch's alarm if it is due, or end a reading's alarm if it is over."""
    cdef Episode *episode = row.episode
    if not row.task.alarm_by_reading:
        if row.chain.time >= alarm_time(row):
            raise_alarm(episode, alarm_time(row))
    elif row.chain.time >= episode.alarm + row.task.after_alarm - ROUNDING:
        episode.alarm = INFINITY


cdef inline double end_time(const Row *row, double detection) noexcept nogil:
    """Return the latest end of an episode, s; the force first exceeds the threshold at `detection`, s (inf: never)."""
    if isinf(detection) or row.task.operator_kind:
        return row.task.horizon
    return detection + row.episode.drawn.reaction_delay + row.task.after_alarm
