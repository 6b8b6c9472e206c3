"""The records of an episode: the task, its draws, the observation, and the state. More are in `numbers.pxi`."""


cdef struct Range:
    double low, high


cdef struct Draw:  # a number that an episode draws from a range
    int64_t place  # in `Record`
    int64_t source  # of its uniform number: >= 0: index into the episode's uniforms; < 0: stream -1 - source
    int64_t by_ratio  # 1: log-uniform, 0: uniform
    double low, high


cdef struct Table:  # of times and as many values, among the numbers of all tables
    int64_t begin, points
    double length  # s; of each recording where several follow one another
    double mean  # of the values, over time


cdef struct Task:  # of a row
    double control_period  # s
    double horizon  # s, the end of an episode without an alarm
    double after_alarm  # s, from the alarm to the end of an episode with one
    double full_deceleration  # m/s^2, after the end
    double settle_limit  # s, longest simulation after the end
    double missed_cost  # m/s
    int64_t action_size
    ActionEntry[3] actions  # so many count
    Range velocity  # m/s, that the flange may be sent to
    Record numbers  # of the set-up, those that are not drawn
    Mount mount  # likewise
    int64_t first_draw, last_draw  # of its episodes, among the draws of all tasks
    int64_t mount_drawn  # 1: numbers of the mount are drawn
    int64_t alarm_by_reading  # 1: the readings raise the alarm, 0: a switch of its own
    double force_weight  # m/s per N
    double tolerance  # -, local error of a step of the integrator
    int64_t exact  # 1: the damping factor that delivers the restitution, 0: that of Hu and Guo
    double reference_velocity  # m/s, where chi is the same at every velocity; 0 where the damping factor is
    int64_t max_steps  # control steps until truncation, 0 if unlimited
    int64_t operator_kind  # NO_OPERATOR: the controller decides alone
    Table replay, uplink, downlink  # commands of an operator, delays of the channels; no points where there is none


cdef struct Reading:  # of the sensors, in transit to the controller
    double time  # s
    double force  # N; where the readings raise the alarm, the largest since the reading before
    double peak  # N, largest force so far
    double deflection  # m


cdef struct Entry:  # one number of the observation
    int64_t place  # in `Episode`
    int64_t curve  # LINEAR, LOGARITHM or LOGARITHM_OF_ONE_MORE
    double low, scaled_low  # value of the curve that is mapped to `scaled_low`
    double gain  # scaled value per value of the curve


cdef struct Episode:  # a row, beside its chain
    Record drawn
    Sensors sensors
    Contact contact  # its law
    double alarm  # s, when it reached the controller; inf if it has not, or is over
    double last_alarm  # s, when the last alarm reached the controller, over or not; inf if none has
    double next_sample  # s, when the sensors are read next; inf if never again
    int64_t pushed  # readings taken so far, those in transit at t = 0 included
    int64_t popped  # of these, those that have reached the controller
    int64_t control_steps
    int64_t terminated, truncated  # 0 or 1
    int64_t status  # 0, UNSETTLED, or negative: the solver failed
    Terms terms, terms_before  # of the reward, so far and before the last control step, without weights
    Terms rewards  # m/s each, what they have given
    double object_velocity  # m/s, V_p so far; final once terminated
    double approach_time  # s, so far
    double slide, rest_time  # m and s, once terminated; inf without friction
    double done_time  # s, end of the last control step so far
    double taken  # -, share of the operator's motion before the touch that was withheld, so far
    double late  # s, from a touch until the operator's stop reaches the arm, on average


cdef struct Packet:  # a command in transit, and the display's packet sent with it
    double sent, arrives  # s
    double command  # m/s
    double position  # m, of the flange as it was sent
    double displayed  # s, when the display shows that position


cdef struct Command:  # to the flange
    double velocity, acceleration  # m/s, m/s^2


cdef struct Link:  # operator, channels and assistance of a row
    double command  # m/s, the newest that has arrived
    double sent  # s, when; negative if none has
    double next_sent, next_arrival  # s
    double expires  # s, when the newest command becomes too old
    double idle_since  # s, when the command became 0; inf while it is not
    double stop  # s, when the operator stops
    double seen_position  # m, of the flange in the newest packet that the operator has seen
    double alarmed  # s, when the last alarm came; -inf if none has
    double believed  # m, distance to the object that the operator assumes
    double duration  # s, of a reach
    double muscle, tremor  # -, noise of control after one lag and two
    double last_sent, effective  # m/s, the last command sent; the command used at the arm, 0 if it has expired
    double person_command  # m/s, sent at the ticks to come
    double gain, acceleration, withdrawal  # of the assistance: -, m/s^2, m/s
    double commanded_way, withheld_way  # m, before the touch
    double age_mean, age_squares  # s, s^2
    int64_t packets, oldest, arrived, ticks  # sent so far, the oldest that may still count, arrived, regular ones
    int64_t display_packets, seen_packet  # packets of the display sent so far, the newest that the operator has seen
    int64_t expired, stopped  # 0 or 1
    int64_t uplink_lost, downlink_lost  # whether the last packet was lost


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
