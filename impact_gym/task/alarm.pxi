"""The contact alarm: when it reaches the controller, how long it lasts, and when an episode ends after it.

By default a switch at the tool raises it once: a reaction delay after the contact force first exceeds the threshold. With
`alarm="reading"` a force reading above the threshold raises it when it arrives; it clears after `after_alarm`.
"""

cdef double ROUNDING = 1e-9  # s, shorter spans are rounding errors of the clock


cdef inline double alarm_time(const Row *row) noexcept nogil:
    """Time at which an alarm by the switch reaches the controller, s; inf while the force has not exceeded the threshold."""
    return row.chain.detection + row.episode.drawn.reaction_delay


cdef inline void raise_alarm(Episode *episode, double time) noexcept nogil:
    """Raise the alarm at a time (s), unless it is on."""
    episode.alarm = episode.last_alarm = min(episode.alarm, time)


cdef void update_alarm(Row *row) noexcept nogil:
    """At the end of a control step, raise an alarm by the switch that is due, or clear one by the readings."""
    cdef Episode *episode = row.episode
    if not row.task.alarm_by_reading:
        if row.chain.time >= alarm_time(row):
            raise_alarm(episode, alarm_time(row))
    elif row.chain.time >= episode.alarm + row.task.after_alarm - ROUNDING:
        episode.alarm = INFINITY


cdef inline double end_time(const Row *row, double detection) noexcept nogil:
    """Time at which an episode ends whose contact force first exceeded the threshold at `detection`, s."""
    if isinf(detection) or row.task.operator_kind:
        return row.task.horizon
    return detection + row.episode.drawn.reaction_delay + row.task.after_alarm
