"""The records of an episode: what the task is, how it draws, what it observes, and the books. See `numbers.pxi`, too."""


cdef struct Range:
    double low, high


cdef struct Draw:  # a number that an episode draws from a range
    int64_t place  # in `Record`
    int64_t source  # of its uniform number: place among the generator's, or minus one minus that of a stream of its own
    int64_t by_ratio  # 1: log-uniform, 0: uniform
    double low, high


cdef struct Task:  # what a row plays
    double control_period  # s
    double horizon  # s, the end of an episode without an alarm
    double after_alarm  # s, from the alarm to the end of an episode with one
    double full_deceleration  # m/s^2, after the end
    double settle_limit  # s, simulated after the end at the most
    double missed_cost  # m/s
    Range velocity, acceleration  # m/s, m/s^2, what the two actions are mapped to
    double command_resolution  # m/s and m/s^2
    Record numbers  # of the set-up, as far as they are not drawn
    Mount mount  # likewise
    int64_t first_draw, last_draw  # of what its episodes draw, among the draws of all tasks
    int64_t mount_drawn  # 1: some of it is what holds the tool
    int64_t alarm_by_reading  # 1: the readings raise the alarm, 0: a switch of its own
    double force_weight  # m/s per N
    double tolerance  # -, local error of a step of the integrator
    int64_t exact  # 1: the damping factor that delivers the restitution, 0: that of Hu and Guo
    double reference_velocity  # m/s, where chi is the same at every velocity; 0 where the damping factor is
    int64_t max_steps  # control steps until truncation, 0 if unlimited


cdef struct Reading:  # of the sensors, on its way to the controller
    double time  # s
    double force  # N; where the readings raise the alarm, the largest since the reading before
    double peak  # N, largest force so far
    double deflection  # m


cdef struct Entry:  # one number of the observation
    int64_t place  # in `Episode`
    int64_t curve  # LINEAR, LOGARITHM or LOGARITHM_OF_ONE_MORE
    double low, scaled_low  # of the curve's value, and what that becomes
    double gain  # from there on, up to 1


cdef struct Episode:  # a row, beside its chain
    Record drawn
    Sensors sensors
    double damping  # -, damping factor of its contact
    double alarm  # s, when it reached the controller; inf if it has not, or is over
    double next_sample  # s, when the sensors are read next; inf if never again
    int64_t pushed  # readings taken so far, those under way at t = 0 included
    int64_t popped  # of these, how many have reached the controller
    int64_t control_steps
    int64_t terminated, truncated  # 0 or 1
    int64_t status  # 0, UNSETTLED, or negative: the solver failed
    double time_cost, velocity_cost, force_cost, missed_cost  # m/s, terms of the reward
    double object_velocity  # m/s, so far; once terminated, what it keeps
    double approach_time  # s, so far
    double slide, rest_time  # m and s, once terminated; inf without friction
