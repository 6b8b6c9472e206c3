"""Conversion of the action from [-1, 1] to SI units. Its numbers are listed in `task/action.py`."""


cdef struct ActionEntry:  # one number of the action
    double low, high  # in its unit, at -1 and at 1
    double resolution  # in its unit, spacing of the grid to which values are rounded; 0: no grid


cdef double decoded(const ActionEntry *entry, double action) noexcept nogil:
    """Return the value of a number of the action, which is clipped to [-1, 1], in its unit."""
    cdef double value = entry.low + 0.5 * (min(1.0, max(-1.0, action)) + 1.0) * (entry.high - entry.low)
    return rint(value / entry.resolution) * entry.resolution if entry.resolution > 0.0 else value
