"""The reward: four unweighted terms of each control step, and the function that weighs them.

The vector reward of `envs.objectives` uses the same terms.
"""


cdef struct Terms:  # of a control step, or their sums in an episode
    double time  # s, until the first contact; with an operator until the end
    double speed  # m/s, V_p, at the end
    double force  # N, largest contact force, at the end
    double miss  # m/s, cost of an object that was not touched, at the end


cdef double reward(const Terms *step, double time_weight, double force_weight, Terms *rewards) noexcept nogil:
    """Return the reward of a control step, m/s, and add its weighted terms, m/s, to `rewards`."""
    cdef Terms given = Terms(-(time_weight * step.time), -step.speed, -(force_weight * step.force), -step.miss)
    add_terms(rewards, &given)
    return given.time + given.miss + given.speed + given.force


cdef inline void add_terms(Terms *total, const Terms *step) noexcept nogil:
    """Add the terms of a control step to a total."""
    total.time, total.speed = total.time + step.time, total.speed + step.speed
    total.force, total.miss = total.force + step.force, total.miss + step.miss


cdef double charged_time(const Chain *chain, double begun, bint to_the_end) noexcept nogil:
    """Return the charged time of a control step that began at `begun` (s), s: until the first contact, or all of it."""
    if to_the_end:
        return chain.time - begun
    return min(chain.time, chain.first_contact) - min(begun, chain.first_contact)
