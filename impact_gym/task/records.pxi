"""The structures of an episode: task, draws, observation and state. `numbers.pxi` has the structures of its numbers."""


cdef struct Range:
    double low, high


cdef struct Draw:  # a number that an episode draws from a range
    int64_t place  # index of the number in `Record`
    int64_t source  # index of its uniform number: >= 0 in the generator's numbers, < 0 in the noise seed's stream
    int64_t by_ratio  # 1: log-uniform, 0: uniform
    double low, high


cdef struct Table:  # times, then as many values, among the numbers of all tables
    int64_t begin, points
    double length  # s, length of one recording
    double mean  # time average of the values, without losses


cdef struct Task:  # of a row
    double control_period  # s
    double horizon  # s, end of an episode without alarm
    double after_alarm  # s, from the switch's alarm to the end of an episode; duration of a reading's alarm
    double full_deceleration  # m/s^2, of the flange after the end of an episode
    double settle_limit  # s, longest simulation after the end of an episode
    double missed_cost  # m/s
    int64_t action_size
    ActionEntry[3] actions  # the first `action_size` are used
    Range velocity  # m/s, allowed commands to the flange
    Record numbers  # numbers of the set-up that are not drawn
    Mount mount  # the mount, with its numbers unless they are drawn
    int64_t first_draw, last_draw  # where this task's draws begin and end among the draws of all tasks
    int64_t mount_drawn  # 1: numbers of the mount are drawn
    int64_t range_sensor  # 1: with a range sensor
    int64_t alarm_by_reading  # 1: readings raise the alarm, 0: a switch does
    double force_weight  # m/s per N
    double tolerance  # -, local error allowed in a step of the integrator
    int64_t exact  # 1: damping factor `exact_damping`, 0: `hu_guo`
    double reference_velocity  # m/s, reference velocity of a constant chi; 0: the damping factor is constant
    int64_t max_steps  # control steps until truncation, 0 if unlimited
    int64_t operator_kind  # NO_OPERATOR: the controller commands alone
    Table replay, uplink, downlink  # recorded commands, and recorded delays of the channels; without a recording 0 points


cdef struct Reading:  # of the sensors, in transit to the controller
    double time  # s
    double force  # N; with `alarm="reading"` the largest force since the previous reading
    double peak  # N, largest force so far
    double deflection  # m


cdef struct Entry:  # one number of the observation
    int64_t place  # index of the number in `Episode`
    int64_t curve  # LINEAR, LOGARITHM or LOGARITHM_OF_ONE_MORE
    double low, scaled_low  # the value `low` of the curve is mapped to `scaled_low`
    double gain  # of the linear map


cdef struct Episode:  # a row, except its chain
    Record drawn
    Sensors sensors
    Contact contact
    double alarm  # s, when the alarm reached the controller; inf while there is no alarm
    double last_alarm  # s, when the last alarm reached the controller; inf before the first
    double next_sample  # s, next reading of the sensors; inf if there is none
    int64_t pushed  # readings taken, including those in transit at t = 0
    int64_t popped  # readings delivered to the controller
    double range_time  # s, when the newest range reading at the controller was taken; -inf before the first
    int64_t ranges_taken, ranges_delivered  # numbers of range readings; lost readings do not count
    int64_t control_steps
    int64_t terminated, truncated  # 0 or 1
    int64_t status  # 0, UNSETTLED, or negative: the solver failed
    Terms terms, terms_before  # sums of the unweighted terms of the reward, so far and before the last control step
    Terms rewards  # m/s, sums of the weighted terms
    double object_velocity  # m/s, V_p so far; its final value once the episode has terminated
    double approach_time  # s, time of the first contact; the horizon if there was none yet
    double slide, rest_time  # m and s; inf until the episode has terminated, and without friction
    double done_time  # s, end of the last control step so far
    double taken  # -, fraction of the operator's commanded motion withheld before the touch, so far
    double late  # s, mean time from a touch to the arrival of the operator's stop at the arm


cdef struct Packet:  # a command in transit, and the packet to the display sent at the same time
    double sent, arrives  # s
    double command  # m/s
    double position  # m, of the flange, when the packet was sent
    double displayed  # s, when the display shows that position


cdef struct Command:  # to the flange
    double velocity, acceleration  # m/s, m/s^2


cdef struct Link:  # operator, channels and assistance of a row
    double command  # m/s, newest command that has arrived
    double sent  # s, when it was sent; negative before the first
    double next_sent, next_arrival  # s, when the next command is sent, and when the next one arrives
    double expires  # s, when the newest command becomes too old
    double idle_since  # s, when the command became 0 again; inf while it is not 0, and before it first was not 0
    double stop  # s, when the operator stops; inf if not known yet
    double seen_position  # m, of the flange, in the newest packet that the operator has seen
    double alarmed  # s, when the last alarm reached the controller; -inf before the first
    double believed  # m, distance to the object that the operator assumes
    double duration  # s, duration of the operator's motion, if the operator is a `Reach`
    double muscle, tremor  # -, motor noise after one lag and after two
    double last_sent, effective  # m/s: last command sent; command used at the arm, 0 if it has expired
    double person_command  # m/s, what a `Person` sends at the next ticks
    double gain, acceleration, withdrawal  # of the assistance: -, m/s^2, m/s
    double commanded_way, withheld_way  # m, distances commanded by the operator and withheld before the touch
    double age_mean, age_squares  # s, s^2: mean age of commands on arrival, sum of squared deviations from it
    int64_t packets, oldest, arrived, ticks  # commands sent; index of the oldest that may be used; commands used; ticks
    int64_t display_packets, seen_packet  # packets sent to the display; index of the newest that the operator has seen
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
