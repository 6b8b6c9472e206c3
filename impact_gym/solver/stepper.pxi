"""One step of the integrator: by a Taylor series, by the explicit pair DOP853, or by an L-stable one.

Where the equations are polynomial, a step follows their series (`series.pxi`), which says how far it goes and is known
throughout it; elsewhere it is a step of the explicit pair. Stiffness is detected by the estimate of Hairer's code: the
rates of the last two stages, which are at the same time, differ by about lambda times the difference of their states; of
a series the eigenvalues are known. Near the border of stability, h lambda about 6, the error estimate limits the step
however smooth the motion is. After repeated attempts near the border, accepted or not, the L-stable pair takes over. From
time to time the explicit pair tries a step, and continues if that succeeds. If the L-stable pair was not needed, as with
swings that only look stiff, the next change to it takes more attempts.
"""

cdef enum:
    EXPLICIT, STIFF, SERIES
    UNCHECKED = 25  # attempts without a check of stiffness: most smooth pieces have no more
    REPEATED = 10  # attempts near the border before the L-stable pair takes over
    TRY = 10  # stiff steps after which the explicit pair tries the next
    IN_VAIN = 2  # a return within so many tries shows that the change was not needed
    MOST = 16 * UNCHECKED

cdef double NEAR = 3.5  # of h lambda; kept at the border of 6, good attempts and bad ones alternate between 4 and 7


cdef double attempt(const Piece *now, Work *work, double h) noexcept nogil:
    """Try a step of `h` from `work.x` into `work.trial`; return its estimated error over what is allowed."""
    if work.method == SERIES:
        evaluate(now, work, h, work.trial, work.trial_rate)
        return 0.5 if h <= work.longest else 2.0
    work.dense_known = False
    if work.method == EXPLICIT:
        return explicit_step(now, work, h)
    return stiff_step(now, work, h)


cdef double judge(const Piece *now, Work *work, double h, double *error) noexcept nogil:
    """Return the factor on the step after an attempt of `h` with an estimated `error`, which above 1 is rejected.

    Decides, too, by which method the next step goes.
    """
    cdef Memory *memory = &work.memory
    memory.seen += 1
    if work.method != STIFF and memory.method == STIFF:  # a trial: a single step can have a small error although it is unstable
        if error[0] > 1.0 or h * apparent_eigenvalue(now, work) > NEAR:
            memory.seen, error[0] = 0, 2.0
            return 1.0
        memory.patience = min(4 * memory.patience, MOST) if memory.seen <= IN_VAIN * TRY else UNCHECKED
        memory.method, memory.seen = EXPLICIT, 0
    elif work.method != STIFF and memory.seen > memory.patience:
        if h * apparent_eigenvalue(now, work) <= NEAR:
            memory.seen -= 1
        if memory.seen > memory.patience + REPEATED:
            memory.method, memory.seen = STIFF, 0
    return step_factor(work, error[0])


cdef void choose_method(const Piece *now, Work *work, double *h) noexcept nogil:
    """Choose the method: in a stiff piece now and then an explicit one. A new series sets the step."""
    cdef const Memory *memory = &work.memory
    cdef bint stiff = memory.method == STIFF, known = work.expanded
    work.method = STIFF if stiff and (memory.seen == 0 or memory.seen % TRY != 0) else EXPLICIT
    if work.method == STIFF or not now.analytic:
        return
    if not known:
        expand(now, work)
    if work.longest > 0.0:
        work.method = SERIES
        if not stiff:
            h[0] = min(h[0], work.longest) if known else work.longest


cdef double step_factor(Work *work, double error) noexcept nogil:
    """Factor on the step by the order of the method.

    Of the explicit pair with Hairer's stabilisation: the error before this one counts too, and a step that follows a
    rejected one does not grow. One attempt in eight is rejected; without the stabilisation one in four.
    """
    cdef float factor, log_error  # single precision suffices for a step
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
    """Find the state and its rate at a share of the step of `h` just tried, on the polynomial if there is one."""
    cdef int i
    if work.method != EXPLICIT:
        probe_exactly(now, work, h, share)
        return
    fit_polynomial(now, work, h)
    for i in range(now.width):
        work.probe[i] = on_polynomial(work, i, share)[0]
    rates(now, work.probe, work.probe_rate)


cdef void probe_exactly(const Piece *now, Work *work, double h, double share) noexcept nogil:
    """Find the same by a step of that length."""
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
    """Fit the explicit pair's polynomial to the step just tried, unless that is done."""
    cdef double change
    cdef int i
    if work.dense_known:
        return
    dense_output(now, work, h)
    for i in range(now.width):
        change = work.trial[i] - work.x[i]
        work.dense[0][i] = change
        work.dense[1][i] = h * work.rate[i] - change
        work.dense[2][i] = 2.0 * change - h * (work.rate[i] + work.trial_rate[i])
    work.dense_known = True


cdef inline (double, double) on_polynomial(const Work *work, int i, double share) noexcept nogil:
    """Component `i` at a share of the step, on its polynomial (Hairer's CONTD8), and its derivative by the share."""
    cdef double left = 1.0 - share, value = work.dense[6][i], slope = 0.0
    cdef int k
    for k in range(5, 0, -2):
        slope = value + share * slope
        value = work.dense[k][i] + share * value
        slope = left * slope - value
        value = work.dense[k - 1][i] + left * value
    return work.x[i] + share * value, value + share * slope
