"""After an episode with a touch, brake the flange, and simulate until `is_over` or a time limit."""


cdef inline double v_p(const Run *run, const Chain *chain) noexcept nogil:
    """Return V_p so far, m/s: the object's velocity; with friction its largest velocity."""
    return chain.peak_object_velocity if run.ground > 0.0 else object_velocity(chain)


cdef void finish(Run *run, Row *row, Terms *step) noexcept nogil:
    """Call `settle` after a touch, unless the solver failed; write the results, and the reward terms except time."""
    cdef Episode *episode = row.episode
    if episode.status == 0 and row.chain.contacts > 0:
        episode.status = settle(run, row)
    if row.chain.contacts == 0 or episode.status < 0:
        step.miss = row.task.missed_cost
        episode.object_velocity = 0.0
    else:
        episode.object_velocity = step.speed = v_p(run, row.chain)
        step.force = row.chain.peak_force
    if run.ground > 0.0:
        record_rest(run, row.chain, episode.drawn.distance)
        episode.slide, episode.rest_time = row.chain.slide, row.chain.rest_time


cdef int settle(Run *run, Row *row) noexcept nogil:
    """Brake, and simulate to the end or a time limit; return ARRIVED, UNSETTLED or the status of a failed solver."""
    cdef Chain *chain = row.chain
    cdef double limit = chain.time + row.task.settle_limit, deceleration = row.task.full_deceleration, brake_end
    cdef double pause = REST_STEP if run.ground > 0.0 else 0.05
    cdef int status
    while not is_over(run, chain):
        if chain.time >= limit:
            # an object stuck for half the limit remains stuck, because a tool that oscillates on it only loses energy
            if has_stuck(chain, limit - 0.5 * row.task.settle_limit) or not chain.touching and cannot_touch(run, chain):
                return ARRIVED
            if chain.touching:
                close_contact(run, chain, NAN)
            return UNSETTLED
        brake_end = chain.time + fabs(chain.flange_velocity) / deceleration
        status = command(run, chain, 0.0, deceleration, min(limit, max(brake_end, chain.time + pause)))
        if status < 0:
            return status
        note_tool_rest(run, chain)
    return ARRIVED


cdef inline bint has_stuck(const Chain *chain, double since) noexcept nogil:
    """Return whether the object has stuck since the time `since` (s) while the imposed motion is at rest."""
    return chain.object_state == STUCK and chain.object_rest_time <= since and chain.flange_velocity == 0.0


cdef bint is_over(const Run *run, const Chain *chain) noexcept nogil:
    """Return whether V_p is final and, with friction, the tool is at rest."""
    if chain.flange_velocity != 0.0:
        return False
    if run.ground == 0.0:
        return not chain.touching and cannot_touch(run, chain)
    if isinf(chain.tool_rest_time):
        return False
    if chain.touching or chain.peak_object_velocity > 2.0 * REST_SPEED:  # a tool at REST_SPEED cannot cause this speed
        return True
    return reach_at_rest(run, chain) < -chain.penetration or cannot_touch(run, chain)
