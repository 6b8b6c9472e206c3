"""One step of the integrator: by a Taylor series, by the explicit pair DOP853, or by the L-stable pair Rodas5P.

An analytic piece (`series.pxi`) uses Taylor series, and a general piece (`general.pxi`) the explicit pair. The last two
stages of the explicit pair are both at the end of the step. As in Hairer's code, the largest eigenvalue lambda is about
(difference of their rates) / (difference of their states). Near the limit of stability, h lambda about 6, the error
estimate keeps the step h short. After repeated attempts near this limit, the L-stable pair is used, as it is where a
series is too steep. After TRY attempts of that pair, the series or explicit pair is tried, and kept if it succeeds.
"""

cdef enum:
    EXPLICIT, STIFF, SERIES
    UNCHECKED = 25  # initial `attempts_before_check`: number of explicit attempts before stiffness is checked
    REPEATED = 10  # after more attempts than this near the limit of stability, the L-stable pair is used
    REPEATED_SERIES = 20  # the same for series, which are faster
    TRY = 10  # number of attempts of the L-stable pair between two trials of the series or the explicit pair
    MOST = 16 * UNCHECKED  # largest `attempts_before_check`

cdef double NEAR = 3.5  # a step with a larger h lambda is near the limit of stability; there, h lambda is about 4 to 7


cdef void rates(const Piece *piece, const double *x, double *out) noexcept nogil:
    """Write the derivative of the scaled state `x` into `out`: by s (`contact.pxi`), in flight by scaled time."""
    cdef GeneralRates of_all
    if piece.analytic:
        analytic_rates(&piece.polynomial, x, out)
    else:
        of_all = general_rates(piece, x[0], x[1], x[2], x[4], x[5], x[8], x[9])
        memcpy(out, &of_all, sizeof(GeneralRates))


cdef void jacobian(const Piece *piece, const double *x, double[WIDTH] *J) noexcept nogil:
    """Write the derivatives of `rates` by the scaled state `x` into `J`, a row for each rate."""
    memset(J, 0, sizeof(double) * WIDTH * WIDTH)
    if piece.analytic:
        analytic_jacobian(piece, x, J)
    else:
        general_jacobian(piece, x, J)


cdef double attempt(const Piece *piece, Work *work, double h) noexcept nogil:
    """Try a step of `h` from `work.x` into `work.trial`; return the ratio of estimated to allowed error.

    A series has no error estimate: its ratio is 0.5, or 2 if `h` exceeds `work.longest`.
    """
    if work.method == SERIES:
        evaluate(piece, work, h, work.trial, work.trial_rate)
        return 0.5 if h <= work.longest else 2.0
    work.dense_known = False
    if work.method == EXPLICIT:
        return explicit_step(piece, work, h)
    return stiff_step(piece, work, h)


cdef double apparent_eigenvalue(const Piece *piece, const Work *work) noexcept nogil:
    """Estimate the largest eigenvalue in the last step, by a series or by the explicit pair."""
    return fastest(piece, work.trial, work.trial_rate) if work.method == SERIES else explicit_eigenvalue(work)


cdef double judge(const Piece *piece, Work *work, double h, double *error) noexcept nogil:
    """Return the factor for the next `h`; update `work.memory`. If a trial after stiff steps fails, it gets error 2."""
    cdef Memory *memory = &work.memory
    memory.attempts += 1
    if work.method != STIFF and memory.method == STIFF:  # a trial after stiff steps
        if error[0] > 1.0 or h * apparent_eigenvalue(piece, work) > NEAR:
            memory.attempts, error[0] = 0, 2.0
            return 1.0
        memory.attempts_before_check = min(4 * memory.attempts_before_check, MOST)
        memory.method, memory.attempts = EXPLICIT, 0
    elif work.method != STIFF and memory.attempts > memory.attempts_before_check:
        if h * apparent_eigenvalue(piece, work) <= NEAR:
            memory.attempts -= 1
        if memory.attempts > memory.attempts_before_check + (REPEATED_SERIES if work.method == SERIES else REPEATED):
            memory.method, memory.attempts = STIFF, 0
    return step_factor(work, error[0])


cdef void choose_method(const Piece *piece, Work *work, double *h) noexcept nogil:
    """Choose the method of the next attempt. If the motion is not stiff, the step of a series sets or limits `h`."""
    cdef const Memory *memory = &work.memory
    cdef bint stiff = memory.method == STIFF, known = work.expanded
    work.method = STIFF if stiff and (memory.attempts == 0 or memory.attempts % TRY != 0) else EXPLICIT
    if work.method == STIFF or not piece.analytic:
        return
    if not known:
        expand(piece, work)
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


cdef void probe(const Piece *piece, Work *work, double h, double fraction) noexcept nogil:
    """Compute the state at the fraction `fraction` of the last attempt (step `h`), and the rate in this state."""
    cdef int i
    if work.method != EXPLICIT:
        probe_exactly(piece, work, h, fraction)
        return
    fit_polynomial(piece, work, h)
    for i in range(WIDTH):
        work.probe[i] = on_polynomial(work, i, fraction)[0]
    rates(piece, work.probe, work.probe_rate)


cdef void probe_exactly(const Piece *piece, Work *work, double h, double fraction) noexcept nogil:
    """Compute the same as `probe`, by a step of `fraction * h` instead of a polynomial."""
    cdef Work other
    if work.method == SERIES:
        evaluate(piece, work, fraction * h, work.probe, work.probe_rate)
        return
    other.method = work.method
    memcpy(other.x, work.x, sizeof(other.x))
    memcpy(other.rate, work.rate, sizeof(other.x))
    attempt(piece, &other, fraction * h)
    memcpy(work.probe, other.trial, sizeof(other.x))
    memcpy(work.probe_rate, other.trial_rate, sizeof(other.x))


cdef void fit_polynomial(const Piece *piece, Work *work, double h) noexcept nogil:
    """Compute the polynomial through the last attempt of the explicit pair, unless it is known."""
    cdef double change
    cdef int i
    if work.dense_known:
        return
    dense_output(piece, work, h)
    for i in range(WIDTH):
        change = work.trial[i] - work.x[i]
        work.dense[0][i] = change
        work.dense[1][i] = h * work.rate[i] - change
        work.dense[2][i] = 2.0 * change - h * (work.rate[i] + work.trial_rate[i])
    work.dense_known = True


cdef inline (double, double) on_polynomial(const Work *work, int i, double fraction) noexcept nogil:
    """Return component `i` of the step's polynomial (Hairer's CONTD8) at `fraction`, and its derivative by it."""
    cdef double left = 1.0 - fraction, value = work.dense[6][i], slope = 0.0
    cdef int k
    for k in range(5, 0, -2):
        slope = value + fraction * slope
        value = work.dense[k][i] + fraction * value
        slope = left * slope - value
        value = work.dense[k - 1][i] + left * value
    return work.x[i] + fraction * value, value + fraction * slope
