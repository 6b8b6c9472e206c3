"""The environment with an operator in the loop; the docstring of `ImpactTeleopEnv` is its specification."""

from impact_gym.envs.arguments import filled
from impact_gym.envs.single import ImpactApproachEnv


class ImpactTeleopEnv(ImpactApproachEnv):
    """An operator commands the tool with a delay; an assistance at the arm corrects the commands without delay.

    ## Description
    As `ImpactApproach`, except that an operator commands the velocity of the flange over one channel, and sees the arm
    over another channel. The agent controls an assistance at the arm, between the operator's commands and the flange.
    The assistance can slow down the approach, and after a touch it can stop and withdraw the tool. It does not know
    where the object is. It acts without delay, whereas the operator's commands arrive late. The task is done when the
    object rests again.

    ## Operators and Channels
    `operator` is an object of a class in `ig.operators`, or a dict with the name of the class as "type": `Replay`,
    `Person`, `Trapezoid`, `Reach`, `SecondOrderLag`, `Tracker`; their docstrings have equations and sources. Operators
    assume that the object is `place_error` farther away than it is. `uplink` and `downlink` are `Channel` objects. Once
    per control period, at the ticks of the operator's clock, one packet is sent over each channel. Each packet has its
    own delay; the receiver uses the newest packet that has arrived. Two packets do not wait for the next tick: the
    operator's stop, and the arm's report of the first touch. An operator learns of the touch from the first packet to
    arrive that was sent at the touch or later. After the time `reaction` the operator stops, that is, commands 0. A
    `Tracker` also reads the position of the flange from the packets. A `Person` sends the velocity last passed to
    `command(velocity)` of the unwrapped environment. A call before a step sets what is sent at the tick that falls into
    that step or at its end. A `Replay` of the velocities sent at the ticks repeats the episode bit for bit.

    ## Action Space
    `Box(-1, 1, (3,), float32)`. Values outside the box are clipped. With the operator's command u, the flange goes to
    the velocity v = g u - r, clipped to `velocity_range`. If u changes during a step, v changes at once.

    | Num | Action                      | at -1 | at +1 | Unit  |
    |-----|-----------------------------|-------|-------|-------|
    | 0   | gain g on the command       | 0     | 1     | -     |
    | 1   | acceleration to use for it  | 1     | 20    | m/s^2 |
    | 2   | withdrawal r                | 0     | 0.3   | m/s   |

    Three rules hold for every action. Without an alarm r is set to 0, so 0 <= v/u <= 1. After an alarm r is used for
    0.15 s (`after_alarm`), and then reduced from step to step, to 0 within 0.1 s. If u is 0, or if no newer command has
    arrived for the `timeout` of the uplink, the flange stops at the largest deceleration, 20 m/s^2. An action that is
    not finite is refused before anything moves.

    ## Observation Space
    The observation of `ImpactApproach`, and five numbers about the operator's commands: the rows with `operator` in the
    last column. Where the operator assumes the object to be is not observed.

    OBSERVATION_TABLE

    A step lasts 16 ms. As in `ImpactApproach`, it ends early when the contact alarm reaches the controller.

    ## Reward
    Each step gives `-time_weight` times its duration. The last step of the episode adds -V_p, where V_p is the object's
    largest velocity, or -2 (`missed_cost`) if the object was not touched.

    ## Starting State
    As in `ImpactApproach`, but the object is 0.2 to 0.8 m ahead, and its coefficient of friction on the ground is 0.1
    to 0.5. If operator or channel are dicts, their numbers may be pairs (low, high), from which each episode draws.

    ## Episode End
    An episode terminates when the object has been touched and rests, and either the command has been 0 for 0.3 s, or
    the flange is commanded at most 0.01 m/s with the tool within 5 mm of the object. It also terminates when an
    operator who has commanded a motion commands 0 for 0.3 s without a touch, and at 8 s (`horizon`). Then the flange
    brakes, and the simulation continues until all has settled.

    `info` of each step has `command` (m/s, the newest command that has arrived) and `command_age` (s), both at the end
    of the step. `teleop_action` (u, or 0 if the command was too old) and `intervene_action` (v), arrays (1,) in m/s,
    are the values of the last command that the flange executed in the step. Unlike in HIL-SERL, every step has an
    `intervene_action`; `is_intervention` says whether u and v differ by more than 1 mm/s. In a batch these entries are
    valid for the environments that played in the step; with SAME_STEP, the entries of a finished episode are in
    `final_info`. The final info has `object_velocity` (m/s), `slide` (m), `touch_time`, `done_time` (s; the horizon if
    the task was not done), `late` (s, mean time from a touch until the operator's stop reaches the arm), `peak_force`
    (N), `contact_count`, `taken` (the fraction of the operator's commanded motion that the assistance withheld before
    the touch), `missed`, `record`, and the other entries of `ImpactApproach`.

    ## Arguments
    See `ImpactApproach`. `ImpactTeleop-v0` has the operator `Reach`, and channels with a delay of 0.1 s each way.

    ## Version History
    * v0: first version
    """


if ImpactTeleopEnv.__doc__:  # None under python -OO
    ImpactTeleopEnv.__doc__ = filled(ImpactTeleopEnv.__doc__)
