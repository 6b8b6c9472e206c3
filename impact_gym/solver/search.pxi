"""Find the first event in a step.

The rows at both ends of a step show which events have occurred, and which values may have been positive in between.
The first event is located by a polynomial or by shorter steps. Then a step is taken that ends on this event.
"""

cdef double SHORTEST_STEP = 1e-10  # scaled; if a step below this length starts on an event, it is not shortened further


cdef struct Finding:
    int event  # the first event in the step, NOTHING, or SHORTER
    double fraction  # position of the event in the step, 0 to 1; for SHORTER the factor for the step's length
    double detection  # scaled time in the piece of a detection that does not end the step; inf: none
    double within  # a position in the step, 0 to 1, at or after the event
    double peak, top  # scaled maxima inside the step (0: none) of the contact force and of a sliding object's speed
    double peak_at, top_at  # distances of `peak` and `top` from the start of the step, in the variable s


cdef Finding search(
    const Piece *piece, Work *work, double h, const Events *start, const Events *end, bint undetected
) noexcept nogil:
    """Return the first event in the last tried step, of length `h`; `start` and `end` have the rows at both ends."""
    cdef Finding found = Finding(NOTHING, 1.0, INFINITY, 1.0, 0.0, 0.0, 0.0, 0.0)
    cdef int row
    cdef double high, fraction, reached
    cdef Events summit
    for row in range(piece.first_row, piece.end_row):
        if not acts(piece, row):
            continue
        high, reached = 1.0, end.value[row]
        if (row == FORCE or row == SLIP) and piece.contact.n == 0.0 and work.x[ROOT] == 0.0:
            if end.slope[FORCE] < 0.0 and rises_at_onset(piece, work, h):
                return Finding(SHORTER, 0.25, INFINITY, 1.0, 0.0, 0.0, 0.0, 0.0)  # a step may end before the peak
        elif (row == FORCE or (row >= CLAMP and reached <= 0.0)) and has_inner_maximum(row, h, start, end):
            fraction = find_maximum(piece, work, h, row, start, end, &summit)
            if row == FORCE:
                found.peak, found.peak_at = summit.height[FORCE], fraction * h
            elif row == TOP:
                found.top, found.top_at = summit.height[TOP], fraction * h
            if reached <= 0.0:
                high, reached = fraction, summit.value[row]
        if not reached > 0.0 or (row == FORCE and not undetected):
            continue
        if starts_on(row, h, start, reached):
            return Finding(SHORTER, 0.5, INFINITY, 1.0, 0.0, 0.0, 0.0, 0.0)
        fraction = crossing_fraction(piece, work, h, row, start, end, high)
        if row == FORCE and piece.reaction > 0.0:
            probe_exactly(piece, work, h, fraction)
            evaluate_events(piece, work.probe, work.probe_rate, &summit)
            found.detection = work.probe[TIME] - summit.value[FORCE] / summit.slope[FORCE] * work.probe_rate[TIME]
            if work.trial[TIME] - found.detection <= piece.reaction:
                continue
            found.detection = INFINITY
        if found.event == NOTHING or fraction < found.fraction:
            found.event, found.fraction, found.within = row, fraction, high
    if found.event == NOTHING and piece.flying:
        fraction = inflection_fraction(work, h)
        if fraction < 1.0:
            return Finding(SHORTER, fraction, INFINITY, 1.0, 0.0, 0.0, 0.0, 0.0)
    return found


cdef bint rises_at_onset(const Piece *piece, Work *work, double h) noexcept nogil:
    """Return whether the force grows just after the onset of a contact with n = 0. At the onset df/ds = 0."""
    cdef Events soon
    probe_exactly(piece, work, h, 1e-3)  # 1e-3 of the step in s is about 1e-6 of its duration, because z begins at 0
    evaluate_events(piece, work.probe, work.probe_rate, &soon)
    return soon.slope[FORCE] > 0.0


