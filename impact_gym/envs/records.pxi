"""The records of an episode: what the task is, what it draws, what the controller may know, and the books."""


cdef struct Range:
    double low, high


cdef struct Ranges:  # what an episode draws from
    Range object_mass, contact_stiffness  # kg, N/m^1.5; log-uniform
    Range restitution, distance  # -, m; uniform
    Range time_weight  # m/s per s; log-uniform
    Range reaction_delay  # s; uniform


cdef struct Uniforms:  # the uniform numbers an episode takes from its generator, in this order, whatever the options
    double object_mass, contact_stiffness, restitution, distance, time_weight
    double estimate_size, estimate_angle  # of a normal number, see `normal`
    double reaction_delay
    double error_size, error_angle  # of the force
    double noise_seed  # names the stream of the numbers of the set-up, too


cdef struct Setting:  # numbers of the set-up, of which an episode may draw any
    double tool_mass  # kg
    double alarm_threshold  # N
    double range_noise  # m, standard deviation of the distance estimate
    double range_bias  # m, by which all estimates are too far
    double force_noise  # N, of each reading
    double force_bias  # N, of the error that stays for the episode
    CouplingNumbers coupling
    RobotNumbers robot


cdef struct Draw:  # a number of the set-up that an episode draws
    int64_t place  # in `Setting`
    int64_t logarithmic  # 1: log-uniform, 0: uniform
    double low, high


cdef struct Record:  # all that an episode has drawn; nan where it is still to draw
    double object_mass  # kg
    double contact_stiffness  # N/m^1.5
    double restitution  # -
    double distance  # m
    double time_weight  # m/s per s
    double distance_estimate  # m
    double reaction_delay  # s
    double force_error  # N, on all readings
    double noise_seed  # a whole number, names the stream of the force noise
    Setting setting  # what is not drawn as the task has it


cdef struct Task:  # what a row plays
    double control_period  # s
    double horizon  # s, the end of an episode without an alarm
    double after_alarm  # s, from the alarm to the end of an episode with one
    double full_deceleration  # m/s^2, after the end
    double settle_limit  # s, simulated after the end at the most
    double missed_cost  # m/s
    Range velocity, acceleration  # m/s, m/s^2, what the two actions are mapped to
    double command_resolution  # m/s and m/s^2
    Setting setting
    int64_t first_draw, last_draw  # of the numbers of it that an episode draws, among those of all tasks
    int64_t holder_drawn  # 1: some of these are what holds the tool
    int64_t alarm_by_reading  # 1: the readings raise the alarm, 0: a switch of its own
    double force_weight  # m/s per N
    double tolerance  # -, local error of a step of the integrator
    int64_t exact  # 1: the damping factor that delivers the restitution, 0: that of Hu and Guo
    int64_t max_steps  # control steps until truncation, 0 if unlimited
    Ranges draws  # of its episodes


cdef struct Reading:  # of the sensors, on its way to the controller
    double time  # s
    double force  # N; where the readings raise the alarm, the largest since the reading before
    double peak  # N, largest force so far
    double deflection  # m


cdef struct Sensors:  # what the controller may know now, then the truth; `observation` in Python scales it
    double position, velocity  # m, m/s, of the imposed motion
    double time  # s
    double alarm  # 0 or 1
    double time_since_alarm  # s
    double force, peak  # N
    double time_weight  # m/s per s
    double distance_estimate  # m, from the flange
    double force_1, force_2, force_3  # N, one, two and three readings before
    double deflection  # m
    double deflection_1, deflection_2, deflection_3  # m, likewise
    double object_mass, contact_stiffness, restitution, distance, reaction_delay  # the distance from the flange
    double time_since_touch  # s, since a switch of its own would have raised the alarm; 0 before


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
    int64_t status  # of the solver; negative: failed
    double time_cost, velocity_cost, force_cost, missed_cost  # m/s, terms of the reward
    double object_velocity  # m/s, so far; once terminated, what it keeps
    double approach_time  # s, so far
