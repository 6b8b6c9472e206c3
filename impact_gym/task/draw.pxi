"""Draw the numbers of an episode, its `Record`, from uniform random numbers."""


cdef struct Generator:  # `bitgen_t` of NumPy's C interface
    void *state
    uint64_t (*next_uint64)(void *state) noexcept nogil
    uint32_t (*next_uint32)(void *state) noexcept nogil
    double (*next_double)(void *state) noexcept nogil
    uint64_t (*next_raw)(void *state) noexcept nogil


cpdef double draw(double low, double high, bint logarithmic, double uniform) noexcept nogil:
    """Map `uniform` in [0, 1) to a number from `low` to `high`, distributed uniformly or log-uniformly."""
    if low == high:
        return low
    if logarithmic:
        return low * exp(uniform * log(high / low))
    return low + (high - low) * uniform


cdef double normal(const double *uniform) noexcept nogil:
    """Return a standard normal number from two uniform numbers in [0, 1) (Box and Muller)."""
    return sqrt(-2.0 * log1p(-uniform[0])) * cos(2.0 * M_PI * uniform[1])


cpdef double hashed(double seed, int64_t count) noexcept nogil:
    """Return number `count`, uniform in [0, 1), of the stream `seed` (splitmix64, Steele et al. 2014)."""
    cdef uint64_t z = <uint64_t> seed + <uint64_t> (count + 1) * <uint64_t> 0x9E3779B97F4A7C15
    z = (z ^ (z >> 30)) * <uint64_t> 0xBF58476D1CE4E5B9
    z = (z ^ (z >> 27)) * <uint64_t> 0x94D049BB133111EB
    z = z ^ (z >> 31)
    return <double> (z >> 11) * 2.0**-53


cdef inline double drawn_or(double fixed, double drawn) noexcept nogil:
    return drawn if isnan(fixed) else fixed


cdef Record draw_record(
    const Task *task, const Draw *draws, const double *uniforms, const Record *fixed
) noexcept nogil:
    """Return the task's numbers, some of them drawn. A number in `fixed` that is not nan replaces the drawn one."""
    cdef Record record = task.numbers
    cdef double *number = <double *> &record
    cdef const double *given = <const double *> fixed
    cdef double seed = floor(uniforms[NOISE_SEED_UNIFORM] * 2.0**53), uniform
    cdef const Draw *drawn
    cdef int64_t k
    for k in range(task.first_draw, task.last_draw):
        drawn = &draws[k]
        uniform = uniforms[drawn.source] if drawn.source >= 0 else hashed(seed, drawn.source)
        number[drawn.index] = drawn_or(given[drawn.index], draw(drawn.low, drawn.high, drawn.by_ratio, uniform))
    record.distance_estimate = drawn_or(
        fixed.distance_estimate,
        record.distance + record.range_bias + record.range_noise * normal(&uniforms[DISTANCE_ESTIMATE_UNIFORM]),
    )
    record.force_error = drawn_or(fixed.force_error, record.force_bias * normal(&uniforms[FORCE_ERROR_UNIFORM]))
    record.noise_seed = drawn_or(fixed.noise_seed, seed)
    return record
