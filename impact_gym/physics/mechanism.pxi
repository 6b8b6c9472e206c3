"""Forces and energies of a coupling with stops: a bistable mechanism (paper, Fig. 21), or a linear spring and damper.

The tool is fixed to a slider. A mechanism's spring connects the slider to a pivot at height H above the slider's path.
The slider's position x is measured from the alignment, where this spring is vertical and does not push along the path.
The coupling's stretch is x - `rest`. A stop is a linear spring and damper that never pulls.
"""

cdef enum:
    FREE = 0, FRONT = 1, REAR = -1  # which stop pushes on the slider; FREE: none


cdef struct Mechanism:
    double stiffness  # N/m, k
    double free_length  # m, L0
    double height  # m, H
    double rest  # m, position of the slider at rest; 0 if linear
    double front_stop  # m, position of the front stop
    double rear_stop  # m, position of the rear stop
    double stop_stiffness  # N/m
    double stop_damping  # N s/m
    int64_t linear  # 1: linear, with the force -k x - c x_dot; 0: bistable mechanism
    double damping  # N s/m, c, only if linear


cpdef inline double bistable_force(double stiffness, double free_length, double height, double x) noexcept nogil:
    """Return the spring's force along the path, N: k (L0 - L) x / L, with L = sqrt(H^2 + x^2) (paper, eq. 23-24)."""
    return stiffness * (free_length / sqrt(height * height + x * x) - 1.0) * x


cdef inline double spring_slope(const Mechanism *law, double x) noexcept nogil:
    """Return the derivative of the spring's force by x, N/m: k (L0 H^2 / L^3 - 1) for a mechanism, -k if linear."""
    cdef double L
    if law.linear:
        return -law.stiffness
    L = sqrt(law.height * law.height + x * x)
    return law.stiffness * (law.free_length * law.height * law.height / (L * L * L) - 1.0)


cpdef inline double bistable_energy(double stiffness, double free_length, double height, double x) noexcept nogil:
    """Return the energy of a mechanism's spring at the slider's position x (m), J."""
    cdef double squeeze = free_length - sqrt(height * height + x * x)
    return 0.5 * stiffness * squeeze * squeeze


cdef inline double mechanism_pull(
    const Mechanism *law, int pressed, double stretch, double stretch_rate
) noexcept nogil:
    """Return the force on the tool, N (paper, eq. 23), from spring, damper and the stop `pressed` (FREE: no stop)."""
    cdef double pull, x = law.rest + stretch
    if law.linear:
        pull = -law.stiffness * x - law.damping * stretch_rate
    else:
        pull = bistable_force(law.stiffness, law.free_length, law.height, x)
    if pressed == FREE:
        return pull
    return pull - law.stop_stiffness * (x - stop_position(law, pressed)) - law.stop_damping * stretch_rate


cdef inline double stop_position(const Mechanism *law, int stop) noexcept nogil:
    return law.front_stop if stop == FRONT else law.rear_stop


cdef inline (double, double, double) stop_switch(
    const Mechanism *law, int stop, int pressed, double stretch, double rate, double acceleration
) noexcept nogil:
    """Return value (N), height (N) and slope (N/s), see `Events`, of the event that `stop` begins or ceases to push."""
    cdef double k = law.stop_stiffness, c = law.stop_damping
    cdef double push = stop * k * (law.rest + stretch - stop_position(law, stop)), moving = stop * rate
    if pressed == stop:  # the event: this stop would pull; its damper can do so while its spring is still compressed
        return -(push + c * moving), -(push + c * moving), -(k * moving + c * stop * acceleration)
    if pressed != FREE:  # the other stop pushes
        return -1.0, -1.0, 0.0
    return push + min(c * moving, 0.0), push, k * moving


cdef inline double stiffness_bound(const Mechanism *law) noexcept nogil:
    """Return the least upper bound of |`spring_slope`|, N/m."""
    if law.linear:
        return law.stiffness
    return law.stiffness * max(law.free_length / law.height - 1.0, 1.0)


cdef inline double spring_energy(const Mechanism *law, double x) noexcept nogil:
    """Return the energy of the spring alone at the slider's position x (m), J."""
    if law.linear:
        return 0.5 * law.stiffness * x * x
    return bistable_energy(law.stiffness, law.free_length, law.height, x)


cdef inline double mechanism_energy(const Mechanism *law, double stretch) noexcept nogil:
    """Return the energy of spring and stops, J."""
    cdef double x = law.rest + stretch
    cdef double depth = max(max(x - law.front_stop, law.rear_stop - x), 0.0)
    return spring_energy(law, x) + 0.5 * law.stop_stiffness * depth * depth


cdef inline (double, double) mechanism_floor(const Mechanism *law, int side) noexcept nogil:
    """Return a lower bound (J) of the energy on a side of the alignment, and the energy at the alignment (J)."""
    cdef double barrier = spring_energy(law, 0.0), F = law.stiffness * (law.free_length - law.height)
    if law.linear:
        return 0.0, INFINITY
    if side > 0:
        return mechanism_energy(law, 0.0), barrier
    # past the rear stop (stiffness k_s) the spring's force is below F: the energy falls there by at most F^2 / (2 k_s)
    return max(spring_energy(law, law.rear_stop) - 0.5 * F * F / law.stop_stiffness, 0.0), barrier


cdef inline double mechanism_reach(const Mechanism *law, double stretch, double kinetic) noexcept nogil:
    """Return an upper bound on the future stretch (m), from the present `stretch` and kinetic energy (J)."""
    cdef double energy = kinetic + mechanism_energy(law, stretch), free = energy - mechanism_energy(law, 0.0)
    cdef double reach = law.front_stop - law.rest + sqrt(2.0 * energy / law.stop_stiffness)  # the stop has all energy
    cdef double stiffness = law.stop_stiffness - stiffness_bound(law)  # lower bound for stop and spring together
    if law.linear:
        return min(reach, sqrt(2.0 * energy / law.stiffness))
    if law.rest + stretch < 0.0 and energy < spring_energy(law, 0.0):  # the slider stays behind the alignment
        return -law.rest
    return min(reach, sqrt(2.0 * max(free, 0.0) / stiffness)) if stiffness > 0.0 else reach
