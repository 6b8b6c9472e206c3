"""Mass, stiffness and damping of a compliant robot (paper, eq. 8 and 16), from a table over the imposed position.

The imposed position is where the flange of a rigid robot would be. Between two breaks of the table, the parameters
are cubic polynomials; outside the table they are constant. A table of constant parameters has one long interval.
"""


cdef struct RobotTable:
    const double *breaks  # positions (n + 1,), m
    const double *coefficients  # (n, 3, 4): of mass, stiffness, damping, for the powers 0 to 3 of x - breaks[i]
    int64_t intervals  # n; 0 if the robot is rigid


cdef struct RobotNow:
    double mass, stiffness, damping  # kg, N/m, N s/m: m_r, k_r, c_r
    double mass_slope  # kg/m, derivative of the mass with respect to the imposed position


cdef struct RobotSlopes:  # more derivatives of the parameters with respect to the imposed position
    double stiffness, damping  # N/m^2, N s/m^2
    double mass_bend  # kg/m^2, second derivative of the mass


cdef inline int interval_at(const RobotTable *table, double position, double direction) noexcept nogil:
    """Return the index of the interval at `position` (m); -1 before the first break, n after the last."""
    cdef int index = -1
    cdef double near = 1e-9 * (table.breaks[table.intervals] - table.breaks[0])
    position += copysign(near, direction)  # at a break (up to rounding), choose the interval in `direction`
    while index < table.intervals and table.breaks[index + 1] < position:
        index += 1
    return index


cdef inline (double, double) robot_bounds(const RobotTable *table, int index) noexcept nogil:
    """Return where interval `index` begins and ends, m."""
    return (
        table.breaks[index] if index >= 0 else -INFINITY,
        table.breaks[index + 1] if index < table.intervals else INFINITY,
    )


cdef inline double table_offset(const RobotTable *table, int index, double position, int *interval) noexcept nogil:
    """Limit `position` to the table; set `interval` to its interval i, and return its distance (m) from breaks[i]."""
    cdef int i = min(max(index, 0), <int> table.intervals - 1)
    interval[0] = i
    if index == i:
        return position - table.breaks[i]
    return 0.0 if index < 0 else table.breaks[i + 1] - table.breaks[i]


cdef inline RobotNow robot_within(const RobotTable *table, int index, double position) noexcept nogil:
    """Return the robot's parameters at an imposed `position` (m), by the polynomials of interval `index`."""
    cdef RobotNow robot
    cdef int i
    cdef double u = table_offset(table, index, position, &i)
    cdef const double *m = table.coefficients + 12 * i
    cdef const double *k = m + 4
    cdef const double *c = m + 8
    robot.mass = ((m[3] * u + m[2]) * u + m[1]) * u + m[0]
    robot.stiffness = ((k[3] * u + k[2]) * u + k[1]) * u + k[0]
    robot.damping = ((c[3] * u + c[2]) * u + c[1]) * u + c[0]
    robot.mass_slope = (3.0 * m[3] * u + 2.0 * m[2]) * u + m[1] if index == i else 0.0
    return robot


cdef RobotSlopes robot_slopes(const RobotTable *table, int index, double position) noexcept nogil:
    """Return the other derivatives of the parameters at an imposed `position` (m), in interval `index`."""
    cdef RobotSlopes slopes = RobotSlopes(0.0, 0.0, 0.0)
    cdef int i
    cdef double u = table_offset(table, index, position, &i)
    cdef const double *m = table.coefficients + 12 * i
    cdef const double *k = m + 4
    cdef const double *c = m + 8
    if index == i:
        slopes.stiffness = (3.0 * k[3] * u + 2.0 * k[2]) * u + k[1]
        slopes.damping = (3.0 * c[3] * u + 2.0 * c[2]) * u + c[1]
        slopes.mass_bend = 6.0 * m[3] * u + 2.0 * m[2]
    return slopes


cdef inline RobotNow robot_at(const RobotTable *table, double position) noexcept nogil:
    """Return the robot's parameters at an imposed `position` (m)."""
    return robot_within(table, interval_at(table, position, 1.0), position)
