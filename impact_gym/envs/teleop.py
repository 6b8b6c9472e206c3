"""The environment with an operator in the loop: its specification."""

from impact_gym.envs.arguments import filled
from impact_gym.envs.single import ImpactApproachEnv


class ImpactTeleopEnv(ImpactApproachEnv):
    """An operator commands the tool with a delay; an assistance at the arm corrects the commands at once.

    ## Description
    Like `ImpactApproach`, but an operator commands the velocity of the flange over one channel, and sees the arm over
    another channel. The controller is an assistance at the arm, between the operator's commands and the flange. It can
    slow down the approach, and after a touch it can stop and withdraw. It does not know where the object is. It acts
    without delay, but the operator's commands arrive late. The task is done when the object rests again.

    ## Operators and Channels
    `operator` is an object of a class in `ig.operators`, or a dict with the name of the class as "type": `Replay`,
    `Person`, `Trapezoid`, `Reach`, `SecondOrderLag` or `Tracker`. The docstrings of the classes have equations and
    sources. Operators assume the object `place_error` farther away than it is. `uplink` and `downlink` are `Channel`
    records. In each control period one packet is sent over each channel, on the operator's clock. Each packet has its
    own delay; the receiver uses the newest packet that has arrived. Two packets are sent at once, between these times:
    the operator's stop, and the arm's first touch. Operators see the touch in the first packet to arrive that was sent
    at the touch or later. They stop `reaction` later: from then on they command 0. A `Tracker` sees the position of the
    flange in these packets. A `Person` sends the velocity last passed to `command(velocity)` of the unwrapped
    environment. A call before a step sets what is sent at the tick in that step or at its end. A `Replay` of the
    velocities sent at the ticks repeats the episode to the bit.

    ## Action Space
    `Box(-1, 1, (3,), float32)`. Values outside the box are clipped. With the operator's command u, the flange is sent
    to v = g u - r, within `velocity_range`; also between the steps, when u changes.

    | Num | Action                      | at -1 | at +1 | Unit  |
    |-----|-----------------------------|-------|-------|-------|
    | 0   | gain g on the command       | 0     | 1     | -     |
    | 1   | acceleration to use for it  | 1     | 20    | m/s^2 |
    | 2   | withdrawal r                | 0     | 0.3   | m/s   |

    Three rules hold for every action. Without an alarm r is 0, so 0 <= v/u <= 1. After an alarm r is used for 0.15 s
    (`after_alarm`), and then fades over 0.1 s, from step to step. If u is 0, or no newer command has arrived for the
    `timeout` of the uplink, the flange stops at the largest deceleration, 20 m/s^2. An action that is not finite is
    refused before anything moves.

    ## Observation Space
    The observation of `ImpactApproach`, and five numbers about the operator's commands (the rows with `operator`). The
    place that the operator assumes for the object is not observed.

    OBSERVATION_TABLE

    A step lasts 16 ms. As in `ImpactApproach`, it ends early when the contact alarm reaches the controller.

    ## Reward
    -w times the time, until the end; at the end -V_p, the object's largest velocity. An object that was not touched
    costs 2 m/s (`missed_cost`).

    ## Starting State
    As in `ImpactApproach`, with the object 0.2 to 0.8 m ahead, and a friction of 0.1 to 0.5 under it. If operator or
    channel are dicts, their numbers may be pairs, from which episodes draw.

    ## Episode End
    An episode terminates when the object has been touched and rests, and either the command has been 0 for 0.3 s, or
    the flange is commanded at most 0.01 m/s with the tool within 5 mm of the object. It also terminates when an
    operator who has commanded a motion commands 0 for 0.3 s without a touch, and at 8 s (`horizon`). Then the flange
    brakes, and the simulation continues until all has settled.

    `info` of each step has the values at its end of `command` (m/s, the newest that has arrived) and `command_age` (s).
    It also has, for the last command executed in the step, `teleop_action` (u, 0 if that was too old) and
    `intervene_action` (v), arrays (1,) in m/s, and `is_intervention`, whether u and v differ by more than 1 mm/s.
    Unlike in HIL-SERL, every step has an `intervene_action`; the flag says whether it is an intervention. In a batch,
    these entries are valid for the environments that played in the step. With SAME_STEP, the entries of a finished
    episode are in `final_info`. The final info has `object_velocity` (m/s), `slide` (m), `touch_time`, `done_time` (s;
    the horizon if the task was not done), `late` (s, mean time from a touch until the operator's stop reaches the arm),
    `peak_force` (N), `contact_count`, `taken` (the share of the operator's motion that was withheld before the touch),
    `missed`, `record`, and the other entries of `ImpactApproach`.

    ## Arguments
    See `ImpactApproach`. `ImpactTeleop-v0` has a `Reach`, and channels of 0.1 s each way.

    ## Version History
    * v0: first version
    """


if ImpactTeleopEnv.__doc__:  # None under python -OO
    ImpactTeleopEnv.__doc__ = filled(ImpactTeleopEnv.__doc__)
