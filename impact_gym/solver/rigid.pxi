"""A RIGID chain: contacts change only the object's motion (paper, Fig. 4a). In flight the gap is quadratic in time."""


cdef struct RigidRates:
    double z, w, t, p


cdef inline RigidRates rigid_rates(const Piece *now, double z, double w) noexcept nogil:
    """Return d/ds of z, w, time and impulse (paper, eq. 6, second line)."""
    cdef RigidRates rates
    rates.p = impulse_rate(&now.contact, z, w)
    rates.z = 0.5 * w
    rates.w = z * (now.push + now.ground) - now.share * rates.p
    rates.t = z
    return rates


cdef inline void contact_rows(const Piece *now, const double *x, double[WIDTH] *J) noexcept nogil:
    """Write those rows of a contact's Jacobian that belong to z, t and the impulse."""
    cdef double f_z, f_w, z = x[ROOT]
    f_z, f_w = contact_gradient(&now.contact, z, x[RATE])
    J[ROOT][RATE] = 0.5
    J[TIME][ROOT] = 1.0
    J[IMPULSE][ROOT] = contact_force(&now.contact, z, x[RATE]) + z * f_z
    J[IMPULSE][RATE] = z * f_w


cdef void rigid_jacobian(const Piece *now, const double *x, double[WIDTH] *J) noexcept nogil:
    contact_rows(now, x, J)
    J[RATE][ROOT] = now.push + now.ground - now.share * J[IMPULSE][ROOT]
    J[RATE][RATE] = -now.share * J[IMPULSE][RATE]


cdef double gap_closes(double gap, double speed, double acceleration) noexcept nogil:
    """Return the time (s) until gap - speed t - acceleration t^2 / 2 falls to zero from above; inf if never."""
    cdef double square = speed * speed + 2.0 * acceleration * gap
    if square < 0.0:
        return INFINITY
    if speed > 0.0:
        return 2.0 * gap / (speed + sqrt(square)) if gap > 0.0 else 0.0
    if acceleration > 0.0:  # the gap opens now, and closes later
        return (sqrt(square) - speed) / acceleration
    return INFINITY


cdef void rigid_drift(Chain *chain, double acceleration, double ground, double time) noexcept nogil:
    """Move `chain` exactly through `time` (s) of flight; `ground` (m/s^2) is the object's deceleration by friction."""
    chain.penetration += time * (chain.penetration_rate + 0.5 * (acceleration + ground) * time)
    chain.penetration_rate += (acceleration + ground) * time
    chain.flange_position += time * (chain.flange_velocity + 0.5 * acceleration * time)
    chain.flange_velocity += acceleration * time
    chain.time += time