cdef bint starts_on(int row, double h, const Events *start, double reached) noexcept nogil:
    """Return whether to shorten a step of `h`, because it starts on a zero of the row and contains a second zero."""
    if row < CLAMP or h <= SHORTEST_STEP or start.value[row] <= -1e-9 * reached:
        return False
    return FRONT_STOP <= row <= ALIGNMENT or start.slope[row] <= 0.0


cdef int earlier_event(const Piece *piece, const Events *end, int reached, bint undetected) noexcept nogil:
    """Return an event that also occurred in a step that ends on event `reached`, or NOTHING."""
    cdef int row
    for row in range(piece.first_row, piece.end_row):
        if not acts(piece, row):
            continue
        if row != reached and end.value[row] > 0.0 and (undetected or row != FORCE):
            return row
    return NOTHING


cdef double extremum(double start, double start_slope, double end, double end_slope) noexcept nogil:
    """Return where in (0, 1) a cubic is largest, given values and slopes at 0 and 1; it rises at 0 and falls at 1."""
    cdef double a = 3.0 * (end - start) - 2.0 * start_slope - end_slope
    cdef double b = start_slope + end_slope - 2.0 * (end - start)
    cdef double root = sqrt(max(a * a - 3.0 * b * start_slope, 0.0))
    cdef double position = -start_slope / (a - root)
    return position if 0.0 < position < 1.0 else 0.5


cdef double on_cubic(double t, double start, double start_slope, double end, double end_slope) noexcept nogil:
    """Return the value at t of the cubic with these values and slopes at 0 and 1."""
    return start + t * (
        start_slope + t * (3.0 * (end - start) - 2.0 * start_slope - end_slope
        + t * (start_slope + end_slope - 2.0 * (end - start)))
    )


cdef bint has_inner_maximum(int row, double h, const Events *start, const Events *end) noexcept nogil:
    """Return whether a row has a maximum in a step. Except in FORCE, SLIP and TOP, it must be about 0 or above."""
    cdef double v0 = start.height[row], v1 = end.height[row], s0 = h * start.slope[row], s1 = h * end.slope[row], top
    if row == TOP and s1 < 0.0 < start.slope[SLIP]:
        return True  # at the start of a slip, the sign of s0 depends on rounding
    if not s0 > 0.0 > s1:
        return False
    if row == FORCE or row == SLIP or row == TOP:
        return True
    top = on_cubic(extremum(v0, s0, v1, s1), v0, s0, v1, s1)
    return top + 0.1 * (top - max(v0, v1)) > 0.0  # the margin is for the error of the cubic


cdef double find_maximum(
    const Piece *piece, Work *work, double h, int row, const Events *start, const Events *end, Events *summit
) noexcept nogil:
    """Find the fraction of the step at which a row has its maximum; write all rows at this point into `summit`."""
    cdef double low = 0.0, high = 1.0, low_slope = start.slope[row], high_slope = end.slope[row], before, gain
    cdef double fraction = extremum(start.height[row], h * low_slope, end.height[row], h * high_slope)
    cdef int side = 0
    cdef bint exactly = work.method != EXPLICIT  # False: first search on the polynomial, to 1e-6 of the step
    for _ in range(60):  # find the zero of the slope by a secant method inside a bracket (Illinois)
        if exactly:
            probe_exactly(piece, work, h, fraction)
        else:
            probe(piece, work, h, fraction)
        evaluate_events(piece, work.probe, work.probe_rate, summit)
        before = fraction
        if summit.slope[row] < 0.0:
            high, high_slope = fraction, summit.slope[row]
            low_slope *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, low_slope = fraction, summit.slope[row]
            high_slope *= 0.5 if side < 0 else 1.0
            side = -1
        fraction = (low * high_slope - high * low_slope) / (high_slope - low_slope)
        if not low < fraction < high:
            fraction = 0.5 * (low + high)
        gain = fabs(h * summit.slope[row] * (fraction - before))
        if exactly and gain <= max(1e-4 * piece.tolerance, 1e-14) * fabs(summit.height[row]):
            return before
        if not exactly and fabs(fraction - before) <= 1e-6:
            exactly = True
            low, low_slope, high, high_slope, side = 0.0, start.slope[row], 1.0, end.slope[row], 0
    return before


