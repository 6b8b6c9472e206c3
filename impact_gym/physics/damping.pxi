"""The damping factor d of a contact, and the restitution e that it actually produces.

If stiffness and damping have equal exponents (m = n in `contact.pxi`) and no other force acts (isolated contact), the
restitution depends on d only. Multiply u'' = -u^n (1 + d u') by u' / (1 + d u') and integrate from onset to separation:

    d - ln(1 + d) = -z - ln(1 - z),      z = d e                                       (solution: Lambert's W)
"""

cdef double SERIES_BELOW = 0.3  # largest |x| for which `shortfall` sums its series
cdef enum:
    SERIES_TERMS = 34  # for |x| up to SERIES_BELOW, the last term is below the rounding error


cpdef double hu_guo(double restitution) noexcept nogil:
    """Return the damping factor of Hu and Guo, Multibody Syst. Dyn. 35 (2015) 131-151 (paper, eq. 7)."""
    return 1.5 * (1.0 - restitution) / restitution


cdef double shortfall(double x) noexcept nogil:
    """Return (1 - phi) / x = 2/3 - x/2 + 2 x^2/5 - ..., with phi = 2 (x - ln(1 + x)) / x^2."""
    cdef double total = 0.0
    cdef int k
    if fabs(x) > SERIES_BELOW:
        return (1.0 - 2.0 * (x - log1p(x)) / (x * x)) / x
    for k in range(SERIES_TERMS, 0, -1):
        total = 2.0 / (k + 2.0) - x * total
    return total


cpdef double exact_damping(double restitution) noexcept nogil:
    """Return the damping factor d that gives an isolated contact with m = n exactly this restitution e.

    d solves ln((1 + d) / (1 - d e)) = d (1 + e). With S = `shortfall` this is (1 - e)(1 + e) = d (S(d) + e^3 S(-d e)).
    This form has no cancellation as e -> 1. For e <= 0.6, 1 - d e = exp(ln(1 + d) - d (1 + e)) is solved instead.
    """
    cdef double rest, following, e = restitution, d = 1.5 * (1.0 - e) if e > 0.6 else 1.0 / e, kept = 0.0
    cdef int step = 0, kept_at = 0
    while step < 200:
        step += 1
        if e > 0.6:  # then d < 1.1
            following = (1.0 - e) * (1.0 + e) / (shortfall(d) + e * e * e * shortfall(-d * e))
        else:
            rest = exp(log1p(d) - d * (1.0 + e))
            following = d - (d * e - 1.0 + rest) / (e - rest * (1.0 + e - 1.0 / (1.0 + d)))
        if fabs(following - d) <= 1e-16 * d:
            break
        d = following
        if d == kept:  # rounding makes d cycle among neighbouring numbers: leave out whole cycles of the 200 steps
            step = 200 - (200 - step) % (step - kept_at)
        elif step & (step - 1) == 0:  # a power of 2 (Brent's search for cycles)
            kept, kept_at = d, step
    return d


cpdef double delivered(double damping) noexcept nogil:
    """Return the restitution e of an isolated contact with m = n and this damping factor d; relative error below 2e-15.

    For d < 0.3, Newton's method solves e^2 (1 + d e S(-d e)) = 1 - d S(d), with S = `shortfall`. For larger d it solves
    q - z = d - ln(1 + d) for q = -ln(1 - z), with z = d e. This is accurate even if z is close to 1.
    """
    cdef double d = damping, e, excess, gain, residual, step, rest, q
    if d < SERIES_BELOW:
        e = 1.0 - 2.0 / 3.0 * d * (1.0 - 2.0 / 3.0 * d)
        excess = d * shortfall(d)
        for _ in range(50):
            gain = d * e * shortfall(-d * e)
            residual = (e - 1.0) * (e + 1.0) + e * e * gain + excess
            step = residual * (1.0 - d * e) / (2.0 * e)
            e -= step
            if fabs(step) <= 2e-16:
                break
        return e
    rest = d - log1p(d)
    q = rest + 1.0 if rest > 1.0 else sqrt(2.0 * rest)
    for _ in range(50):
        step = (q + expm1(-q) - rest) / -expm1(-q)
        q -= step
        if fabs(step) <= 1e-16 * q:
            break
    return -expm1(-q) / d


cpdef double delivered_linear(double damping) noexcept nogil:
    """Return the restitution e of a linear contact (m = 1, n = 0, damping ratio zeta = d / 2) that never pulls.

    e = exp(-2 zeta arccos(zeta) / sqrt(1 - zeta^2)), which is exp(-2) at zeta = 1. For zeta > 1 the exponent is
    -2 zeta arcosh(zeta) / sqrt(zeta^2 - 1).
    """
    cdef double ratio, zeta = 0.5 * damping, square = (1.0 - zeta) * (1.0 + zeta)
    if fabs(square) < 1e-6:  # arccos(zeta) / sqrt(1 - zeta^2) = 1 + y/6 + 3 y^2/40 + ... with y = 1 - zeta^2
        ratio = 1.0 + square * (1.0 / 6.0 + square * 3.0 / 40.0)
    elif square > 0.0:
        ratio = acos(zeta) / sqrt(square)
    else:
        ratio = acosh(zeta) / sqrt(-square)
    return exp(-2.0 * zeta * ratio)
