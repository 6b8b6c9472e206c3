"""One step of the integrator: by a Taylor series, by the explicit pair DOP853, or by the L-stable pair Rodas5P.

An analytic piece (`series.pxi`) uses Taylor series, and a general piece (`general.pxi`) the explicit pair. The last two
stages of the explicit pair are both at the end of the step. As in Hairer's code, the largest eigenvalue lambda is about
(difference of their rates) / (difference of their states). Near the limit of stability, h lambda about 6, the error
estimate keeps the step h short. After repeated attempts near this limit, the L-stable pair is used, as it is where a
series is too steep. After TRY attempts of that pair, the series or explicit pair is tried, and kept if it succeeds.
"""

cdef enum:
    EXPLICIT, STIFF, SERIES
    UNCHECKED = 25  # initial `patience`: number of explicit attempts before stiffness is checked
    REPEATED = 10  # after more attempts than this near the limit of stability, the L-stable pair is used
    TRY = 10  # number of attempts of the L-stable pair between two trials of the series or the explicit pair
    MOST = 16 * UNCHECKED  # largest `patience`

cdef double NEAR = 3.5  # a step with a larger h lambda is near the limit of stability; there, h lambda is about 4 to 7


cdef double attempt(const Piece *now, Work *work, double h) noexcept nogil:
    """Try a step of `h` from `work.x` into `work.trial`; return the ratio of estimated to allowed error.

    A series has no error estimate: its ratio is 0.5, or 2 if `h` exceeds `work.longest`.
    """
    if work.method == SERIES:
        evaluate(now, work, h, work.trial, work.trial_rate)
        return 0.5 if h <= work.longest else 2.0
    work.dense_known = False
    if work.method == EXPLICIT:
        return explicit_step(now, work, h)
    return stiff_step(now, work, h)


cdef double apparent_eigenvalue(const Piece *now, const Work *work) noexcept nogil:
    """Estimate the largest eigenvalue in the last step, by a series or by the explicit pair."""
    return fastest(now, work.trial, work.trial_rate) if work.method == SERIES else explicit_eigenvalue(work)


cdef double judge(const Piece *now, Work *work, double h, double *error) noexcept nogil:
    """Return the factor for the next `h`; update `work.memory`. If a trial after stiff steps fails, it gets error 2."""
    cdef Memory *memory = &work.memory
    memory.seen += 1
    if work.method != STIFF and memory.method == STIFF:  # a trial after stiff steps
        if error[0] > 1.0 or h * apparent_eigenvalue(now, work) > NEAR:
            memory.seen, error[0] = 0, 2.0
            return 1.0
        memory.patience = min(4 * memory.patience, MOST)
        memory.method, memory.seen = EXPLICIT, 0
    elif work.method != STIFF and memory.seen > memory.patience:
        if h * apparent_eigenvalue(now, work) <= NEAR:
            memory.seen -= 1
        if memory.seen > memory.patience + REPEATED:
            memory.method, memory.seen = STIFF, 0
    return step_factor(work, error[0])


cdef void choose_method(const Piece *now, Work *work, double *h) noexcept nogil:
    """Choose the method of the next attempt. If the motion is not stiff, the step of a series sets or limits `h`."""
    cdef const Memory *memory = &work.memory
    cdef bint stiff = memory.method == STIFF, known = work.expanded
    work.method = STIFF if stiff and (memory.seen == 0 or memory.seen % TRY != 0) else EXPLICIT
    if work.method == STIFF or not now.analytic:
        return
    if not known:
        expand(now, work)
    work.method = SERIES if work.longest > 0.0 else STIFF
    if work.method == SERIES and not stiff:
        h[0] = min(h[0], work.longest) if known else work.longest


cdef double step_factor(Work *work, double error) noexcept nogil:
    """Return the factor for `h`; after an accepted explicit step the previous error also counts (Hairer)."""
    cdef float factor, log_error  # single precision is enough for the length of a step
    cdef Memory *memory = &work.memory
    if work.method == SERIES:
        return 1.0
    if error == 0.0:
        return 5.0
    if work.method == STIFF:
        return min(5.0, max(0.2, 0.9 * pow(error, -0.2)))
    log_error = logf(<float> max(error, 1e-30))
    if error > 1.0:
        memory.rejected = 1
        return max(0.2, 0.95 * expf(-0.125 * log_error))
    factor = 0.95 * expf(<float> (0.04 * memory.log_before) - <float> 0.095 * log_error)
    memory.log_before = max(log_error, <float> -9.0)
    factor = min(factor, <float> (1.0 if memory.rejected else 5.0))
    memory.rejected = 0
    return max(<float> 0.2, factor)


cdef void probe(const Piece *now, Work *work, double h, double share) noexcept nogil:
    """Compute the state at the fraction `share` of the last attempt (step `h`), and the rate in this state."""
    cdef int i
    if work.method != EXPLICIT:
        probe_exactly(now, work, h, share)
        return
    fit_polynomial(now, work, h)
    for i in range(WIDTH):
        work.probe[i] = on_polynomial(work, i, share)[0]
    rates(now, work.probe, work.probe_rate)


cdef void probe_exactly(const Piece *now, Work *work, double h, double share) noexcept nogil:
    """Compute the same as `probe`, by a step of `share * h` instead of a polynomial."""
    cdef Work other
    if work.method == SERIES:
        evaluate(now, work, share * h, work.probe, work.probe_rate)
        return
    other.method = work.method
    memcpy(other.x, work.x, sizeof(other.x))
    memcpy(other.rate, work.rate, sizeof(other.x))
    attempt(now, &other, share * h)
    memcpy(work.probe, other.trial, sizeof(other.x))
    memcpy(work.probe_rate, other.trial_rate, sizeof(other.x))


cdef void fit_polynomial(const Piece *now, Work *work, double h) noexcept nogil:
    """Compute the polynomial through the last attempt of the explicit pair, unless it is known."""
    cdef double change
    cdef int i
    if work.dense_known:
        return
    dense_output(now, work, h)
    for i in range(WIDTH):
        change = work.trial[i] - work.x[i]
        work.dense[0][i] = change
        work.dense[1][i] = h * work.rate[i] - change
        work.dense[2][i] = 2.0 * change - h * (work.rate[i] + work.trial_rate[i])
    work.dense_known = True


cdef inline (double, double) on_polynomial(const Work *work, int i, double share) noexcept nogil:
    """Return component `i` of the step's polynomial (Hairer's CONTD8) at `share`, and its derivative by `share`."""
    cdef double left = 1.0 - share, value = work.dense[6][i], slope = 0.0
    cdef int k
    for k in range(5, 0, -2):
        slope = value + share * slope
        value = work.dense[k][i] + share * value
        slope = left * slope - value
        value = work.dense[k - 1][i] + left * value
    return work.x[i] + share * value, value + share * slope
