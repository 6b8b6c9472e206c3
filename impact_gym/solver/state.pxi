"""The structures of the solver; some of them also exist as NumPy data types, see `kernels.pyx`."""

cpdef enum:
    RIGID, SPRING, INTEGRATED  # kinds of chain: tool with imposed motion; one mass on a spring and damper; other

cpdef enum:
    ARRIVED = 0  # the requested time is reached
    DETECTED = 1  # the contact force exceeds the threshold for the first time
    TOUCHED = 2  # a contact begins
    PARTED = 3  # the contact has ended
    SWITCHED = 4  # another event ended a piece of the motion, see `conclude`
    UNSETTLED = 5  # the simulation after an episode reached its time limit, but contacts were still possible
    STEP_LIMIT = -1  # more integration steps, or searched intervals of a flight, than allowed
    NOT_FINITE = -2  # a state became inf or nan, a step too short, or rounding errors too large


cpdef enum:
    DIRECT, SPRING_DAMPER, MECHANISM  # couplings
    STIFF_ROBOT, LUMPED, TABLE_OF_POSITION  # robots


cpdef enum:
    SLIDING, STUCK  # states of the object


cdef struct Mount:  # tool mass, coupling and robot, as a user describes them
    int64_t coupling_kind, robot_kind
    double tool_mass  # kg
    CouplingNumbers coupling  # numbers that this kind does not have are 0
    RobotNumbers robot  # only of a LUMPED robot
    int64_t table, intervals  # of a TABLE_OF_POSITION, as in `Law`
    double stiffest


cdef struct Interval:  # a robot table of one interval
    double begin, end  # m
    double[4] mass, stiffness, damping  # coefficients of cubic polynomials


cdef struct Law:  # the simplest chain equivalent to the mount
    int64_t kind  # RIGID, SPRING or INTEGRATED
    double tool_mass  # kg; in a SPRING chain it includes the robot mass that moves with the tool
    double frequency  # rad/s, omega of a SPRING chain
    double damping_ratio  # -, zeta of a SPRING chain
    int64_t coupled  # of an INTEGRATED chain: 1 if a spring couples tool and flange, 0 if they are one mass
    int64_t with_tool  # 1 with a compliant robot and a DIRECT coupling: the flange moves with the tool
    int64_t bistable  # 1 if the coupling is a mechanism
    int64_t stops  # 1 if the coupling has stops; then `mechanism` has its spring, linear or not
    double stiffness  # N/m, of a spring and damper
    double damping  # N s/m, of a spring and damper
    Mechanism mechanism
    int64_t table  # where the robot's table begins among the numbers of all tables; -1 if it is `lumped`
    int64_t intervals  # of that table; 0 if the robot is rigid
    Interval lumped
    double stiffest  # 1/s^2, largest k_r / m_r at the breaks of the table


cdef struct Memory:  # step control of a contact or a flight, kept between steps
    double step  # next trial step
    int64_t method  # of the next step: EXPLICIT or STIFF
    int64_t seen  # attempts by this method; after `patience` explicit attempts, only those near the limit of stability
    int64_t patience  # attempts before stiffness is checked
    int64_t rejected  # 1 if the last attempt was rejected
    double log_before  # log of the last accepted error of the explicit pair, at least -9


