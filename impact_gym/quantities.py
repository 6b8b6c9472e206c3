"""The table of the numbers of a scene and of the task; `Quantity` describes the columns.

This table determines checks of input, draws, dotted paths, records of the compiled program, the observation, keys in
the file of a set-up, and tables of the documentation.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

from impact_gym.support.validation import Range, interval, number

HORIZON = 1.2  # s, `horizon` of the default environment, see `task.reach.usual_horizon`
AFTER_ALARM = 0.15  # s, default of the environment's argument `after_alarm`
PAST_READINGS = 3  # largest number of earlier readings of each sensor in an observation
LARGEST_WEIGHT = 1e6  # m/s, largest cost of a second, of a newton or of a missed object, so that rewards stay finite


class Limits(NamedTuple):
    """Limits of a finite number."""

    above: float = -math.inf
    at_least: float = -math.inf
    at_most: float = math.inf

    def allow(self, values: Any) -> Any:
        """Return whether each of `values`, floats, is finite and within the limits."""
        return (self.above < values) & (self.at_least <= values) & (values <= self.at_most) & (values < math.inf)


class Draw(NamedTuple):
    """How an episode draws a number: uniformly, log-uniformly (`by_ratio`, if the range begins above 0) or normally.

    An episode takes uniform numbers in [0, 1) from the environment's generator. A draw uses the number at index
    `place`. A normal draw also uses the next number. With `own_stream`, a draw uses a hash of -1 - `place`
    and the drawn `noise_seed`, even if another is given. Places never change, so that a new draw changes no other draw.
    """

    place: int
    by_ratio: bool = False
    normal: bool = False
    own_stream: bool = False


class Scale(NamedTuple):
    """How a number is scaled: [low, high] is mapped to [scaled_low, 1], linearly in `curve`(number), and clipped."""

    low: float
    high: float
    scaled_low: float = -1.0
    curve: Literal["linear", "log", "log1p"] = "linear"
    ends: str = ""  # the environment's argument that determines low and high, see `Task.ends`; "": none


NEVER_OBSERVED = Scale(math.nan, math.nan)


@dataclass(frozen=True)
class Quantity:
    """A row of the table: one number."""

    id: str
    words: str  # description in words, for documentation and messages
    unit: str  # "-": no unit
    limits: Limits = Limits()
    draw: Draw | None = None
    # "always", or the argument that adds the number to the observation; "": only a critic observes it, if it is drawn
    observed: str = ""
    scale: Scale = NEVER_OBSERVED
    path: str = ""  # dotted path of the number in scene or motion, if the path is not the id
    from_flange: bool = False  # True: the observation has the number minus the flange position
    shaped_by: tuple[str, ...] = ()  # arguments of the environment that change the observed value

    def check(self, value: Any, name: str = "") -> float:
        """Return `value` as a float, checked by `validation.number`; messages call it `name`, by default the id."""
        above, at_least, at_most = self.limits  # faster than `_asdict`
        return number(name or self.id, value, self.unit, above=above, at_least=at_least, at_most=at_most)

    def interval(self, value: Any, name: str = "") -> Range:
        """Return `value`, a number or a pair (low, high), as a pair that `validation.interval` has checked."""
        return interval(name or self.id, value, self.unit, **self.limits._asdict())

    def by_ratio(self, low: float) -> bool:
        """Return whether a draw from a range that begins at `low` is log-uniform."""
        return self.draw is not None and self.draw.by_ratio and low > 0.0

    def middle(self, low: float, high: float) -> float:
        """Return the median of a draw from [low, high]: the geometric mean if log-uniform, else the arithmetic mean."""
        if low == high:
            return low
        return math.sqrt(low) * math.sqrt(high) if self.by_ratio(low) else 0.5 * (low + high)


def set_up(
    name: str, words: str, unit: str, limits: Limits, place: int, scale: Scale, path: str = "", observed: str = ""
) -> Quantity:
    """Return the row of a number in SET_UP; the number is drawn `by_ratio` if its scale is logarithmic."""
    return Quantity(name, words, unit, limits, Draw(place, scale.curve == "log", False, True), observed, scale, path)


def log(low: float, high: float) -> Scale:
    """Return the logarithmic scale from `low` to `high`."""
    return Scale(low, high, curve="log")


# The limits are far inside the range of floats, because a run multiplies several numbers
MASS, STIFFNESS = Limits(at_least=1e-12, at_most=1e12), Limits(at_least=1e-9, at_most=1e18)
HERTZ, STOP = Limits(at_least=1e-12, at_most=1e20), Limits(at_least=1e-9, at_most=1e16)
AWAY, POSITIVE = Limits(at_least=1e-24, at_most=1e9), Limits(above=0.0, at_most=1e3)
LENGTH, PLACE = Limits(at_least=1e-9, at_most=1e9), Limits(at_least=-1e12, at_most=1e12)
RATE, NOT_NEGATIVE = Limits(at_least=1e-9, at_most=1e9), Limits(at_least=0.0, at_most=1e12)
RESTITUTION, DAMPING_RATIO = Limits(at_least=1e-12, at_most=1.0), Limits(at_least=0.0, at_most=1e6)
WEIGHT, SIZE, PART, LOST = (Limits(at_least=0.0, at_most=most) for most in (LARGEST_WEIGHT, 1e3, 1.0, 0.99))
SECONDS, OFFSET = SIZE, Limits(at_least=-1e3, at_most=1e3)
CORRELATION = Limits(at_least=0.0, at_most=0.999)
NEWTONS, EXPONENT = Limits(at_least=0.0, at_most=1e6), Limits(at_least=0.0, at_most=10.0)
THRESHOLD = Limits(at_least=1e-6, at_most=1e6)
FORCE, SHARE, GAP = Scale(0.0, 1000.0, 0.0, "log1p"), Scale(0.0, 1.0, 0.0), Scale(-0.5, 0.5)
HALF, TENTH, TEN = (Scale(0.0, high, 0.0) for high in (0.5, 0.1, 10.0))
BURST = Scale(1.0, 100.0, 0.0, "log1p")  # not "log", which would change its draws
SINCE_ALARM = Scale(0.0, AFTER_ALARM, 0.0, ends="after_alarm")
SENSED, ALARMED = ("reaction_delay", "force_noise", "force_bias", "alarm"), ("reaction_delay", "alarm")


def channel(way: str, place: int) -> tuple[Quantity, ...]:
    """Return the rows of the channel `way`, "uplink" or "downlink"; the places of their draws begin at `place`."""
    packets = {"uplink": "packets of commands", "downlink": "packets to the display"}[way]
    rows = (
        ("delay", f"smallest delay of {packets}", "s", SECONDS, HALF),
        ("jitter", f"mean random delay of {packets}", "s", SECONDS, HALF),
        ("tail", f"mean of a longer random delay of {packets}", "s", SECONDS, HALF),
        ("tail_share", f"share of {packets} with the longer delay", "-", PART, SHARE),
        ("loss", f"share of {packets} that are lost", "-", LOST, SHARE),
        ("burst", f"mean number of successive losses of {packets}", "-", Limits(at_least=1.0, at_most=1e6), BURST),
        ("timeout", "time without a newer command after which the arm stops", "s", POSITIVE, HALF),
    )  # fmt: skip
    return tuple(
        set_up(f"{way}.{name}", words, unit, limits, place + k, scale)
        for k, (name, words, unit, limits, scale) in enumerate(rows)
        if (way, name) != ("downlink", "timeout")
    )


SENSORS = (
    Quantity("position", "flange position", "m", observed="always", scale=Scale(-0.25, 0.75, ends="operator")),
    Quantity("velocity", "flange velocity", "m/s", observed="always", scale=Scale(-0.5, 1.5, ends="velocity_range")),
    Quantity("time", "time", "s", observed="always", scale=Scale(0.0, 1.25 * HORIZON, ends="horizon")),
    Quantity("alarm", "alarm", "-", observed="always", scale=SHARE, shaped_by=ALARMED),
    Quantity("time_since_alarm", "time since the alarm", "s", observed="always", scale=SINCE_ALARM, shaped_by=ALARMED),
    Quantity("force", "contact force one reaction delay ago", "N", observed="always", scale=FORCE, shaped_by=SENSED),
    Quantity("force_peak", "largest sensed force so far", "N", observed="always", scale=FORCE, shaped_by=SENSED),
)  # fmt: skip

SCENARIO = (
    Quantity("object_mass", "object mass", "kg", MASS, Draw(0, by_ratio=True), "privileged",
             Scale(0.01, 10.0, curve="log"), path="object.mass"),
    Quantity("contact_stiffness", "contact stiffness", "N/m^1.5", HERTZ, Draw(1, by_ratio=True), "privileged",
             Scale(1e3, 1e8, curve="log"), path="contact.stiffness"),
    Quantity("restitution", "restitution", "-", RESTITUTION, Draw(2), "privileged", SHARE, path="contact.restitution"),
    Quantity("distance", "distance", "m", AWAY, Draw(3), "privileged", GAP, path="object.distance", from_flange=True),
)  # fmt: skip
"""The quantities of a scenario: keys of `options["scenario"]` and of the final `info["scenario"]`."""

EPISODE = (
    Quantity("time_weight", "time weight", "m/s per s", Limits(above=0.0, at_most=LARGEST_WEIGHT),
             Draw(4, by_ratio=True), "always", Scale(2 / 16, 2 * 16, curve="log"), shaped_by=("time_weight",)),
    Quantity("distance_estimate", "distance estimate", "m", PLACE, Draw(5, normal=True), "range_noise", GAP,
             from_flange=True),
    Quantity("reaction_delay", "reaction delay", "s", Limits(at_least=0.0, at_most=1.0), Draw(7), "privileged",
             Scale(0.0, 0.1, 0.0)),
    Quantity("force_error", "error of all force readings of the episode", "N", PLACE, Draw(8, normal=True)),
    Quantity("noise_seed", "seed of all other random numbers", "-", Limits(at_least=0.0, at_most=2.0**53), Draw(10)),
)  # fmt: skip
"""Numbers that an episode draws in addition to the scenario and to numbers of the set-up."""

SET_UP = (
    set_up("tool_mass", "tool mass", "kg", MASS, 0, log(0.01, 10.0), path="tool.mass"),
    set_up("alarm_threshold", "contact force above which the alarm is sent", "N", THRESHOLD, 1, log(0.1, 100.0)),
    set_up("range_noise", "standard deviation of the distance estimate", "m", SIZE, 2, Scale(0.0, 0.05, 0.0),
           observed="observe_range_noise"),
    set_up("range_bias", "error of every distance estimate", "m", OFFSET, 3, Scale(-0.1, 0.1)),
    set_up("force_noise", "standard deviation of each force reading", "N", NEWTONS, 4, log(0.01, 10.0)),
    set_up("force_bias", "standard deviation of the force error of an episode", "N", NEWTONS, 5, Scale(0.0, 2.0)),
    set_up("friction", "Coulomb friction of the object on the ground", "-", SIZE, 17, SHARE, path="object.friction"),
    set_up("coupling.stiffness", "stiffness of the coupling", "N/m", STIFFNESS, 6, log(1.0, 1e4)),
    set_up("coupling.damping_ratio", "damping ratio of the coupling", "-", DAMPING_RATIO, 7, Scale(0.0, 2.0)),
    set_up("coupling.free_length", "free length of the mechanism's spring", "m", LENGTH, 8, Scale(0.0, 0.2)),
    set_up("coupling.height", "height of the pivot above the slider's path", "m", LENGTH, 9, Scale(0.0, 0.1)),
    set_up("coupling.front_stop", "front stop of the mechanism", "m", PLACE, 10, Scale(0.0, 0.1)),
    set_up("coupling.rear_stop", "rear stop of the mechanism", "m", PLACE, 11, Scale(-0.1, 0.0)),
    set_up("coupling.stop_stiffness", "stiffness of the mechanism's stops", "N/m", STOP, 12, log(1e3, 1e7)),
    set_up("coupling.stop_damping_ratio", "damping ratio of the mechanism's stops", "-", DAMPING_RATIO, 13,
           Scale(0.0, 2.0)),
    set_up("coupling.stroke", "travel of the tool from rest to either stop", "m", LENGTH, 18, TENTH),
    set_up("robot.mass", "effective mass of the robot", "kg", MASS, 14, log(0.1, 100.0)),
    set_up("robot.stiffness", "stiffness of the robot", "N/m", STIFFNESS, 15, log(1e3, 1e7)),
    set_up("robot.damping", "damping of the robot", "N s/m", NOT_NEGATIVE, 16, Scale(0.0, 500.0)),
    set_up("operator.speed", "fastest command of the operator", "m/s", POSITIVE, 19, Scale(0.0, 1.0)),
    set_up("operator.reaction", "reaction time of the operator", "s", SECONDS, 20, HALF),
    set_up("operator.place_error", "assumed minus true distance of the object", "m", OFFSET, 21, Scale(-0.2, 0.2)),
    set_up("operator.creep", "speed at which the operator searches for the object", "m/s", POSITIVE, 22, HALF),
    set_up("operator.lag_slope", "relative increase of reach duration per second of lag", "1/s", NOT_NEGATIVE, 23, TEN),
    set_up("operator.noise", "motor noise of the operator divided by the control signal", "-", EXPONENT, 27, SHARE),
    set_up("operator.stiffness", "stiffness divided by mass of the operator's hand", "1/s^2", STIFFNESS, 28,
           log(1.0, 1e3)),
    set_up("operator.damping", "damping divided by mass of the operator's hand", "1/s", NOT_NEGATIVE, 29,
           Scale(0.0, 20.0, 0.0)),
    set_up("operator.gain", "crossover frequency of the operator", "rad/s", RATE, 30, TEN),
    set_up("operator.recording", "index of the recording that is played, rounded down", "-",
           Limits(at_least=0.0, at_most=1e6), 47, Scale(0.0, 1e3, 0.0)),
    *channel("uplink", 33),
    *channel("downlink", 40),
    set_up("range_sensor.noise", "standard deviation of a range reading at gap 0", "m", SIZE, 48,
           Scale(0.0, 0.05, 0.0)),
    set_up("range_sensor.share", "increase of a range reading's standard deviation with the gap", "-", PART, 49, SHARE),
    set_up("range_sensor.bias", "error of all range readings of the episode", "m", OFFSET, 50, Scale(-0.1, 0.1)),
    set_up("range_sensor.dropout", "share of range readings that are lost", "-", LOST, 51, SHARE),
    set_up("range_sensor.delay", "delay of range readings", "s", SECONDS, 52, HALF),
    set_up("range_sensor.scale", "relative error of all range readings of the episode", "-",
           Limits(above=-1.0, at_most=1.0), 53, Scale(-0.2, 0.2)),
    set_up("range_sensor.correlation", "correlation of the noise of successive range readings", "-", CORRELATION, 54,
           SHARE),
    set_up("range_sensor.resolution", "step to which range readings are rounded", "m", SIZE, 55, Scale(0.0, 0.05, 0.0)),
    set_up("range_sensor.nearest", "smallest gap that the range sensor reads", "m", SIZE, 56, HALF),
    set_up("range_sensor.farthest", "largest gap that the range sensor reads", "m", SIZE, 57,
           Scale(0.0, 1e3, 0.0, "log1p")),
)  # fmt: skip
"""Arguments of the environment, or parts of them. Each number may be a range, from which each episode draws."""

DEFLECTION = Quantity("deflection", "displacement of the tool one reaction delay ago", "m", scale=Scale(-0.05, 0.05),
                      observed="deflection_sensor", shaped_by=("reaction_delay",))  # fmt: skip
PAST = tuple(
    replace(row, id=f"{row.id}_{before}", words=f"{row.words}, earlier reading {before}", observed="past_readings")
    for before in range(1, PAST_READINGS + 1)
    for row in (*(row for row in SENSORS if row.id == "force"), DEFLECTION)
)
SPEEDS = Scale(-0.5, 1.5, ends="velocity_range")
AGE, SPREAD, LAST_READ = (Scale(0.0, high, 0.0) for high in (1.0, 0.2, 0.5))
COMMANDS = (
    Quantity("command", "newest command of the operator that has arrived", "m/s", observed="operator", scale=SPEEDS),
    Quantity("command_age", "time since the observed command was sent", "s", observed="operator", scale=AGE),
    Quantity("command_age_mean", "mean age of commands at their arrival", "s", observed="operator", scale=AGE),
    Quantity("command_age_spread", "standard deviation of ages of commands", "s", observed="operator", scale=SPREAD),
    Quantity("executed", "last velocity commanded to the flange", "m/s", observed="operator", scale=SPEEDS),
)  # fmt: skip
"""Numbers that a controller observes only with an operator."""
MORE_SENSORS = (
    DEFLECTION,
    *PAST,
    *COMMANDS,
    Quantity("range", "newest reading of the gap from tool to object", "m", observed="range_sensor", scale=LAST_READ),
    Quantity("range_age", "age of the newest reading of the gap", "s", observed="range_sensor", scale=LAST_READ),
    Quantity("time_since_touch", "time since a switch would have raised the alarm", "s", observed="privileged",
             scale=SINCE_ALARM),
)  # fmt: skip
"""Numbers that an argument of the environment adds to the observation."""

RESULTS = (
    Quantity("object_velocity", "V_p, the final velocity of the object; with friction, its largest velocity", "m/s"),
    Quantity("approach_time", "time until the first contact", "s"),
    Quantity("peak_force", "largest contact force", "N"),
    Quantity("contact_count", "number of contacts", "-"),
    Quantity("missed", "whether the object was not touched", "-"),
)

STEERED = (
    Quantity("done_time", "end of the last control step", "s"),
    Quantity("stop_delay", "mean time from a touch until the operator's stop reaches the arm", "s"),
    Quantity("withheld_share", "share of the operator's motion that the assistance withheld before the touch", "-"),
)
"""Results that only an episode with an operator has."""

OTHERS = (
    Quantity("contact.stiffness_exponent", "exponent of the contact stiffness", "-", Limits(at_least=1, at_most=10)),
    Quantity("contact.damping_exponent", "exponent of the contact damping", "-", EXPONENT),
    Quantity("contact.reference_velocity", "velocity at which a fixed damping gives the restitution", "m/s", RATE),
    Quantity("robot.position", "positions of a robot's table", "m", PLACE),
    Quantity("motion.speed", "speed of the approach", "m/s", RATE),
    Quantity("motion.acceleration", "acceleration of the approach", "m/s^2", RATE),
    Quantity("motion.brake.threshold", "contact force above which the brake's alarm is sent", "N", NOT_NEGATIVE),
    Quantity("motion.brake.delay", "delay of the brake", "s", NOT_NEGATIVE),
    Quantity("motion.brake.deceleration", "deceleration of the brake", "m/s^2", RATE),
    Quantity("duration", "duration of a run", "s", Limits(at_least=1e-12, at_most=1e12)),
    Quantity("rtol", "relative error allowed in a contact", "-", Limits(at_least=1e-13, at_most=1e-2)),
    Quantity("force_weight", "cost of the peak force", "m/s per N", WEIGHT),
    Quantity("horizon", "end of an episode without an alarm", "s", Limits(at_least=1e-3, at_most=1e3)),
    Quantity("after_alarm", "time from the alarm to the end of an episode", "s", Limits(at_least=1e-3, at_most=1e3)),
    Quantity("missed_cost", "cost of an object that was not touched", "m/s", WEIGHT),
    Quantity("force_limit", "largest peak force without a cost", "N", Limits(above=0.0, at_most=1e6)),
    Quantity("velocity_limit", "largest V_p without a cost", "m/s", POSITIVE),
    Quantity("control_period", "control period", "s", Limits(at_least=1e-4, at_most=0.15)),
    Quantity("velocity_range", "range of an action's first number", "m/s", OFFSET),
    Quantity("acceleration_range", "range of an action's second number", "m/s^2", Limits(at_least=1e-9, at_most=1e6)),
)
"""Other numbers of a scene, a motion or `simulate`, and arguments of the environment that are never drawn."""

QUANTITIES: dict[str, Quantity] = {
    row.id: row for row in (*SENSORS, *SCENARIO, *EPISODE, *SET_UP, *MORE_SENSORS, *RESULTS, *STEERED, *OTHERS)
}
"""All rows by id. An observation has its numbers in this order, except that numbers for a critic come last."""

BY_PATH: dict[str, Quantity] = {row.path or row.id: row for row in QUANTITIES.values() if row.path or "." in row.id}
"""The rows of numbers with a dotted path, by path."""
