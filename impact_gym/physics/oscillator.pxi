"""The motion, in closed form, of a tool on one linear spring and damper.

y is the deflection of the tool, omega the angular frequency and zeta the damping ratio. While tool and
object do not touch, under a constant flange acceleration a,

    y'' + 2 zeta omega y' + omega^2 y = -a        (paper, eq. 17 with F = 0)

so z = y + a / omega^2 is a free damped oscillation.
"""


cpdef (double, double) decay_basis(double frequency, double damping_ratio, double time) noexcept nogil:
    """Return E cos(W t) and E sin(W t) / W, with E = exp(-zeta omega t) and W = omega_d = omega sqrt(1 - zeta^2)."""
    cdef double alpha = damping_ratio * frequency
    cdef double square = (damping_ratio - 1.0) * (damping_ratio + 1.0) * frequency * frequency  # = -omega_d^2
    cdef double q = square * time * time, envelope, damped, split, slow, lost
    if fabs(q) < 1e-3:  # near omega_d t = 0, a series avoids 0 / 0
        envelope = exp(-alpha * time)
        return (
            envelope * (1.0 + q / 2.0 * (1.0 + q / 12.0 * (1.0 + q / 30.0))),
            envelope * time * (1.0 + q / 6.0 * (1.0 + q / 20.0 * (1.0 + q / 42.0))),
        )
    if q < 0.0:
        envelope = exp(-alpha * time)
        damped = sqrt(-square)
        return envelope * cos(damped * time), envelope * sin(damped * time) / damped
    split = sqrt(square)  # omega_d is imaginary: hyperbolic functions
    slow = exp(-frequency * frequency / (alpha + split) * time)
    lost = -expm1(-2.0 * split * time)
    return slow * (1.0 - 0.5 * lost), slow * lost / (2.0 * split)


cpdef (double, double) free_decay(
    double frequency, double damping_ratio, double position, double velocity, double time
) noexcept nogil:
    """Solve z'' + 2 zeta omega z' + omega^2 z = 0 from z = `position`, z' = `velocity`; return z, z' at `time` (s)."""
    cdef double cosine, sine, alpha = damping_ratio * frequency
    cosine, sine = decay_basis(frequency, damping_ratio, time)
    return (
        position * cosine + (velocity + alpha * position) * sine,
        velocity * cosine - (frequency * frequency * position + alpha * velocity) * sine,
    )


cdef inline double relative_force(double frequency, double damping_ratio, double y, double y_dot) noexcept nogil:
    """Return (force of spring and damper on the tool) / (tool mass), m/s^2 (paper, right side of eq. 17)."""
    return -frequency * (frequency * y + 2.0 * damping_ratio * y_dot)
