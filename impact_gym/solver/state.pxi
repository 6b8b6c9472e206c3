"""The structures of the solver; some are also NumPy types (`kernels.pyx`). A chain is robot, coupling and tool."""

cpdef enum:  # kinds of chain; rigid: the tool has the imposed motion; spring: one mass on a spring and damper;
    RIGID_CHAIN, SPRING_CHAIN, INTEGRATED_CHAIN  # integrated: every other chain, whose flights have no closed form

cpdef enum:
    ARRIVED = 0  # the requested time is reached
    DETECTED = 1  # the contact force exceeded the threshold for the first time, less than `Run.reaction` ago
    TOUCHED = 2  # a contact begins
    PARTED = 3  # the contact has ended
    SWITCHED = 4  # another event ended a piece of the motion, see `conclude` in `integrate.pxi`
    UNSETTLED = 5  # the simulation after an episode ran out of time: a contact lasts or can still follow
    STEP_LIMIT = -1  # more than `max_steps` integration steps, or a flight needs more than MOST_BENDS intervals
    NOT_FINITE = -2  # the state became inf or nan, a step became too short, or rounding errors became too large


cpdef enum:
    RIGID, SPRING_DAMPER, BISTABLE  # kinds of coupling
    RIGID_ROBOT, ROBOT, ROBOT_TABLE  # kinds of robot: none (rigid), `Robot`, `RobotTable`


cpdef enum:
    SLIDING, STUCK  # states of the object on the ground


cdef struct Mount:  # tool mass, coupling and robot, as a user describes them
    int64_t coupling_kind, robot_kind
    double tool_mass  # kg
    CouplingNumbers coupling  # numbers that a coupling of this kind does not have are 0
    RobotNumbers robot  # only of a ROBOT
    int64_t table, intervals  # of a ROBOT_TABLE, as in `ChainModel`
    double stiffest  # as in `ChainModel`


cdef struct Interval:  # a table of the robot's parameters with one interval, see `robot.pxi`
    double begin, end  # m
    double[4] mass, stiffness, damping  # SI units, coefficients for the powers 0 to 3 of (position - `begin`)


cdef struct ChainModel:  # the simplest chain that is equivalent to a mount
    int64_t kind  # RIGID_CHAIN, SPRING_CHAIN or INTEGRATED_CHAIN
    double tool_mass  # kg, mass of the tool; in a spring chain with a ROBOT, mass of robot and tool
    double frequency  # rad/s, undamped angular frequency of a spring chain
    double damping_ratio  # -, of a spring chain
    int64_t coupled  # 0: in an integrated chain, tool and flange of a compliant robot are one mass; else 1
    int64_t with_tool  # 1: the robot is compliant and the coupling is rigid, so the flange moves with the tool
    int64_t bistable  # 1: the coupling is a bistable mechanism
    int64_t stops  # 1: the coupling has stops; then `mechanism` describes the whole coupling, linear or not
    double stiffness, damping  # N/m, N s/m, of a SPRING_DAMPER coupling, or of the robot in a spring chain; else 0
    Mechanism mechanism
    int64_t table  # index of the robot's table in `Run.tables`; -1: the table is the field `lumped`
    int64_t intervals  # number of intervals of the table in an integrated chain; 0: the robot is rigid
    Interval lumped
    double stiffest  # 1/s^2, largest ratio of the robot's stiffness to its mass at any end of an interval of the table


cdef struct Memory:  # state of the step control in a contact or a flight, kept from step to step
    double step  # length of the next step to try in a contact, in the variable s, see `contact.pxi`
    int64_t method  # STIFF: the L-stable pair; EXPLICIT: a Taylor series or the explicit pair, see `stepper.pxi`
    int64_t attempts  # by `method`; once stiffness is checked, only EXPLICIT ones near instability count
    int64_t attempts_before_check  # number of EXPLICIT attempts before stiffness is checked
    int64_t rejected  # 1: the error of the last explicit attempt was too large
    double log_before  # natural logarithm of estimated / allowed error in the last accepted explicit step, at least -9


