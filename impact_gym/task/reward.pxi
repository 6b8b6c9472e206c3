"""The reward of a control step: four unweighted terms, then their weighted sum."""


cdef struct Terms:  # of a control step, or their sums in an episode
    double time  # s, duration before the first contact; with an operator, the whole duration
    double speed  # m/s, at termination V_p (see `settle.pxi`), or 0 if missed or failed; in other steps 0
    double force  # N, at termination the largest contact force, or 0 if missed or failed; in other steps 0
    double miss  # m/s, at termination the cost if missed or if the solver failed; otherwise 0


cdef double reward(const Terms *step, double time_weight, double force_weight, Terms *rewards) noexcept nogil:
    """Return the reward of a control step, m/s, and add its weighted terms, m/s, to `rewards`."""
    cdef Terms given = Terms(-(time_weight * step.time), -step.speed, -(force_weight * step.force), -step.miss)
    add_terms(rewards, &given)
    return given.time + given.miss + given.speed + given.force


cdef inline void add_terms(Terms *total, const Terms *step) noexcept nogil:
    total.time, total.speed = total.time + step.time, total.speed + step.speed
    total.force, total.miss = total.force + step.force, total.miss + step.miss


cdef double charged_time(const Chain *chain, double begun, bint to_the_end) noexcept nogil:
    if to_the_end:
        return chain.time - begun
    return min(chain.time, chain.first_contact) - min(begun, chain.first_contact)