cdef struct Chain:  # state of motion, and results so far
    double time  # s
    double flange_position  # m, of the imposed motion; with a rigid robot also of the flange
    double flange_velocity  # m/s, of the imposed motion
    double deflection  # m, tool minus imposed motion
    double deflection_rate  # m/s
    double penetration  # m, position of the tool's face minus that of the object's face; at most 0 in flight
    double penetration_rate  # m/s
    double flange_offset  # m, flange minus imposed motion; nonzero only with a compliant robot and an elastic coupling
    double flange_offset_rate  # m/s
    int64_t pressed  # which stop pushes: 1 front, -1 rear, 0 none
    int64_t side  # on which side of its alignment the slider of a mechanism is: 1 front, -1 rear
    int64_t object_state  # SLIDING or STUCK; without friction always SLIDING

    # the present contact
    int64_t touching  # 0 or 1
    int64_t holding  # 0 while the contact force is kept at 0, because it would be a pull; else 1
    Units units
    double start  # s, start of the contact; fields named start_... are values at this time
    double approach_velocity  # m/s
    double start_tool_velocity  # m/s
    double start_object_velocity  # m/s
    double start_deflection  # m
    double start_flange_position  # m
    double damping  # -, damping factor
    double impulse  # N s, on the object
    double ground_impulse  # N s, of the friction of the ground on the object
    double deflection_integral  # m s
    double pull_impulse  # N s, of the coupling on the tool, in an INTEGRATED chain
    double joined  # N s, momentum of robot mass that has joined the moving part, see `integrated.pxi`
    double contact_peak_force  # N
    Memory memory

    # results so far
    int64_t contacts
    double first_contact  # s, inf if none yet
    double detection  # s, when the contact force first exceeded the threshold; inf if not yet
    double peak_force  # N
    double peak_object_velocity  # m/s, with friction
    double object_rest_time  # s, when the object last came to rest
    double tool_rest_time  # s, since when the tool counts as at rest; inf: not at rest, or no friction
    double slide  # m, with friction: distance from the object's first to its last position
    double rest_time  # s, with friction: when object and tool are both at rest; inf if the tool is not
    double unread_force  # N, largest contact force since the last call of `take_peak`
    double coupling_impulse  # N s, sum over the recorded contacts (paper, eq. 21)
    double momentum_error  # -, largest of the recorded contacts (paper, eq. 20)
    int64_t steps  # integration steps, rejected ones included
    int64_t logged  # rows of the contact log, including those that did not fit
    int64_t traced  # rows of the trace, including those that did not fit
    int64_t snaps  # passages of the slider through its alignment, including those that did not fit
    int64_t status  # 0 if an approach ran to its end, else the status that ended it
    double final_object_velocity, final_tool_velocity, final_flange_velocity  # m/s, at the end of an approach


cdef struct ContactRow:
    double start, end  # s; the end of an unfinished contact is nan
    double approach_velocity, separation_velocity  # m/s
    double peak_force  # N
    double impulse  # N s, on the object
    double object_velocity  # m/s, at the end of the contact
    double coupling_impulse  # N s, on the tool (paper, eq. 21)
    double momentum_error  # -, residual of the momentum balance (paper, eq. 20) / impulse


cdef struct TraceRow:
    double time  # s
    double flange_position, flange_velocity  # m, m/s
    double tool_position, tool_velocity
    double object_position, object_velocity
    double contact_force, coupling_force  # N, on the object and on the tool
    double command_position, command_velocity  # of the imposed motion


cdef struct Recorder:  # arrays for contacts and trace; empty ones record nothing
    ContactRow *contacts
    TraceRow *trace
    double *snaps  # s, times at which a slider passes its alignment
    int64_t contact_rows, trace_rows, snap_rows
    double interval  # s, largest time between two points of a trace in flight


cdef extern from "solver/taylor.h" nogil:
    enum:
        ORDER, PLACES  # highest order and number of components of a series

    ctypedef struct Polynomial:
        double held, damping, share, ground, tool_share, push, pull_y, pull_y_dot

    void expand_polynomial(const Polynomial *law, const double *x, double[PLACES] *series)


cdef enum:
    WIDTH = 10  # number of components of the longest scaled state
    KEPT = 8  # number of kept stages: rates of stages 5 to 11 for dense output, or all stages of a stiff step


cdef struct Work:  # work arrays of the integrator
    double[WIDTH] x, rate  # the state at the start of a step
    double[WIDTH] trial, trial_rate  # the state at the end of the step that is tried
    double[WIDTH] probe, probe_rate  # a state within the step
    double[WIDTH] late  # the state at the last stage but one
    double[KEPT][WIDTH] stage
    double[7][WIDTH] dense  # polynomial through the step
    bint dense_known
    double[ORDER + 1][PLACES] series  # Taylor coefficients of the state at `x`
    bint expanded  # whether `series` is known
    double longest  # longest step for which `series` is accurate; 0: none
    double[WIDTH][WIDTH] matrix
    int method  # method of the present step
    Memory memory


cdef struct Run:  # what the functions of the solver need in a run
    const Law *law
    const double *tables  # numbers of all tables
    Contact contact
    double object_mass  # kg
    double ground  # m/s^2, mu g, deceleration of an object that slides; 0 without friction
    double threshold  # N, of the contact alarm or the brake; inf: none
    bint tell_touch  # whether `command` returns at the first touch
    double tolerance  # -, local error allowed in a step, in the piece's units
    int64_t max_steps
    Recorder recorder
    Work *work


cdef inline RobotTable robot_table(const Run *run) noexcept nogil:
    cdef RobotTable table
    table.intervals = run.law.intervals
    table.breaks = <const double *> &run.law.lumped if run.law.table < 0 else run.tables + run.law.table
    table.coefficients = table.breaks + table.intervals + 1
    return table
