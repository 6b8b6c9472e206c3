"""Steps by Taylor series, for analytic pieces. `taylor.h` computes the series; this file chooses and takes the step."""

cdef enum:
    LAST_ORDERS = 3  # number of last orders that give the radius of convergence; one of them can be all 0

cdef double LEFT_OUT = 0.05  # largest truncation error / allowed local error, small because a contact's errors add up
cdef double MOST_LEFT_OUT = 2e-8  # largest truncation error at any tolerance, because the errors of contacts add up
cdef double TOO_STEEP = 1e30  # above this sum of squares of an order's weighted coefficients, the explicit pair is used


cdef void expand(const Piece *now, Work *work) noexcept nogil:
    """Compute the Taylor series of the state at `work.x`, and the longest accurate step, 0 if unknown."""
    cdef Polynomial law = Polynomial(
        now.contact.held, now.contact.damping, now.share, now.ground,
        now.tool_share, now.push, now.pull_y, now.pull_y_dot,
    )
    if now.law.kind == RIGID:  # the equations of a SPRING chain without spring force
        law.ground += now.push
        law.tool_share = law.push = law.pull_y = law.pull_y_dot = 0.0
        work.x[DEFLECTION] = work.x[DEFLECTION_RATE] = work.x[DEFLECTION_INTEGRAL] = 0.0
    expand_polynomial(&law, work.x, work.series)
    work.expanded, work.longest = True, longest_by_series(now, work)


cdef double longest_by_series(const Piece *now, const Work *work) noexcept nogil:
    """Return the step with the allowed truncation error, if coefficients decay like radius^-order; 0: see TOO_STEEP."""
    cdef float inverse_radius = -7.0  # ln(1 / radius); at least -7, because coefficients of the last orders can be 0
    cdef double[PLACES] weight
    cdef double squares, left_out = min(LEFT_OUT * now.tolerance, MOST_LEFT_OUT)
    cdef int i, k
    for i in range(PLACES):
        weight[i] = max(fabs(work.series[0][i]), 1.0)
        weight[i] = 1.0 / (weight[i] * weight[i])
    for k in range(ORDER - LAST_ORDERS + 1, ORDER + 1):
        squares = 0.0
        for i in range(PLACES):
            squares += weight[i] * (work.series[k][i] * work.series[k][i])
        if not squares < TOO_STEEP:
            return 0.0
        inverse_radius = max(inverse_radius, <float> (1.0 / k) * logf(<float> sqrt(squares / now.width)))
    return expf(<float> (1.0 / (ORDER + 1)) * logf(<float> left_out) - inverse_radius)


cdef void evaluate(const Piece *now, const Work *work, double h, double *x, double *rate) noexcept nogil:
    """Write the state after a step of `h` into `x` (Horner's scheme in h^2), and the state's derivative into `rate`."""
    cdef double[PLACES] odd, even
    cdef double square = h * h
    cdef int i, k
    for i in range(PLACES):
        even[i], odd[i] = work.series[ORDER][i], work.series[ORDER - 1][i]
    for k in range(ORDER - 2, 0, -2):
        for i in range(PLACES):
            even[i] = work.series[k][i] + square * even[i]
            odd[i] = work.series[k - 1][i] + square * odd[i]
    for i in range(PLACES):
        x[i] = work.series[0][i] + h * (odd[i] + h * even[i])
    rates(now, x, rate)


cdef double fastest(const Piece *now, const double *x, const double *rate) noexcept nogil:
    """Return the larger absolute eigenvalue, of the contact alone or of the spring alone, in an analytic piece."""
    cdef double z = x[ROOT], force, spring = 0.0
    if now.law.kind == SPRING:
        spring = z * largest_root(-now.pull_y_dot, -now.pull_y)
    if z <= 0.0:
        return spring
    force = now.share * z * z * z * (now.contact.held + now.contact.damping * x[RATE])
    return max(spring, largest_root(now.share * now.contact.damping * z * z * z * z, 1.5 * force - 0.5 * rate[RATE] / z))


cdef inline double largest_root(double b, double c) noexcept nogil:
    """Return the larger absolute value of the roots of r^2 + b r + c, for b >= 0."""
    cdef double square = 0.25 * b * b - c
    return 0.5 * b + sqrt(square) if square > 0.0 else sqrt(c)
