"""Events within a smooth piece of motion. Each event has a row in `Events`, negative before the event."""

cdef enum:
    CLOCK  # the piece reaches its end time
    SEPARATION  # z (see `contact.pxi`) falls below zero; with z < 0 time runs backwards, because dt = z ds
    CLAMP  # the contact force would become a pull, or would be a push again
    FORCE  # the contact force exceeds the threshold; this row also serves to find the largest force
    SLIP  # the contact force exceeds the friction of an object that sticks
    REST  # a sliding object comes to rest
    TOP  # a sliding object has its largest speed; this does not end the step
    FRONT_STOP, REAR_STOP  # the front or the rear stop begins or ceases to push
    ALIGNMENT  # the slider of a mechanism passes its alignment
    TOUCH  # the tool touches the object, which ends a flight
    ROWS  # number of rows
    NOTHING = -1  # no event
    SHORTER = -2  # no clear event: try a shorter step


cdef struct Events:
    double[ROWS] value  # negative before the event
    # height: smooth quantity whose maximum is searched; CLOCK and SEPARATION have none
    double[ROWS] height, slope  # slope: derivative of height (without height, of value) by s, in flight by scaled time


cdef void evaluate_events(const Piece *piece, const double *x, const double *rate, Events *events) noexcept nogil:
    """Compute the rows of all events of the piece, for a scaled state and its derivative."""
    cdef double z = x[ROOT], w = x[RATE]
    if piece.model.stops:
        evaluate_slider_events(piece, x, rate, events)
    if piece.flying:
        events.value[TOUCH] = events.height[TOUCH] = z
        events.slope[TOUCH] = rate[ROOT]
        return
    events.value[CLOCK], events.slope[CLOCK] = x[TIME] - piece.horizon, rate[TIME]
    events.value[SEPARATION], events.slope[SEPARATION] = -z, -rate[ROOT]
    events.value[CLAMP], events.slope[CLAMP] = unclamped_sign(piece.unclamped, z, w, rate[RATE])
    events.height[FORCE] = events.slope[FORCE] = 0.0
    if piece.contact.active != 0.0:
        events.value[CLAMP], events.slope[CLAMP] = -events.value[CLAMP], -events.slope[CLAMP]
        events.height[FORCE], events.slope[FORCE] = force_along(&piece.contact, z, w, rate[RATE])
        if z == 0.0:  # at z = 0 the computed slope may be 0 although the force rises
            events.slope[FORCE] = 1e-300
    events.height[CLAMP] = events.value[CLAMP]
    events.value[FORCE] = events.height[FORCE] - piece.threshold
    if piece.has_friction:
        evaluate_object_events(piece, x, rate, events)


cdef void evaluate_object_events(
    const Piece *piece, const double *x, const double *rate, Events *events
) noexcept nogil:
    """Compute the rows SLIP, REST and TOP of an object with friction. The row FORCE must be known."""
    cdef double push = piece.acceleration * piece.units.time / piece.units.velocity
    cdef double speed = -x[RATE], gain = push * rate[TIME] - rate[RATE]
    events.value[SLIP] = events.height[SLIP] = events.height[FORCE] - piece.friction
    events.slope[SLIP] = events.slope[FORCE]
    speed += (piece.velocity + piece.acceleration * x[TIME] * piece.units.time) / piece.units.velocity
    speed, gain = speed + x[DEFLECTION_RATE], gain + rate[DEFLECTION_RATE]
    events.value[REST] = events.height[REST] = -speed - piece.standstill
    events.slope[REST] = -gain
    events.value[TOP], events.height[TOP], events.slope[TOP] = -1.0, speed, gain
    if x[ROOT] <= 0.0:  # at z = 0 the slope is 0; at z < 0 its sign is wrong, because time runs backwards
        events.slope[TOP] = copysign(1e-300, events.value[SLIP])


cdef inline bint acts(const Piece *piece, int row) noexcept nogil:
    """Return whether the event of a row from `first_row` to before `end_row` can occur in the piece."""
    if SLIP <= row <= TOP:
        return piece.has_friction and (row == SLIP) == (piece.object_state == STUCK)
    return row != ALIGNMENT or piece.model.bistable


cdef void evaluate_slider_events(
    const Piece *piece, const double *x, const double *rate, Events *events
) noexcept nogil:
    """Compute the rows of a coupling with stops."""
    cdef const Mechanism *law = &piece.model.mechanism
    cdef double pace = rate[TIME], per_s = pace * piece.units.time
    cdef double stretch = (x[DEFLECTION] - x[OFFSET]) * piece.units.length
    cdef double speed = (x[DEFLECTION_RATE] - x[OFFSET_RATE]) * piece.units.velocity
    cdef double value, height, slope, acceleration = 0.0
    cdef int stop, row
    if pace > 0.0:
        acceleration = (rate[DEFLECTION_RATE] - rate[OFFSET_RATE]) * piece.units.velocity / per_s
    for row in range(FRONT_STOP, REAR_STOP + 1):
        stop = FRONT if row == FRONT_STOP else REAR
        value, height, slope = stop_switch(law, stop, piece.pressed, stretch, speed, acceleration)
        events.value[row], events.height[row], events.slope[row] = value, height, slope * per_s
    events.value[ALIGNMENT], events.slope[ALIGNMENT] = -piece.side * (law.rest + stretch), -piece.side * speed * per_s
    events.height[ALIGNMENT] = events.value[ALIGNMENT]
