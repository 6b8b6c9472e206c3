# cython: language_level=3, boundscheck=False, wraparound=False, initializedcheck=False, cdivision=True, cpow=True
"""The kernels with entries for tests: closed forms of flight, and one step of each method."""

include "../../impact_gym/kernels.pyx"


def drift_once(law, chain, double acceleration, double time):
    """Move `chain` (1, CHAIN) through `time` (s) of flight in closed form under a `law` (1, LAW)."""
    cdef Run run
    run.law, run.ground = <const Law *> memory_of(law), 0.0
    drift(&run, <Chain *> memory_of(chain), acceleration, time)


def first_touch(law, chain, double acceleration, double horizon):
    """Time (s) until `chain` (1, CHAIN) touches under a `law` (1, LAW); inf if not within `horizon` (s)."""
    cdef Run run
    run.law, run.ground = <const Law *> memory_of(law), 0.0
    return touch_time(&run, <const Chain *> memory_of(chain), acceleration, horizon)


def never_touches(law, chain):
    """Whether `chain` certainly never touches again while the imposed motion rests; without a robot."""
    cdef Run run
    run.law, run.tables, run.ground = <const Law *> memory_of(law), NULL, 0.0
    return cannot_touch(&run, <const Chain *> memory_of(chain))


def energy_and_reach(law, double stretch, double kinetic):
    """Energy of a coupling (J), and a bound on its later stretch (m) with a `kinetic` energy (J)."""
    cdef const Law *given = <const Law *> memory_of(law)
    return coupling_energy(given, stretch), coupling_reach(given, stretch, kinetic)


BLIND = 10.0, 1e-4  # longest and shortest blind step, scaled


def step_once(plan, table, chain, double acceleration, bint flying, x, double h, str method):
    """Try a step of `h` from the scaled state `x` of a piece that begins at `chain`; return a dict of arrays.

    Args:
        plan, table, chain: one approach, its robot's table, and a row whose `units` are set if it is in contact.
        acceleration: of the flange, m/s^2.
        flying: whether in flight; otherwise in contact.
        x: state (n,), as long as the chain's.
        h, method: length and method of the step: "explicit", "stiff" or "series".
    """
    cdef Run run
    cdef Work work
    cdef Piece now
    cdef Law law
    cdef const Approach *given = <const Approach *> memory_of(plan)
    cdef const Contact *contact
    cdef Events events
    cdef double error
    cdef int i, j
    law_to_kernel(&given.mount, &law)
    run.law, run.tables = &law, <const double *> memory_of(table)
    contact = &given.contact
    run.contact = contact_of(contact.stiffness, contact.nominal, contact.m, contact.n, contact.reference)
    run.object_mass, run.threshold, run.tolerance = given.object_mass, given.threshold, 1.0
    run.ground = STANDARD_GRAVITY * given.friction
    begin_piece(&run, <const Chain *> memory_of(chain), acceleration, INFINITY, flying, &now)
    memset(work.x, 0, sizeof(work.x))
    memcpy(work.x, memory_of(x), now.width * sizeof(double))
    rates(&now, work.x, work.rate)
    work.method = {"explicit": EXPLICIT, "stiff": STIFF, "series": SERIES}[method]
    memset(&events, 0, sizeof(events))
    evaluate_events(&now, work.x, work.rate, &events)
    result = {
        "height": [events.height[i] for i in range(CLAMP, ROWS)],
        "slope": [events.slope[i] for i in range(CLAMP, ROWS)],
    }
    if now.analytic:
        expand(&now, &work)
        result["fastest"] = fastest(&now, work.x, work.rate)
    error = attempt(&now, &work, h)
    result |= {
        "rate": [work.rate[i] for i in range(now.width)],
        "end": [work.trial[i] for i in range(now.width)],
        "error": error,
    }
    probe(&now, &work, h, 0.5)
    result["middle"] = [work.probe[i] for i in range(now.width)]
    result["blind"] = longest_blind_step(&now, work.x, BLIND[0], BLIND[1]) if flying else 0.0
    jacobian(&now, work.x, work.matrix)
    result["jacobian"] = [[work.matrix[i][j] for j in range(now.width)] for i in range(now.width)]
    return {name: np.array(value) for name, value in result.items()}
