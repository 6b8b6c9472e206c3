"""Flights that have a closed form: those of rigid and spring chains, with any contact law.

The tool of a rigid chain has the imposed motion, so the gap is quadratic in time. A spring chain is one mass (tool, or
tool and robot) on a spring and damper, see `oscillator.pxi`.
"""

cdef enum:
    MOST_BENDS = 300000  # largest number of intervals that `spring_touch` searches in a flight, see STEP_LIMIT


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


cdef void spring_drift(
    const ChainModel *model, Chain *chain, double acceleration, double ground, double time
) noexcept nogil:
    """Move `chain` exactly through `time` (s) of flight; `ground` (m/s^2) is the object's deceleration by friction."""
    cdef double z, z_dot, rest = -acceleration / (model.frequency * model.frequency)
    cdef double object_speed = tool_velocity(chain) - chain.penetration_rate
    cdef double travel = time * (chain.flange_velocity + 0.5 * acceleration * time)
    z, z_dot = free_decay(model.frequency, model.damping_ratio, chain.deflection - rest, chain.deflection_rate, time)
    chain.penetration += travel + (z + rest - chain.deflection) - time * (object_speed - 0.5 * ground * time)
    chain.deflection = z + rest
    chain.deflection_rate = z_dot
    chain.flange_position += travel
    chain.flange_velocity += acceleration * time
    chain.penetration_rate = chain.flange_velocity + z_dot - (object_speed - ground * time)
    chain.time += time


cdef struct FreeFlight:  # at time t, penetration = start + z(t) - z(0) + closing t + acceleration t^2 / 2
    double frequency  # rad/s
    double damping_ratio
    double position, velocity  # m, m/s: z(0) and z'(0) of the free oscillation z, see `oscillator.pxi`
    double start  # m, penetration at t = 0, not positive
    double closing  # m/s, velocity of the imposed motion minus object velocity, at t = 0
    double acceleration  # m/s^2, acceleration of the imposed motion minus object acceleration


cdef struct GapDerivatives:
    double[5] order  # penetration (m) and its first four derivatives
    double z, z_dot  # m, m/s, of the free oscillation


cdef GapDerivatives gap_at(const FreeFlight *flight, double time) noexcept nogil:
    """Return the penetration and its derivatives at `time` (s)."""
    cdef double bend, w2 = flight.frequency * flight.frequency, c = 2.0 * flight.damping_ratio * flight.frequency
    cdef GapDerivatives gap
    gap.z, gap.z_dot = flight.position, flight.velocity
    if time > 0.0:
        gap.z, gap.z_dot = free_decay(flight.frequency, flight.damping_ratio, gap.z, gap.z_dot, time)
    bend = -w2 * gap.z - c * gap.z_dot
    gap.order[0] = flight.start + (gap.z - flight.position) + time * (flight.closing + 0.5 * flight.acceleration * time)
    gap.order[1] = gap.z_dot + flight.closing + flight.acceleration * time
    gap.order[2] = bend + flight.acceleration
    gap.order[3] = -w2 * gap.z_dot - c * bend
    gap.order[4] = -w2 * bend - c * gap.order[3]
    return gap


cdef double monotone_zero(
    const FreeFlight *flight, int order, double low, const GapDerivatives *first, double high,
    const GapDerivatives *last,
) noexcept nogil:
    """Return the time (s) from `low` to `high` at which derivative `order` of penetration, monotone there, is 0."""
    cdef GapDerivatives gap
    cdef bint rising = last.order[order] > 0.0
    cdef double move, bend, angle, time, span = high - low
    time = low + span * cubic_zero(
        first.order[order], span * first.order[order + 1], last.order[order], span * last.order[order + 1]
    )
    for _ in range(100):
        if not low < time < high:
            time = 0.5 * (low + high)
        gap = gap_at(flight, time)
        if (gap.order[order] > 0.0) == rising:
            high = time
        else:
            low = time
        move = -gap.order[order] / gap.order[order + 1]
        bend = 0.5 * move * gap.order[order + 2] / gap.order[order + 1]
        move /= max(1.0 + bend, 0.5)  # Halley's method
        time += move
        angle = fabs(flight.frequency * move) + fabs(bend)
        # the left side estimates the error that is left; zeros of derivatives only bracket a touch
        if angle * angle * fabs(move) <= (1e-17 if order == 0 else 1e-9) * high:
            return min(max(time, low), high)
    return time


cdef double inflection_time(const FreeFlight *flight, double after, const GapDerivatives *gap) noexcept nogil:
    """Return when (s) the gap's third derivative, a free damped oscillation, is next 0 after `after`; inf: never."""
    cdef double w = flight.frequency, zeta = flight.damping_ratio, p = gap.order[3]
    cdef double slope = gap.order[4] + zeta * w * p, square = (1.0 - zeta) * (1.0 + zeta) * w * w
    cdef double damped, phase, ratio, split
    if square > 0.0:
        damped = sqrt(square)
        phase = atan2(-p * damped, slope)
        while phase <= 1e-9:
            phase += M_PI
        return after + phase / damped
    if slope == 0.0:
        return INFINITY
    ratio = -p / slope
    if ratio * w <= 1e-9:  # there is no zero after `after` (up to rounding)
        return INFINITY
    if square == 0.0:
        return after + ratio
    split = sqrt(-square)
    return after + atanh(ratio * split) / split if ratio * split < 1.0 else INFINITY


