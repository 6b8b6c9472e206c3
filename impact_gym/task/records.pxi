"""Structures of a task and its episodes; a row is one environment of a batch. `numbers.pxi` has more structures."""


cdef struct Range:
    double low, high


cdef struct Draw:  # a number that an episode draws from a range
    int64_t place  # index of the number in `Record`
    int64_t source  # >= 0: index among the generator's uniform numbers; < 0: index in the stream of the noise seed
    int64_t by_ratio  # 1: log-uniform, 0: uniform
    double low, high


cdef struct Table:  # times, then as many values
    int64_t begin, points  # index of the first time among the numbers of all tables; number of times
    double length  # s, last time of a trace; length of each of several recordings
    double mean  # s, of a trace: time average of the delay, without lost packets


cdef struct Task:  # arguments of an environment
    double control_period  # s
    double horizon  # s, end of an episode without an alarm, or with an operator
    double after_alarm  # s, time from a switch's alarm to the end of an episode, or duration of a reading's alarm
    double full_deceleration  # m/s^2, of the flange after the episode, and while the operator commands 0
    double settle_limit  # s, longest simulation after the end of an episode
    double missed_cost  # m/s
    int64_t action_size
    ActionEntry[3] actions  # the first `action_size` are used
    Range velocity  # m/s, allowed commands to the flange
    Record numbers  # numbers of the set-up; for a drawn number its median
    Mount mount  # the mount; for drawn numbers their medians
    int64_t first_draw, last_draw  # where this task's draws begin and end among the draws of all tasks
    int64_t mount_drawn  # 1: numbers of the mount are drawn
    int64_t range_sensor  # 1: with a range sensor
    int64_t alarm_by_reading  # 1: readings raise the alarm, 0: a switch does
    double force_weight  # m/s per N
    double tolerance  # -, allowed local error of a step of the integrator
    int64_t exact  # 1: damping factor `exact_damping`, 0: `hu_guo`
    double reference_velocity  # m/s, velocity at which `dissipation="fixed"` gives the restitution; else 0
    int64_t max_steps  # control steps until truncation, 0 if unlimited
    int64_t operator_kind  # NO_OPERATOR: the controller commands alone
    Table replay, uplink, downlink  # recorded commands; recorded delays of each channel; no recording: 0 points


cdef struct Reading:  # of the sensors, in transit to the controller
    double time  # s
    double force  # N; with `alarm="reading"` the largest force since the previous reading
    double peak  # N, largest force so far
    double deflection  # m


cdef struct Entry:  # one number of the observation
    int64_t place  # index of the number in `Episode`
    int64_t curve  # LINEAR, LOGARITHM or LOGARITHM_OF_ONE_MORE
    double low, scaled_low  # scaled value = scaled_low + gain * (curve(value) - low)
    double gain


cdef struct Episode:  # drawn numbers, state and results
    Record drawn
    Sensors sensors
    Contact contact
    double alarm  # s, when the alarm reached the controller; inf while there is no alarm
    double last_alarm  # s, when the last alarm reached the controller; inf before the first
    double next_sample  # s, time of the next reading; inf: no reading follows
    int64_t pushed  # readings taken, and those in transit at t = 0
    int64_t popped  # readings delivered to the controller
    double range_time  # s, when the newest range reading at the controller was taken; -inf: none
    int64_t ranges_taken, ranges_delivered  # range readings, without those lost
    int64_t control_steps
    int64_t terminated, truncated  # 0 or 1
    int64_t status  # 0, UNSETTLED, or negative: the solver failed
    Terms terms, terms_before  # sums of the unweighted terms of the reward, so far and before the last control step
    Terms rewards  # m/s, sums of the weighted terms
    double object_velocity  # m/s, V_p so far; its final value once the episode has terminated
    double approach_time  # s, time of the first contact; before it, the horizon
    double slide, rest_time  # m, s; inf without friction, and before the episode terminates
    double done_time  # s, end of the last control step so far
    double taken  # -, share of the operator's motion that was withheld before the touch, so far
    double late  # s, mean time from a touch until the operator's stop reaches the arm


cdef struct Packet:  # a command, and the packet that the arm sends to the display at the same time
    double sent, arrives  # s
    double command  # m/s
    double position  # m, of the flange, when the packet was sent
    double displayed  # s, when the display shows `position`


cdef struct Command:  # to the flange
    double velocity, acceleration  # m/s, m/s^2


cdef struct Link:  # operator, channels and assistance of a row
    double command  # m/s, newest command that has arrived
    double sent  # s, when `command` was sent; negative before the first
    double next_sent, next_arrival  # s, when the next command is sent, and when the next one arrives
    double expires  # s, when `command` becomes too old
    double idle_since  # s, since when `command` has been 0 again; inf: it is not 0, or has always been 0
    double stop  # s, when the operator stops; inf: not known
    double seen_position  # m, of the flange, in the newest packet that the operator has seen
    double alarmed  # s, when the last alarm reached the controller; -inf before the first
    double believed  # m, assumed distance of the object
    double duration  # s, duration of the operator's motion, if the operator is a `Reach`
    double muscle, tremor  # -, motor noise after the first and the second lag
    double last_sent, effective  # m/s, last command sent; `command`, or 0 if it has expired
    double person_command  # m/s, what a `Person` commands
    double gain, acceleration, withdrawal  # of the assistance: -, m/s^2, m/s
    double commanded_way, withheld_way  # m, before the touch: distance commanded, and its part that was withheld
    double age_mean, age_squares  # s, s^2: mean age of commands on arrival, sum of squared deviations from it
    int64_t packets, oldest, arrived, ticks  # commands sent; index of the oldest usable; commands used; ticks
    int64_t display_packets, seen_packet  # packets sent to the display; index of the `Packet` with the newest position seen
    int64_t expired, stopped  # 0 or 1
    int64_t uplink_lost, downlink_lost  # whether the last packet on this channel was lost


cdef struct RangeReading:  # of the range sensor, in transit to the controller
    double time  # s
    double gap  # m, with its error


cdef struct Row:  # one environment
    const Task *task
    Chain *chain
    Episode *episode
    Reading *readings  # a ring of `slots`
    int64_t slots
    const Entry *entries  # of the observation
    int64_t length
    float *observation
    Link *link  # with an operator
    Packet *packets  # a ring of `packet_slots`
    int64_t packet_slots
    const double *tables
    RangeReading *ranges  # of the range sensor, a ring of `range_slots`
    int64_t range_slots
