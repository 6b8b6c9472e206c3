"""The contact force (paper, eq. 5), in natural units and in a variable that makes the motion smooth.

With the reduced mass M, the approach velocity v, the stiffness k_c and its exponent m, a contact has the natural units

    delta0 = (M v^2 / k_c)^(1 / (m + 1))      t0 = delta0 / v      F0 = k_c delta0^m = M v / t0

In these units the penetration is u = delta / delta0, its rate w = delta_dot / v, and the force f = u^m + d u^n w, with
the damping factor d and the exponent n of the damping. While f is negative (a pull), the contact force is 0.
With m = n = 3/2 the power u^1.5 makes u(t) non-smooth at the beginning and at the end of the contact. The motion is
smooth with the unknown z = sqrt(u), and with the variable s instead of time, where dt = z ds:

    dz/ds = w / 2      dw/ds = z (push - f)      f = z^3 (1 + d w)

Here `push` is the tool's acceleration relative to the object, without contact force. If 2 m and 2 n are whole numbers,
the right sides are polynomials in z, w and `push`. So an integrator keeps its full order over the whole contact, and
onset and separation are simple zeros of z.
"""

cdef enum:
    ROOT, RATE, TIME, IMPULSE  # first components of the scaled state: z, w, t, impulse on the object

cdef double APPROACH_VELOCITY_FLOOR = 1e-6  # m/s, least approach velocity for the units and damping factor of a contact


cdef struct Contact:  # the law of a contact, with the symbols above
    double stiffness  # N/m^m, k_c
    double damping  # -, damping factor d of the present contact
    double m  # -, exponent of the stiffness, at least 1
    double n  # -, exponent of the damping, 0 or at least 1
    int64_t twice_m, twice_n  # 2 m and 2 n if they are whole numbers, else -1
    double nominal  # -, damping factor at the velocity `reference`, or at every velocity if `reference` is 0
    double reference  # m/s, reference velocity if the hysteresis damping chi is constant; 0: d is constant
    double active  # 0 while the force is kept at 0 because f would be negative (`damping` is then 0, too); else 1


cdef struct Units:  # natural units of a contact; for motion without contact see `flight_units`
    double length  # m, delta0
    double time  # s, t0
    double velocity  # m/s, approach velocity, but at least APPROACH_VELOCITY_FLOOR
    double force  # N, F0


cpdef Contact contact_of(double stiffness, double damping, double m, double n, double reference) noexcept nogil:
    """Return the law of a contact (SI units); `reference` (m/s) is 0 for a constant damping factor."""
    cdef Contact law = Contact(stiffness, damping, m, n, -1, -1, damping, reference, 1.0)
    if 2.0 * m == floor(2.0 * m):
        law.twice_m = <int64_t> (2.0 * m)
    if 2.0 * n == floor(2.0 * n):
        law.twice_n = <int64_t> (2.0 * n)
    return law


cdef inline bint is_hertz(const Contact *law) noexcept nogil:
    """Return whether m = n = 3/2."""
    return law.twice_m == 3 and law.twice_n == 3


cdef inline double root_power(double z, double exponent, int64_t twice) noexcept nogil:
    """Return z^`twice`. If `twice` is -1 (2 `exponent` is not a whole number), return |z|^(2 `exponent`) instead."""
    cdef double power = 1.0
    if twice < 0:
        return pow(z * z, exponent)
    while twice > 0:
        if twice & 1:
            power *= z
        z *= z
        twice >>= 1
    return power


cdef Units natural_units(const Contact *law, double reduced_mass, double approach_velocity) noexcept nogil:
    """Return the units of a contact, from the reduced mass (kg) and the approach velocity (m/s)."""
    cdef Units units
    units.velocity = max(approach_velocity, APPROACH_VELOCITY_FLOOR)
    units.length = pow(reduced_mass * units.velocity * units.velocity / law.stiffness, 1.0 / (law.m + 1.0))
    units.time = units.length / units.velocity
    units.force = reduced_mass * units.velocity / units.time
    return units


cdef inline double damping_at(const Contact *law, double approach_velocity) noexcept nogil:
    """Return the damping factor d; for constant chi, d ~ v delta0^(n - m) and delta0 ~ v^(2 / (m + 1))."""
    if law.reference == 0.0:
        return law.nominal
    return law.nominal * pow(approach_velocity / law.reference, 1.0 - 2.0 * (law.m - law.n) / (law.m + 1.0))


cdef inline double contact_force(const Contact *law, double z, double w) noexcept nogil:
    """Return f, the contact force / F0 (paper, eq. 5); negative where the contact would pull."""
    if is_hertz(law):
        return z * z * z * (law.active + law.damping * w)
    return law.active * root_power(z, law.m, law.twice_m) + law.damping * root_power(z, law.n, law.twice_n) * w


cdef inline (double, double) contact_gradient(const Contact *law, double z, double w) noexcept nogil:
    """Return df/dz and df/dw of the force f."""
    cdef double u_m, u_n
    if is_hertz(law):
        return 3.0 * z * z * (law.active + law.damping * w), law.damping * z * z * z
    if z == 0.0:
        return 0.0, law.damping if law.n == 0.0 else 0.0
    u_m, u_n = root_power(z, law.m, law.twice_m), root_power(z, law.n, law.twice_n)
    return 2.0 * (law.active * law.m * u_m + law.damping * law.n * u_n * w) / z, law.damping * u_n


cdef inline (double, double) force_along(const Contact *law, double z, double w, double w_slope) noexcept nogil:
    """Return the force f and its derivative df/ds, for dz/ds = w / 2 and dw/ds = `w_slope`."""
    cdef double f_z, f_w, factor
    if is_hertz(law):
        factor = law.active + law.damping * w
        return z * z * z * factor, z * z * (1.5 * w * factor + law.damping * z * w_slope)
    f_z, f_w = contact_gradient(law, z, w)
    return contact_force(law, z, w), 0.5 * f_z * w + f_w * w_slope


cdef inline (double, double) unclamped_sign(const Contact *law, double z, double w, double w_slope) noexcept nogil:
    """Return g = f / u^min(m, n), which has the sign of f, and dg/ds; `w_slope` is dw/ds."""
    cdef double p, u_p, growth
    if law.m == law.n:
        return 1.0 + law.damping * w, law.damping * w_slope
    p = fabs(law.m - law.n)
    u_p = pow(z * z, p)
    growth = p * pow(fabs(z), 2.0 * p - 1.0) * w  # d(u^p)/ds
    if law.m >= law.n:
        return u_p + law.damping * w, growth + law.damping * w_slope
    return 1.0 + law.damping * u_p * w, law.damping * (growth * w + u_p * w_slope)