cdef double within_reach(const FreeFlight *flight, double time, const GapDerivatives *gap) noexcept nogil:
    """Return a time (s) before which no touch is possible, or inf. After `time`, |z| <= hypot(z, z' / omega)."""
    cdef double distance = gap.z - gap.order[0] - sqrt((gap.z_dot / flight.frequency) ** 2 + gap.z * gap.z)
    if distance <= 0.0:
        return time
    return time + gap_closes(distance, flight.closing + flight.acceleration * time, flight.acceleration)


cdef bint stays_apart(const GapDerivatives *first, const GapDerivatives *last, double span) noexcept nogil:
    """Return whether a bound excludes a touch within `span` (s). The second derivative is monotone in between."""
    cdef double half = 0.5 * span, bend = 0.5 * max(max(first.order[2], last.order[2]), 0.0)
    cdef double after = first.order[0] + half * (first.order[1] + half * bend)
    cdef double before = last.order[0] - half * (last.order[1] - half * bend)
    return after < 0.0 and before < 0.0 and last.order[0] < 0.0


cdef double spring_touch(
    const ChainModel *model, const Chain *chain, double acceleration, double ground, double horizon
) noexcept nogil:
    """Return the time (s) until the first touch; inf if not within `horizon` (s), nan if MOST_BENDS did not suffice."""
    cdef FreeFlight flight
    cdef GapDerivatives first, last
    cdef double low, high, touch, fastest
    flight.frequency, flight.damping_ratio = model.frequency, model.damping_ratio
    flight.position = chain.deflection + acceleration / (model.frequency * model.frequency)
    flight.velocity = chain.deflection_rate
    flight.start = min(chain.penetration, 0.0)
    flight.closing = chain.penetration_rate - chain.deflection_rate
    flight.acceleration = acceleration + ground
    fastest = sqrt(flight.velocity * flight.velocity + (flight.frequency * flight.position) ** 2)  # by its energy
    if fastest + flight.closing + max(flight.acceleration * horizon, 0.0) < 0.0:
        return INFINITY
    first = gap_at(&flight, 0.0)
    low, high = within_reach(&flight, 0.0, &first), 0.0
    for _ in range(MOST_BENDS):  # between zeros of its third derivative, the gap has at most one inflection
        if not low < horizon:
            return INFINITY
        if low > high:
            first = gap_at(&flight, low)
        high = min(inflection_time(&flight, low, &first), horizon)
        last = gap_at(&flight, high)
        if not stays_apart(&first, &last, high - low):
            touch = touch_between(&flight, low, &first, high, &last)
            if touch < INFINITY:
                return touch
        first, low = last, within_reach(&flight, high, &last)
    return NAN


cdef double touch_between(
    const FreeFlight *flight, double begin, const GapDerivatives *first, double end, const GapDerivatives *last
) noexcept nogil:
    """Return the time (s) of the first touch from `begin` to `end`, with at most one inflection between; inf: none."""
    cdef double middle, touch
    cdef GapDerivatives between
    if (first.order[2] > 0.0) == (last.order[2] > 0.0):
        return touch_in_bend(flight, begin, first, end, last)
    middle = monotone_zero(flight, 2, begin, first, end, last)
    between = gap_at(flight, middle)
    touch = touch_in_bend(flight, begin, first, middle, &between)
    return touch if touch < INFINITY else touch_in_bend(flight, middle, &between, end, last)


cdef double touch_in_bend(
    const FreeFlight *flight, double begin, const GapDerivatives *first, double end, const GapDerivatives *last
) noexcept nogil:
    """Return the time (s) of the first touch from `begin` to `end`, where the gap has no inflection; inf: no touch."""
    cdef bint closing = first.order[1] > 0.0, still = last.order[1] > 0.0
    cdef double turn
    cdef GapDerivatives there
    # while the gap opens, an apparent touch is a rounding error; if it closes at the end, it is smallest at an end
    if begin >= end or not (closing or still) or (still and not last.order[0] > 0.0):
        return INFINITY
    turn, there = end, last[0]
    if closing != still:
        turn = monotone_zero(flight, 1, begin, first, end, last)
        there = gap_at(flight, turn)
    if closing:
        if there.order[0] > 0.0:
            return begin if first.order[0] >= 0.0 else monotone_zero(flight, 0, begin, first, turn, &there)
        return INFINITY
    return turn if there.order[0] >= 0.0 else monotone_zero(flight, 0, turn, &there, end, last)


cdef inline double ground_now(const Run *run, const Chain *chain) noexcept nogil:
    """Return the object's present deceleration by the friction under it, m/s^2; 0 if the object sticks."""
    return run.ground if chain.object_state != STUCK else 0.0


cdef inline void drift(const Run *run, Chain *chain, double acceleration, double time) noexcept nogil:
    """Move a rigid or spring chain exactly through `time` (s) of flight."""
    if run.model.kind == RIGID_CHAIN:
        rigid_drift(chain, acceleration, ground_now(run, chain), time)
    else:
        spring_drift(run.model, chain, acceleration, ground_now(run, chain), time)


cdef inline double touch_time(const Run *run, const Chain *chain, double acceleration, double horizon) noexcept nogil:
    """Return the time (s) until a rigid or spring chain touches the object; inf: later than `horizon`; nan: unknown."""
    cdef double time, ground = ground_now(run, chain)
    if run.model.kind == SPRING_CHAIN:
        return spring_touch(run.model, chain, acceleration, ground, horizon)
    time = gap_closes(-chain.penetration, chain.penetration_rate, acceleration + ground)
    return time if time <= horizon else INFINITY