cdef struct Chain:  # state of motion of chain and object, and results so far
    double time  # s
    double flange_position  # m, position of the imposed motion, which the flange of a rigid robot follows exactly
    double flange_velocity  # m/s, of the imposed motion
    double deflection  # m, tool position minus imposed position
    double deflection_rate  # m/s
    double penetration  # m, position of the tool's face minus that of the object's face; at most 0 in flight
    double penetration_rate  # m/s
    double flange_offset  # m, flange minus imposed position, for an elastic coupling on a compliant robot; else 0
    double flange_offset_rate  # m/s
    int64_t pressed  # which stop pushes: 1 front, -1 rear, 0 none
    int64_t side  # on which side of its alignment the slider of a mechanism is: 1 front, -1 rear
    int64_t object_state  # SLIDING or STUCK; without friction always SLIDING

    # the present contact
    int64_t touching  # 0 or 1
    int64_t force_active  # 0 while the contact force is kept at 0, because it would be a pull; else 1
    Units units  # natural units of the contact, see `contact.pxi`
    double start  # s, start of the contact; fields named start_... are values at this time
    double approach_velocity  # m/s
    double start_tool_velocity  # m/s
    double start_object_velocity  # m/s
    double start_deflection  # m
    double start_flange_position  # m
    double damping  # -, damping factor
    double impulse  # N s, of the contact force on the object, so far
    double ground_impulse  # N s, backward impulse of the ground's friction on the object
    double deflection_integral  # m s, time integral of the deflection, in analytic pieces
    double pull_impulse  # N s, time integral of `Accelerations.pull`, in general pieces
    double joined  # N s, momentum of robot mass that has joined the moving part, see `general.pxi`
    double contact_peak_force  # N, largest contact force so far
    Memory memory

    # results so far
    int64_t contacts
    double first_contact  # s, start of the first contact; inf: none yet
    double detection  # s, when the contact force first exceeded `Run.threshold`; inf if not yet
    double peak_force  # N, largest force of all contacts
    double peak_object_velocity  # m/s, so far; without friction 0, until `run_approach` sets it to the final velocity
    double object_rest_time  # s, when the object last came to rest; 0: never
    double tool_rest_time  # s, time from which the tool counts as at rest; inf: not at rest, or no friction
    double slide  # m, with friction: distance from the object's first position to its rest, as if no contact followed
    double rest_time  # s, with friction: time from which both object and tool are at rest; inf if the tool is not
    double unread_force  # N, largest contact force since the last call of `take_peak`
    double coupling_impulse  # N s, of the coupling on the tool (paper, eq. 21), sum over the contacts in `logged`
    double momentum_error  # -, largest `momentum_error` (see `ContactRow`) of the contacts that `logged` counts
    int64_t steps  # integration steps, rejected ones included
    int64_t logged  # number of contacts given to the contact log, including those that did not fit
    int64_t traced  # number of trace points, including those for which the array was full
    int64_t snaps  # passages of the slider through its alignment, including those for which the array was full
    int64_t status  # 0: the approach lasted to its end; negative: status that ended it earlier
    double final_object_velocity, final_tool_velocity, final_flange_velocity  # m/s, at the end of an approach


cdef struct ContactRow:
    double start, end  # s; the end of an unfinished contact is nan
    double approach_velocity, separation_velocity  # m/s
    double peak_force  # N
    double impulse  # N s, of the contact force on the object
    double object_velocity  # m/s, at the end of the contact or of the run
    double coupling_impulse  # N s, on the tool (paper, eq. 21)
    double momentum_error  # -, ratio of the residual of the momentum balance (paper, eq. 20) to `impulse`


cdef struct TraceRow:
    double time  # s
    double flange_position, flange_velocity  # m, m/s
    double tool_position, tool_velocity
    double object_position, object_velocity
    double contact_force, coupling_force  # N: force of the contact on the object, force of the coupling on the tool
    double command_position, command_velocity  # m, m/s, of the imposed motion


cdef struct Recorder:  # arrays for contacts, trace points and passages of the alignment; an empty array records nothing
    ContactRow *contacts
    TraceRow *trace
    double *snaps  # s, times at which a slider passes its alignment
    int64_t contact_rows, trace_rows, snap_rows  # lengths of the three arrays
    double interval  # s, largest time between two successive trace points of a flight


cdef extern from "solver/taylor.h" nogil:
    enum:
        ORDER, COMPONENTS  # highest order of a Taylor series, number of its components

    ctypedef struct Polynomial:
        double active, damping, share, ground, tool_share, push, pull_y, pull_y_dot

    void expand_polynomial(const Polynomial *given, const double *x, double[COMPONENTS] *series)


cdef enum:
    WIDTH = 10  # number of components of the longest scaled state
    KEPT = 8  # largest number of stored stages: 7 of an explicit step (for its polynomial), 8 of a stiff step


cdef struct Work:  # work arrays of the integrator
    double[WIDTH] x, rate  # state at the start of a step, and its derivative
    double[WIDTH] trial, trial_rate  # state at the end of the step that is tried, and its derivative
    double[WIDTH] probe, probe_rate  # state within the step, and its derivative
    double[WIDTH] late  # state at the last stage but one of an explicit step
    double[KEPT][WIDTH] stage
    double[7][WIDTH] dense  # polynomial through an explicit step, in the form of `on_polynomial`
    bint dense_known
    double[ORDER + 1][COMPONENTS] series  # Taylor coefficients of the state at `x`
    bint expanded  # whether `series` is known
    double longest  # longest step for which `series` is accurate; 0: none
    double[WIDTH][WIDTH] matrix
    int method  # method of the present step: EXPLICIT, STIFF or SERIES
    Memory memory


cdef struct Run:  # what the functions of the solver need in a run
    const ChainModel *model
    const double *tables  # tables of robots, motions, recorded commands and delays, one after another
    Contact contact
    double object_mass  # kg
    double ground  # m/s^2, mu g, deceleration of an object that slides; 0 without friction
    double threshold  # N, contact force that sets `Chain.detection` when it is first exceeded; inf: none
    double reaction  # s, from the detection to the next change of the imposed motion; 0: stop at the detection
    bint tell_touch  # whether `command` returns at the first touch
    double tolerance  # -, allowed local error of a step: absolute in natural units, but relative for components above 1
    int64_t max_steps
    Recorder recorder
    Work *work


cdef inline RobotTable robot_table(const Run *run) noexcept nogil:
    """Return the robot's table; it has no intervals if the robot is rigid or in a spring chain."""
    cdef RobotTable table
    table.intervals = run.model.intervals
    table.breaks = <const double *> &run.model.lumped if run.model.table < 0 else run.tables + run.model.table
    table.coefficients = table.breaks + table.intervals + 1
    return table
