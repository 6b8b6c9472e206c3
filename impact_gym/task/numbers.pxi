"""Written by `python -m impact_gym.task.numbers` from the table in `impact_gym/quantities.py`: edit that."""

cpdef enum:  # places among the uniform numbers from the generator, and their count
    DISTANCE_ESTIMATE_UNIFORM = 5
    FORCE_ERROR_UNIFORM = 8
    NOISE_SEED_UNIFORM = 10
    UNIFORMS = 11


cdef struct CouplingNumbers:
    double stiffness  # N/m, stiffness of the coupling
    double damping_ratio  # -, damping ratio of the coupling
    double free_length  # m, free length of the mechanism's spring
    double height  # m, height of the mechanism's pivot above its path
    double front_stop  # m, front stop of the mechanism
    double rear_stop  # m, rear stop of the mechanism
    double stop_stiffness  # N/m, stiffness of the mechanism's stops
    double stop_damping_ratio  # -, damping ratio of the mechanism's stops
    double stroke  # m, way of the tool to its stops, either side


cdef struct RobotNumbers:
    double mass  # kg, effective mass of the robot
    double stiffness  # N/m, stiffness of the robot
    double damping  # N s/m, damping of the robot


cdef struct OperatorNumbers:
    double speed  # m/s, fastest command of the operator
    double reaction  # s, reaction time of the operator
    double place_error  # m, how far beyond the object the operator believes it
    double creep  # m/s, speed at which the operator searches further
    double lag_slope  # 1/s, share by which a second of lag lengthens a reach
    double noise  # -, noise of the operator's control as a share of it
    double stiffness  # 1/s^2, stiffness of the operator's hand over its mass
    double damping  # 1/s, damping of the operator's hand over its mass
    double gain  # rad/s, crossover frequency of the operator
    double recording  # -, which of several recordings is played, its fraction dropped


cdef struct ChannelNumbers:
    double delay  # s, least delay of the operator's commands
    double jitter  # s, mean of a random delay of the operator's commands
    double tail  # s, mean of a longer random delay of the operator's commands
    double tail_share  # -, share of the operator's commands with the longer delay
    double loss  # -, share of the operator's commands that is lost
    double burst  # -, mean number of losses in a row of the operator's commands
    double timeout  # s, silence after which the arm stops


cdef struct Record:  # numbers of an episode and of its set-up; nan: to draw
    double object_mass  # kg, object mass
    double contact_stiffness  # N/m^1.5, contact stiffness
    double restitution  # -, restitution
    double distance  # m, distance
    double time_weight  # m/s per s, time weight
    double distance_estimate  # m, distance estimate
    double reaction_delay  # s, reaction delay
    double force_error  # N, error of all force readings of the episode
    double noise_seed  # -, seed of the force noise
    double tool_mass  # kg, tool mass
    double alarm_threshold  # N, contact force above which the alarm is sent
    double range_noise  # m, standard deviation of the distance estimate
    double range_bias  # m, error of every distance estimate
    double force_noise  # N, standard deviation of each force reading
    double force_bias  # N, standard deviation of the force error of an episode
    double friction  # -, Coulomb friction of the object on the ground
    CouplingNumbers coupling
    RobotNumbers robot
    OperatorNumbers operator
    ChannelNumbers uplink
    ChannelNumbers downlink


cdef struct Sensors:  # sensor values, and true values for a critic
    double position  # m, flange position
    double velocity  # m/s, flange velocity
    double time  # s, time
    double alarm  # -, alarm
    double time_since_alarm  # s, time since the alarm
    double force  # N, contact force as sensed a delay ago
    double force_peak  # N, largest sensed force so far
    double distance  # m, distance, from the flange
    double distance_estimate  # m, distance estimate, from the flange
    double deflection  # m, tool minus flange from rest, as sensed a delay ago
    double force_1  # N, contact force as sensed a delay ago, 1 before
    double deflection_1  # m, tool minus flange from rest, as sensed a delay ago, 1 before
    double force_2  # N, contact force as sensed a delay ago, 2 before
    double deflection_2  # m, tool minus flange from rest, as sensed a delay ago, 2 before
    double force_3  # N, contact force as sensed a delay ago, 3 before
    double deflection_3  # m, tool minus flange from rest, as sensed a delay ago, 3 before
    double command  # m/s, newest command of the operator that has arrived
    double command_age  # s, time since it was sent
    double command_age_mean  # s, mean age of commands as they arrived
    double command_age_spread  # s, standard deviation of that age
    double executed  # m/s, velocity that the flange was last sent to
    double time_since_touch  # s, time since a switch would have raised the alarm
