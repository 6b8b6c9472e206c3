"""The environment with an operator in the loop: the text that specifies it."""

from impact_gym.envs.arguments import filled
from impact_gym.envs.single import ImpactApproachEnv


class ImpactTeleopEnv(ImpactApproachEnv):
    """An operator steers the tool from afar and acts late; the assistance at the arm corrects, and acts at once.

    ## Description
    As `ImpactApproach`, except that an operator commands the flange's velocity over a channel and sees the arm over
    another. Between the commands and the flange stands the controller, here an assistance: it can slow the approach
    down, and after a touch stop and withdraw. It never knows where the object stands. Its command reaches the flange at
    once; the operator's comes late. The task is done when the object rests again.

    ## Operators and Channels
    `operator` is a record of `ig.operators` or a dict with its name as "type": `Replay`, `Person`, `Trapezoid`,
    `Reach`, `SecondOrderLag`, `Tracker`; their docstrings have equations and sources. The operator only believes that
    the object is in a place: `place_error` beyond its face. `uplink` and `downlink` are `Channel` records, with one
    rule: a packet each control period, on the operator's clock; each takes its delay, and the newest to arrive counts.
    Operators send their stop at once, and the arm the touch. So they see the touch with the first packet to arrive of
    those sent from then on, and `reaction` later commands 0, for ever. A `Tracker` sees the flange in these packets. A
    `Person` sends what `command(velocity)` of the unwrapped environment was last given: before a step, what is sent at
    the tick in it or at its end. A `Replay` of these at the ticks is the same episode, to the bit.

    ## Action Space
    `Box(-1, 1, (3,), float32)`. Values outside the box are clipped. With u the operator's command, the flange is sent
    to v = g u - r, within `velocity_range`, whenever u changes too.

    | Num | Action                      | at -1 | at +1 | Unit  |
    |-----|-----------------------------|-------|-------|-------|
    | 0   | gain g on the command       | 0     | 1     | -     |
    | 1   | acceleration to use for it  | 1     | 20    | m/s^2 |
    | 2   | withdrawal r                | 0     | 0.3   | m/s   |

    These rules are kept whatever the action is: without an alarm r is 0, and so 0 <= v/u <= 1. r counts for 0.15 s
    (`after_alarm`) from an alarm on, then fades over 0.1 s, from step to step. Where u is 0 or no newer command has
    come for the `timeout` of the uplink, the flange stops at the arm's limit, 20 m/s^2. An action that is not finite is
    refused before anything moves.

    ## Observation Space
    That of `ImpactApproach`, and five numbers of the command: see the rows with `operator`. Where the operator believes
    the object is no part of it, but the commands follow from that.

    OBSERVATION_TABLE

    A step lasts 16 ms, and ends early when the contact alarm reaches the controller, as there.

    ## Reward
    -w times the time, until the end; at the end -V_p, the object's largest velocity. An object that was not touched
    costs 2 m/s (`missed_cost`).

    ## Starting State
    As there, with the object 0.2 to 0.8 m ahead and friction of 0.1 to 0.5 under it. Numbers of operator and channels
    may be pairs, from which episodes draw, where these are given as dicts.

    ## Episode End
    It terminates when the object has been touched and rests, and either the command has been 0 for 0.3 s or the flange
    is sent to at most 0.01 m/s with the tool within 5 mm of the object. It also terminates when an operator who has
    commanded something commands 0 for 0.3 s without having touched anything, and at 8 s (`horizon`). Then the flange
    brakes, and what still moves is played to its end.

    `info` of each step has `command` (m/s, the newest that has arrived) and `command_age` (s), both at its end; and of
    what was executed last in it `teleop_action` (u, 0 if that was too old) and `intervene_action` (v), arrays (1,) in
    m/s, and `is_intervention`, whether they are more than 1 mm/s apart. Unlike in HIL-SERL `intervene_action` is there
    in each step: the flag says whether it is an intervention. A batch has them of the slots that played in the step,
    with SAME_STEP in the final info of those whose episode ended. The final one has `object_velocity` (m/s),
    `slide` (m), `touch_time`, `done_time` (s; the horizon where that has not come), `late` (s, what reaction and
    channels take from a touch to the operator's stop at the arm, on average), `peak_force` (N), `contact_count`,
    `taken` (the share of the operator's motion before the touch that was withheld), `missed`, `record`, and what
    that of `ImpactApproach` has.

    ## Arguments
    See `ImpactApproach`. `ImpactTeleop-v0` is that with a `Reach` over channels of 0.1 s each way.

    ## Version History
    * v0: first version
    """


if ImpactTeleopEnv.__doc__:  # there is none under python -OO
    ImpactTeleopEnv.__doc__ = filled(ImpactTeleopEnv.__doc__)
