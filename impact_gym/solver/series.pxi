"""Analytic pieces: contacts with m = n = 3/2 of a rigid or spring chain, whose equations are polynomials.

`taylor.h` computes the Taylor series of the state; this file chooses and takes the step.
"""

cdef enum:
    LAST_ORDERS = 3  # number of last orders that give the radius of convergence; one of them can be all 0

cdef double LEFT_OUT = -6.3  # log2(truncation error / allowed local error), small because a contact's errors add up
# log2(largest truncation error): 2e-8 for tolerances of 2e-5 (rtol 1e-4) and less, so that a contact that barely parts
# is told from one that does not, as errors of contacts add up; 1e-5 for 2e-4 (rtol 1e-3), 3e-5 for 2e-3 (rtol 1e-2).
cdef double STRICT = -25.6, LOOSE = -16.6
cdef double TOO_STEEP = 1e30  # above this sum of squares of an order's weighted coefficients, the L-stable pair is used


cdef void begin_analytic(const Run *run, Piece *piece) noexcept nogil:
    """Set `piece.polynomial`; in a rigid chain the tool is infinitely heavy and has no spring."""
    cdef const ChainModel *model = run.model
    cdef Polynomial *equations = &piece.polynomial
    cdef double left_out, log_tolerance = rough_log2(piece.tolerance)
    memset(equations, 0, sizeof(Polynomial))
    equations.active, equations.damping = piece.contact.active, piece.contact.damping
    equations.ground, equations.push = piece.ground, piece.push
    if model.kind == SPRING_CHAIN:
        equations.pull_y = -model.frequency * model.frequency * piece.units.time * piece.units.time
        equations.pull_y_dot = -2.0 * model.damping_ratio * model.frequency * piece.units.time
        equations.tool_share = run.object_mass / (model.tool_mass + run.object_mass)
    equations.share = equations.tool_share if piece.object_state == STUCK else 1.0
    piece.log_width = rough_log2(piece.width)
    left_out = LOOSE + (log_tolerance + 12.3) * (0.5 if log_tolerance > -12.3 else 2.5)  # -12.3: log2(2e-4)
    piece.log_left_out = max(min(LEFT_OUT + log_tolerance, STRICT), left_out) / (ORDER + 1)


cdef void analytic_rates(const Polynomial *equations, const double *x, double *rate) noexcept nogil:
    """Write d/ds (`contact.pxi`) of z, w, time, impulse, y, v and the integral of y (paper, eq. 6 and 17-18)."""
    cdef double z = x[ROOT], w = x[RATE], fourth = (z * z) * (z * z)
    cdef double impulse = fourth * equations.active + (fourth * equations.damping) * w
    cdef double pull = z * (equations.pull_y * x[DEFLECTION] + equations.pull_y_dot * x[DEFLECTION_RATE])
    rate[ROOT] = 0.5 * w
    rate[RATE] = (pull + z * equations.ground) - equations.share * impulse
    rate[TIME] = z
    rate[IMPULSE] = impulse
    rate[DEFLECTION] = z * x[DEFLECTION_RATE]
    rate[DEFLECTION_RATE] = (pull - z * equations.push) - equations.tool_share * impulse
    rate[DEFLECTION_INTEGRAL] = z * x[DEFLECTION]


cdef void analytic_jacobian(const Piece *piece, const double *x, double[WIDTH] *J) noexcept nogil:
    """Write the derivatives of `analytic_rates` into `J`, whose elements are 0."""
    cdef const Polynomial *equations = &piece.polynomial
    cdef double z = x[ROOT], pull = equations.pull_y * x[DEFLECTION] + equations.pull_y_dot * x[DEFLECTION_RATE]
    contact_rows(piece, x, J)
    J[RATE][ROOT] = pull + equations.ground - equations.share * J[IMPULSE][ROOT]
    J[RATE][RATE] = -equations.share * J[IMPULSE][RATE]
    J[DEFLECTION_RATE][ROOT] = pull - equations.push - equations.tool_share * J[IMPULSE][ROOT]
    J[DEFLECTION_RATE][RATE] = -equations.tool_share * J[IMPULSE][RATE]
    J[RATE][DEFLECTION] = J[DEFLECTION_RATE][DEFLECTION] = z * equations.pull_y
    J[RATE][DEFLECTION_RATE] = J[DEFLECTION_RATE][DEFLECTION_RATE] = z * equations.pull_y_dot
    J[DEFLECTION][ROOT], J[DEFLECTION][DEFLECTION_RATE] = x[DEFLECTION_RATE], z
    J[DEFLECTION_INTEGRAL][ROOT], J[DEFLECTION_INTEGRAL][DEFLECTION] = x[DEFLECTION], z


