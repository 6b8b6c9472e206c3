"""The reward of a control step: four unweighted terms, then their weighted sum."""


cdef struct Terms:  # the terms of a control step, or their sums over an episode
    double time  # s, duration until the first contact; with an operator, the whole duration
    double speed  # m/s, V_p (see `settle.pxi`); 0 before termination, after a miss, and if the solver failed
    double force  # N, largest contact force; 0 in the same three cases as `speed`
    double miss  # m/s, `missed_cost` if the episode terminates with a miss or a failed solver, otherwise 0


cdef double reward(const Terms *step, double time_weight, double force_weight, Terms *rewards) noexcept nogil:
    """Return the reward of a control step, m/s, and add its weighted terms, m/s, to `rewards`."""
    cdef Terms given = Terms(-(time_weight * step.time), -step.speed, -(force_weight * step.force), -step.miss)
    add_terms(rewards, &given)
    return given.time + given.miss + given.speed + given.force


cdef inline void add_terms(Terms *total, const Terms *step) noexcept nogil:
    """Add the terms of a control step to `total`."""
    total.time, total.speed = total.time + step.time, total.speed + step.speed
    total.force, total.miss = total.force + step.force, total.miss + step.miss


cdef double charged_time(const Chain *chain, double begun, bint to_the_end) noexcept nogil:
    """Return the time (s) since `begun` that counts: until the first contact, or all of it if `to_the_end`."""
    if to_the_end:
        return chain.time - begun
    return min(chain.time, chain.first_contact) - min(begun, chain.first_contact)
