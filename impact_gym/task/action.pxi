"""Convert the numbers of an action from [-1, 1] to SI units."""


cdef struct ActionEntry:  # one number of the action
    double low, high  # values at -1 and at 1, in the number's unit
    double resolution  # the value is rounded to a multiple of this; 0: not rounded


cdef double decoded(const ActionEntry *entry, double action) noexcept nogil:
    """Return the value of one number; `action` is the scaled value, which is clipped to [-1, 1]."""
    cdef double value = entry.low + 0.5 * (min(1.0, max(-1.0, action)) + 1.0) * (entry.high - entry.low)
    return rint(value / entry.resolution) * entry.resolution if entry.resolution > 0.0 else value