cdef void expand(const Piece *piece, Work *work) noexcept nogil:
    """Compute the Taylor series of the state at `work.x`, and the longest accurate step, 0 if unknown."""
    expand_polynomial(&piece.polynomial, work.x, work.series)
    work.expanded, work.longest = True, longest_by_series(piece, work)


cdef double longest_by_series(const Piece *piece, const Work *work) noexcept nogil:
    """Return the step with the allowed truncation error, if coefficients decay like radius^-order; 0: see TOO_STEEP."""
    cdef double squares, inverse_radius = -10.0  # log2(1 / radius), not less: coefficients of last orders can be 0
    cdef double[COMPONENTS] weight
    cdef int i, k
    for i in range(COMPONENTS):
        weight[i] = max(fabs(work.series[0][i]), 1.0)
        weight[i] = 1.0 / (weight[i] * weight[i])
    for k in range(ORDER - LAST_ORDERS + 1, ORDER + 1):
        squares = 0.0
        for i in range(COMPONENTS):
            squares += weight[i] * (work.series[k][i] * work.series[k][i])
        if not squares < TOO_STEEP:
            return 0.0
        inverse_radius = max(inverse_radius, (0.5 / k) * (rough_log2(squares) - piece.log_width))
    return exp2f(<float> (piece.log_left_out - inverse_radius))


cdef inline double rough_log2(double x) noexcept nogil:
    """Return the logarithm of a positive number to base 2, to 0.05: the bits of a number are nearly its logarithm."""
    cdef int64_t bits
    memcpy(&bits, &x, sizeof(x))
    return bits * 2.0**-52 - 1022.957


cdef void evaluate(const Piece *piece, const Work *work, double h, double *x, double *rate) noexcept nogil:
    """Write the state after a step of `h` into `x` (Horner's scheme in h^2), and the state's derivative into `rate`."""
    cdef double[COMPONENTS] odd, even
    cdef double square = h * h
    cdef int i, k
    for i in range(COMPONENTS):
        even[i], odd[i] = work.series[ORDER][i], work.series[ORDER - 1][i]
    for k in range(ORDER - 2, 0, -2):
        for i in range(COMPONENTS):
            even[i] = work.series[k][i] + square * even[i]
            odd[i] = work.series[k - 1][i] + square * odd[i]
    for i in range(COMPONENTS):
        x[i] = work.series[0][i] + h * (odd[i] + h * even[i])
    rates(piece, x, rate)


cdef double fastest(const Piece *piece, const double *x, const double *rate) noexcept nogil:
    """Return the larger absolute eigenvalue, of the contact alone or of the spring alone, in an analytic piece."""
    cdef const Polynomial *equations = &piece.polynomial
    cdef double damping = equations.share * equations.damping
    cdef double z = x[ROOT], force, spring = z * largest_root(-equations.pull_y_dot, -equations.pull_y)
    if z <= 0.0:
        return spring
    force = equations.share * z * z * z * (equations.active + equations.damping * x[RATE])
    return max(spring, largest_root(damping * z * z * z * z, 1.5 * force - 0.5 * rate[RATE] / z))


cdef inline double largest_root(double b, double c) noexcept nogil:
    """Return the larger absolute value of the roots of r^2 + b r + c, for b >= 0."""
    cdef double square = 0.25 * b * b - c
    return 0.5 * b + sqrt(square) if square > 0.0 else sqrt(c)
