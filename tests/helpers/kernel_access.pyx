# cython: language_level=3, boundscheck=False, wraparound=False, initializedcheck=False, cdivision=True, cpow=True
"""The kernels with entries for tests: closed forms of flight, and one step of each method."""

include "../../impact_gym/kernels.pyx"


def drift_once(model, chain, double acceleration, double time):
    """Move `chain` (1, CHAIN) through `time` (s) of flight in closed form by a `model` (1, CHAIN_MODEL)."""
    cdef Run run
    run.model, run.ground = <const ChainModel *> memory_of(model), 0.0
    drift(&run, <Chain *> memory_of(chain), acceleration, time)


def first_touch(model, chain, double acceleration, double horizon):
    """Time (s) until `chain` (1, CHAIN) touches by a `model` (1, CHAIN_MODEL); inf if not within `horizon` (s)."""
    cdef Run run
    run.model, run.ground = <const ChainModel *> memory_of(model), 0.0
    return touch_time(&run, <const Chain *> memory_of(chain), acceleration, horizon)


def never_touches(model, chain):
    """Whether `chain` certainly never touches again while the imposed motion rests; without a robot."""
    cdef Run run
    run.model, run.tables, run.ground = <const ChainModel *> memory_of(model), NULL, 0.0
    return cannot_touch(&run, <const Chain *> memory_of(chain))


def energy_and_reach(model, double stretch, double kinetic):
    """Energy of a coupling (J), and a bound on its later stretch (m) with a `kinetic` energy (J)."""
    cdef const ChainModel *given = <const ChainModel *> memory_of(model)
    return coupling_energy(given, stretch), coupling_reach(given, stretch, kinetic)


BLIND = 10.0, 1e-4  # longest and shortest blind step, scaled


def step_once(plan, table, chain, double acceleration, bint flying, x, double h, str method):
    """Try a step of `h` from the scaled state `x` of a piece that begins at `chain`; return a dict of arrays.

    Args:
        plan, table, chain: one approach, its robot's table, and a row whose `units` are set if it is in contact.
        acceleration: of the flange, m/s^2.
        flying: whether in flight; otherwise in contact.
        x: state (n,), as long as the chain's.
        h, method: length and method of the step: "explicit", "stiff" or "series". With "explicit" the equations of
            motion are those of a general piece, whatever the contact law.
    """
    cdef Run run
    cdef Work work
    cdef Piece piece
    cdef ChainModel model
    cdef const RunPlan *given = <const RunPlan *> memory_of(plan)
    cdef const Contact *contact
    cdef Events events
    cdef double error
    cdef int i, j
    pack_model(&given.mount, &model)
    run.model, run.tables = &model, <const double *> memory_of(table)
    contact = &given.contact
    run.contact = contact_of(contact.stiffness, contact.nominal, contact.m, contact.n, contact.reference)
    run.object_mass, run.threshold, run.tolerance = given.object_mass, given.threshold, 1.0
    run.ground = STANDARD_GRAVITY * given.friction
    begin_piece(&run, <const Chain *> memory_of(chain), acceleration, INFINITY, flying, &piece)
    if method == "explicit":
        piece.analytic = False
        begin_general(&run, <const Chain *> memory_of(chain), &piece)
    memset(work.x, 0, sizeof(work.x))
    memcpy(work.x, memory_of(x), piece.width * sizeof(double))
    rates(&piece, work.x, work.rate)
    work.method = {"explicit": EXPLICIT, "stiff": STIFF, "series": SERIES}[method]
    memset(&events, 0, sizeof(events))
    evaluate_events(&piece, work.x, work.rate, &events)
    result = {
        "height": [events.height[i] for i in range(CLAMP, ROWS)],
        "slope": [events.slope[i] for i in range(CLAMP, ROWS)],
    }
    if piece.analytic:
        expand(&piece, &work)
        result["fastest"] = fastest(&piece, work.x, work.rate)
    error = attempt(&piece, &work, h)
    result |= {
        "rate": [work.rate[i] for i in range(piece.width)],
        "end": [work.trial[i] for i in range(piece.width)],
        "error": error,
    }
    probe(&piece, &work, h, 0.5)
    result["middle"] = [work.probe[i] for i in range(piece.width)]
    result["blind"] = longest_blind_step(&piece, work.x, BLIND[0], BLIND[1]) if flying else 0.0
    jacobian(&piece, work.x, work.matrix)
    result["jacobian"] = [[work.matrix[i][j] for j in range(piece.width)] for i in range(piece.width)]
    return {name: np.array(value) for name, value in result.items()}