cdef double cubic_zero(double start, double start_slope, double end, double end_slope) noexcept nogil:
    """Estimate the zero in (0, 1) of a cubic with these values and slopes at 0 and 1. The values differ in sign."""
    cdef double f, tangent, a = 3.0 * (end - start) - 2.0 * start_slope - end_slope
    cdef double b = start_slope + end_slope - 2.0 * (end - start), t = start / (start - end)
    for _ in range(3):
        f = start + t * (start_slope + t * (a + t * b))
        tangent = start_slope + t * (2.0 * a + 3.0 * t * b)
        if tangent == 0.0:
            break
        t -= f / tangent
    return t


cdef double crossing_fraction(
    const Piece *piece, Work *work, double h, int row, const Events *start, const Events *end, double high
) noexcept nogil:
    """Find the fraction of the step, to about 1e-8, at which a row is 0. It is negative at 0 and positive at `high`."""
    cdef double low = 0.0, fraction = 0.5 * high, value, move
    cdef Events events
    if start.value[row] >= 0.0:  # because of rounding
        return 0.0
    if high == 1.0:
        fraction = cubic_zero(start.value[row], h * start.slope[row], end.value[row], h * end.slope[row])
        if work.x[ROOT] == 0.0 and (row == FORCE or row == SLIP):  # the force grows about as s^3
            fraction = cbrt(start.value[row] / (start.value[row] - end.value[row]))
    for _ in range(60):
        if not low < fraction < high:
            fraction = 0.5 * (low + high)
        probe(piece, work, h, fraction)
        evaluate_events(piece, work.probe, work.probe_rate, &events)
        value = events.value[row]
        move = -value / (h * events.slope[row])
        if fabs(move) <= 1e-4:  # the error of Newton's method is about the square of this
            return min(max(fraction + move, 0.0), high)
        if value > 0.0:
            high = fraction
        else:
            low = fraction
        fraction += move
        if high - low <= 1e-12:
            break
    return high


cdef double inflection_fraction(const Work *work, double h) noexcept nogil:
    """Return the fraction of a flight's step where the gap may shrink, though it grows at both ends; 1: nowhere."""
    cdef double w0 = work.x[RATE], w1 = work.trial[RATE], bend0 = h * work.rate[RATE], bend1 = h * work.trial_rate[RATE]
    cdef double fraction
    if w0 > 0.0 or w1 > 0.0 or not bend0 > 0.0 > bend1 or w0 + bend0 <= 0.0:
        return 1.0
    fraction = extremum(w0, bend0, w1, bend1)
    return fraction if fraction < 0.999 and on_cubic(fraction, w0, bend0, w1, bend1) > 0.0 else 1.0


cdef double step_onto_event(
    const Piece *piece, Work *work, const Finding *found, double tried, double *error
) noexcept nogil:
    """Take a step that ends on `found`, an event in a step of length `tried`; return the new length; set `error`."""
    cdef double h = found.fraction * tried, low = 0.0, high = found.within * tried, off
    cdef int row = found.event
    cdef Events events
    cdef int i
    error[0] = 0.0
    if h == 0.0:
        memcpy(work.trial, work.x, sizeof(work.x))
        memcpy(work.trial_rate, work.rate, sizeof(work.x))
        return 0.0
    for _ in range(60):  # Newton's method on full steps: the event is on the computed motion, not on a polynomial
        error[0] = attempt(piece, work, h)
        evaluate_events(piece, work.trial, work.trial_rate, &events)
        off = -events.value[row] / events.slope[row]
        if fabs(off) <= 1e-7 * h:
            for i in range(piece.width):  # extrapolate linearly from h to h + off
                work.trial[i] += off * work.trial_rate[i]
            return h + off
        if events.value[row] > 0.0:
            high = h
        else:
            low = h
        if high - low <= 1e-14 * tried:
            return h
        h = h + off if low < h + off < high else 0.5 * (low + high)
    return h
