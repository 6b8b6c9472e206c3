"""Structures of a task and its episodes; a row is one environment of a batch. `numbers.pxi` has more structures."""


cdef struct Range:
    double low, high


cdef struct Draw:  # a number that an episode draws from a range
    int64_t index  # index of the number in `Record`
    int64_t source  # >= 0: index among the generator's uniform numbers; < 0: index in the stream of the noise seed
    int64_t by_ratio  # 1: log-uniform, 0: uniform
    double low, high


cdef struct Table:  # where a table is (n times, then n values): recorded commands, or delays of a trace
    int64_t begin, points  # `begin`: index of the first time among the numbers of all tables; `points`: number of times
    double length  # s, last time of a trace of delays, or length of each recording of commands
    double mean  # s, mean over time of a trace's delays, without lost packets


cdef struct Task:  # arguments of an environment
    double control_period  # s
    double horizon  # s, latest end of an episode with an operator, or without a force above the threshold
    double after_alarm  # s, from `alarm_time` to the end of an episode without operator; duration of a reading's alarm
    double full_deceleration  # m/s^2, of the flange after the episode, and while the operator's command is 0 or expired
    double settle_limit  # s, longest simulation after the end of an episode
    double missed_cost  # m/s, cost of an object that was not touched, or of a failed solver
    int64_t action_size
    ActionEntry[3] actions  # the first `action_size` are used
    Range velocity  # m/s, allowed velocity commands to the flange
    Record numbers  # numbers of the set-up; for a drawn number its median
    Mount mount  # tool, coupling and robot; for a drawn number its median
    int64_t first_draw, last_draw  # index of this task's first draw among all tasks' draws; 1 + index of its last
    int64_t mount_drawn  # 1: a number in `mount` is drawn
    int64_t range_sensor  # 1: with a range sensor
    int64_t alarm_by_reading  # 1: readings raise the alarm, 0: a switch does
    double force_weight  # m/s per N
    double tolerance  # allowed local error of a step of the integrator (no unit)
    int64_t exact  # 1: damping factor by `exact_damping`, 0: by `hu_guo`
    double reference_velocity  # m/s, approach velocity at which a fixed damping gives the restitution; 0: not fixed
    int64_t max_steps  # number of control steps until truncation; 0: unlimited
    int64_t operator_kind  # kind of operator; NO_OPERATOR: the controller alone commands
    Table replay, uplink, downlink  # commands, delays of uplink, delays of downlink; `points` is 0 if none are recorded


cdef struct Reading:  # of the sensors, in transit to the controller
    double time  # s, when the sensors were read
    double force  # N; with `alarm="reading"` the largest force since the previous reading
    double peak  # N, largest contact force of the episode so far
    double deflection  # m, tool minus flange position; with a rigid coupling, tool minus commanded position


cdef struct Entry:  # one number of the observation
    int64_t index  # index of the number in `Episode`
    int64_t curve  # LINEAR, LOGARITHM or LOGARITHM_OF_ONE_MORE, see `observation.pxi`
    double low, scaled_low  # scaled value = scaled_low + gain * (curve(value) - low)
    double gain


cdef struct Episode:  # drawn numbers, state and results of an episode
    Record drawn
    Sensors sensors
    Contact contact
    double alarm  # s, when the present alarm reached the controller; inf: there is no alarm
    double last_alarm  # s, when the last alarm reached the controller; inf before the first
    double next_sample  # s, time of the next reading of the sensors; inf: no reading follows
    int64_t readings_taken  # number of readings taken so far, including those that are in transit at t = 0
    int64_t readings_delivered  # number of readings delivered to the controller
    double range_error  # -, error of the newest range reading, divided by its standard deviation
    double range_time  # s, when the newest range reading at the controller was taken; -inf: none
    int64_t ranges_taken, ranges_delivered  # numbers of range readings taken and delivered; lost readings do not count
    int64_t control_steps
    int64_t terminated, truncated  # 0 or 1
    int64_t status  # 0, UNSETTLED, or the negative status of a failed solver
    Terms terms, terms_before  # sums of the unweighted reward terms: so far, and before the last control step
    Terms rewards  # m/s, sums of the weighted terms
    double object_velocity  # m/s, V_p so far (see `settle.pxi`); after termination 0 if missed, or if the solver failed
    double approach_time  # s, time of the first contact; the horizon if there is none yet
    double slide, rest_time  # m, s, see `Chain`; inf without friction, and before the episode terminates
    double done_time  # s, end of the last control step so far
    double withheld_share  # ratio of `withheld_way` to `commanded_way` so far, see `Link`
    double stop_delay  # s, mean delays of both channels + the reaction time of the operator's model


cdef struct Packet:  # a command, and the packet that the arm sends to the display at the same time
    double sent, arrives  # s, when the command is sent, and when it arrives; inf: lost
    double command  # m/s, of the operator
    double position  # m, flange position when the packet was sent
    double displayed  # s, when the display shows `position`; inf: lost, or no packet was sent to the display


cdef struct Command:  # to the flange
    double velocity, acceleration  # m/s, m/s^2


cdef struct Link:  # operator, channels and assistance of a row
    double command  # m/s, newest command of the operator that has arrived
    double sent  # s, when `command` was sent; negative before the first
    double next_sent, next_arrival  # s, when the next regular command is sent, and when the next command arrives
    double expires  # s, when `command` becomes too old
    double idle_since  # s, when `command` last changed to 0; inf: `command` is not 0, or has always been 0
    double stop  # s, when a model of an operator stops because of a touch; inf: not known yet
    double seen_position  # m, flange position in the newest packet that the operator has seen
    double alarmed  # s, when the last alarm reached the controller; -inf before the first
    double believed  # m, assumed distance of the object
    double duration  # s, duration of the operator's motion, if the operator is a `Reach`
    double muscle, tremor  # -, motor noise after the first and after both muscle lags, see MUSCLE in `operator.pxi`
    double last_sent, effective  # m/s; `last_sent`: last command sent, `effective`: `command`, or 0 if it has expired
    double person_command  # m/s, what a `Person` commands
    double gain, acceleration, withdrawal  # of the assistance: -, m/s^2, m/s
    double commanded_way, withheld_way  # m, time integrals until the touch: |effective|, |effective - executed|
    double age_mean, age_squares  # s, s^2: mean age of used commands on arrival, sum of the squares of (age - mean)
    # counts: `packets` sent, `arrived` used, `ticks` sent regularly; `oldest`: index of the oldest usable command
    int64_t packets, oldest, arrived, ticks
    int64_t display_packets, seen_packet  # number of packets sent to the display; index of the newest `Packet` seen
    int64_t expired, stopped  # 0 or 1: `command` has expired; the operator has stopped
    int64_t uplink_lost, downlink_lost  # 0 or 1: result of `is_lost` for the channel's last packet


cdef struct RangeReading:  # of the range sensor, in transit to the controller
    double time  # s, when the gap was read
    double gap  # m, with its error


cdef struct Row:  # one environment
    const Task *task
    Chain *chain
    Episode *episode
    Reading *readings  # ring buffer of length `slots`
    int64_t slots
    const Entry *entries  # of the observation, `length` entries
    int64_t length
    float *observation
    Link *link  # only with an operator
    Packet *packets  # ring buffer of length `packet_slots`
    int64_t packet_slots
    const double *tables
    RangeReading *ranges  # readings of the range sensor, ring buffer of length `range_slots`
    int64_t range_slots
