"""The environment with an operator in the loop; the docstring of `ImpactTeleopEnv` is its specification."""

from impact_gym.envs.arguments import documented
from impact_gym.envs.single import ImpactApproachEnv


@documented
class ImpactTeleopEnv(ImpactApproachEnv):
    """An operator commands the tool with a delay; an assistance at the arm changes the commands without delay.

    ## Description
    The environment is `ImpactApproach` with an *operator*: a model, a recording or a person. The operator commands the
    velocity of the flange over one channel, and sees the arm over another channel. The agent controls an *assistance*
    at the arm, which changes the operator's commands without delay. The assistance can slow down the approach. After a
    touch, the assistance can stop and withdraw the tool. The assistance does not know where the object is.

    ## Operators and Channels
    `operator` is an object of a class in `impact_gym.operators`: `Replay`, `Person`, or one of the models `Trapezoid`,
    `Reach`, `SecondOrderLag`, `Tracker`. Or `operator` is a dict with the name of the class as "type". The docstrings
    of the models name their sources. A model with a `place_error` assumes that the object is at its true distance plus
    this error. `uplink` (for commands) and `downlink` (for the operator's view) are `Channel` objects. Once per control
    period, at a tick of the operator's clock, one packet is sent over each channel. Each packet has its own delay, and
    the receiver uses the newest packet that has arrived. Two packets are sent between ticks: the operator's stop, and
    the arm's report of the first touch. Every packet to the operator that was sent at the touch or later shows the
    touch. `reaction` seconds after the first such packet has arrived, a model begins to command 0. A `Tracker` also
    reads the position of the flange from the packets. For a `Person`, your code passes velocities to
    `command(velocity)` of the unwrapped environment. Each tick sends the newest of these velocities. A `Replay` of the
    sent velocities repeats the episode bit for bit.

    ## Action Space
    `Box(-1, 1, (3,), float32)`. Values outside the box are clipped. Let u be the operator's command. The flange goes to
    the velocity v = g u - r, clipped to `velocity_range`. If u changes during a step, v changes too.

    | Num | Action                      | at -1 | at +1 | Unit  |
    |-----|-----------------------------|-------|-------|-------|
    | 0   | gain g on the command       | 0     | 1     | -     |
    | 1   | acceleration to use for it  | 1     | 20    | m/s^2 |
    | 2   | withdrawal r                | 0     | 0.3   | m/s   |

    Without an alarm r is 0, so v lies between 0 and u. After an alarm, r is used for 0.15 s (`after_alarm`), and then
    reduced to 0 within 0.1 s. If u is 0, or if no newer command has arrived for the `timeout` of the uplink, the flange
    stops at the largest deceleration, 20 m/s^2. If an action is not finite, `step` raises an error, and nothing moves.

    ## Observation Space
    The observation contains the numbers of `ImpactApproach` and five more, in the rows with 'only with `operator`'.

    OBSERVATION_TABLE

    A step lasts 16 ms. It ends earlier when the alarm reaches the controller, or at the `horizon`.

    ## Reward
    Each step gives `-time_weight` times its duration. If the object was touched, the step that terminates the episode
    adds `-V_p - force_weight * peak force`. V_p is the object's largest velocity. If the object was not touched, this
    step adds -2 (`missed_cost`).

    ## Starting State
    The object is 0.2 to 0.8 m ahead. The coefficient of friction on the ground is 0.1 to 0.5. All else is as in
    `ImpactApproach`. In a dict of an operator or a channel, a number may be a range (low, high) for draws.

    ## Episode End
    An episode terminates in four cases, or if the solver fails. (1) The object has been touched and rests, and the
    operator's command has been 0 for 0.3 s. (2) The object has been touched and rests, the speed of the flange's
    commanded motion is at most 0.01 m/s, and the tool is within 5 mm of the object. (3) The operator has commanded a
    motion, and then commands 0 for 0.3 s without a touch. (4) The episode has lasted 8 s (`horizon`). If the object was
    touched, the simulation continues after the last step as in `ImpactApproach` with `friction`.

    The `info` of each step has `command` (m/s, the newest command that has arrived by the end of the step) and
    `command_age` (s). Three other entries describe the last command that the flange executed in the step.
    `teleop_action` is u, or 0 if the command was too old. `intervene_action` is v. Both are arrays (1,) in m/s.
    `is_intervention` is true if the two arrays differ by more than 1 mm/s. Every step has an `intervene_action`; in the
    library HIL-SERL, only steps with an intervention have it. In a batch, these entries are valid for the environments
    that played in the step. With the autoreset mode SAME_STEP, `final_info` has the entries of a finished episode.

    The final info has the entries of `ImpactApproach` and four more: `touch_time` (s), `done_time` (s, the end of the
    last step), `stop_delay` (s, mean time from a touch until the operator's stop reaches the arm), and
    `withheld_share` (the fraction of the operator's commanded motion that the assistance withheld before the touch).

    ## Arguments
    See `ImpactApproach`. `ImpactTeleop-v0` has the operator `Reach`, and channels with a delay of 0.1 s each way.

    ## Version History
    * v0: first version
    """
