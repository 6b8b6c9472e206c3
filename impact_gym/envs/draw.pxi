"""From uniform numbers to an episode's record. Every number goes through the same function, in a batch and alone."""


cdef struct Generator:  # `bitgen_t` of NumPy's C interface
    void *state
    uint64_t (*next_uint64)(void *state) noexcept nogil
    uint32_t (*next_uint32)(void *state) noexcept nogil
    double (*next_double)(void *state) noexcept nogil
    uint64_t (*next_raw)(void *state) noexcept nogil


cpdef double draw(double low, double high, bint logarithmic, double uniform) noexcept nogil:
    """Map `uniform` in [0, 1) to [low, high), log-uniformly if asked."""
    if low == high:
        return low
    if logarithmic:
        return low * exp(uniform * log(high / low))
    return low + (high - low) * uniform


cpdef double normal(double first, double second) noexcept nogil:
    """Standard normal number from two uniform ones in [0, 1) (Box and Muller)."""
    return sqrt(-2.0 * log1p(-first)) * cos(2.0 * M_PI * second)


cpdef double hashed(double seed, int64_t count) noexcept nogil:
    """Uniform number in [0, 1), the `count`-th of the stream that `seed` names (splitmix64, Steele et al. 2014)."""
    cdef uint64_t z = <uint64_t> seed + <uint64_t> (count + 1) * <uint64_t> 0x9E3779B97F4A7C15
    z = (z ^ (z >> 30)) * <uint64_t> 0xBF58476D1CE4E5B9
    z = (z ^ (z >> 27)) * <uint64_t> 0x94D049BB133111EB
    z = z ^ (z >> 31)
    return <double> (z >> 11) * 2.0**-53


cdef inline double drawn_or(double fixed, double drawn) noexcept nogil:
    """What is fixed, or what was drawn where that is nan."""
    return drawn if isnan(fixed) else fixed


cdef Setting draw_setting(const Task *task, const Draw *draws, double seed, const Setting *fixed) noexcept nogil:
    """Draw the numbers of the set-up, each from a place of its own in the stream that `seed` names.

    Thereby an episode takes the same count of numbers from its generator, whatever is drawn.
    """
    cdef Setting setting = task.setting
    cdef double *number = <double *> &setting
    cdef const double *given = <const double *> fixed
    cdef const Draw *one
    cdef int64_t k
    for k in range(task.first_draw, task.last_draw):
        one = &draws[k]
        number[one.place] = drawn_or(
            given[one.place], draw(one.low, one.high, one.logarithmic, hashed(seed, -1 - one.place))
        )
    return setting


cdef Record draw_record(
    const Task *task, const Draw *draws, const Uniforms *uniforms, const Record *fixed
) noexcept nogil:
    """Draw all that an episode draws, but for what is fixed."""
    cdef Record record
    cdef const Ranges *r = &task.draws
    cdef const Uniforms *u = uniforms
    cdef double seed = floor(u.noise_seed * 2.0**53)
    record.setting = draw_setting(task, draws, seed, &fixed.setting)
    record.object_mass = drawn_or(fixed.object_mass, draw(r.object_mass.low, r.object_mass.high, True, u.object_mass))
    record.contact_stiffness = drawn_or(
        fixed.contact_stiffness, draw(r.contact_stiffness.low, r.contact_stiffness.high, True, u.contact_stiffness)
    )
    record.restitution = drawn_or(fixed.restitution, draw(r.restitution.low, r.restitution.high, False, u.restitution))
    record.distance = drawn_or(fixed.distance, draw(r.distance.low, r.distance.high, False, u.distance))
    record.time_weight = drawn_or(fixed.time_weight, draw(r.time_weight.low, r.time_weight.high, True, u.time_weight))
    record.distance_estimate = drawn_or(
        fixed.distance_estimate,
        record.distance
        + record.setting.range_bias
        + record.setting.range_noise * normal(u.estimate_size, u.estimate_angle),
    )
    record.reaction_delay = drawn_or(
        fixed.reaction_delay, draw(r.reaction_delay.low, r.reaction_delay.high, False, u.reaction_delay)
    )
    record.force_error = drawn_or(
        fixed.force_error, record.setting.force_bias * normal(u.error_size, u.error_angle)
    )
    record.noise_seed = drawn_or(fixed.noise_seed, seed)
    return record
