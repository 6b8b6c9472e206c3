"""Every number of a scene and of the task, once: identifier, words, unit, limits, how it is drawn, how it is observed.

Everything else follows from these rows: what input is refused, what an episode draws, the dotted paths of a scene, the
records of the compiled program (`impact_gym.task.numbers`), the observation, the tables of the documentation, the keys
of a set-up's file, and what may be swept, identified or designed. Users find them as `impact_gym.task.QUANTITIES`.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

from impact_gym.validation import Range, interval, number

HORIZON = 1.2  # s, an episode without an alarm ends here, if not said otherwise
AFTER_ALARM = 0.15  # s, one with an alarm ends this long after it, likewise
PAST_READINGS = 3  # readings before the last one that may be observed, at the most
LARGEST_WEIGHT = 1e6  # m/s per s and m/s per N; keeps rewards finite


class Limits(NamedTuple):
    """Limits of a finite number."""

    above: float = -math.inf
    at_least: float = -math.inf
    at_most: float = math.inf


class Draw(NamedTuple):
    """How an episode draws a number: uniformly from a range, by ratio where that begins above 0, or normally.

    The uniform number in [0, 1) is the `place`-th that an episode takes from the environment's generator (a normal draw
    takes two), or comes from the `place`-th separate stream, seeded by the noise seed. Places never change, so that
    drawing one more number or adding a row changes no other draw.
    """

    place: int
    by_ratio: bool = False
    normal: bool = False
    own_stream: bool = False


class Scale(NamedTuple):
    """How a number is observed: `curve` of it, mapped linearly from `low`, `high` to `scaled_low`, 1 and clipped."""

    low: float
    high: float
    scaled_low: float = -1.0
    curve: Literal["linear", "log", "log1p"] = "linear"
    ends: str = ""  # argument of the environment from which low and high follow instead, see `Task.ends`


NEVER_OBSERVED = Scale(math.nan, math.nan)


@dataclass(frozen=True)
class Quantity:
    """One number."""

    id: str
    words: str  # for people
    unit: str  # "-" where there is none
    limits: Limits = Limits()
    draw: Draw | None = None
    observed: str = ""  # "always", or the argument of the environment that adds it; "": only for a critic, if drawn
    scale: Scale = NEVER_OBSERVED
    path: str = ""  # in a `Scene` with its motion, if not the id
    from_flange: bool = False  # observed relative to the flange
    shaped_by: tuple[str, ...] = ()  # arguments of the environment that change what is observed

    def check(self, value: Any, name: str = "") -> float:
        """Return `value` as a float, or raise as `validation.number`; `name` is what the message calls it."""
        above, at_least, at_most = self.limits  # without _asdict, which is slow: called for every approach
        return number(name or self.id, value, self.unit, above=above, at_least=at_least, at_most=at_most)

    def interval(self, value: Any, name: str = "") -> Range:
        """Return `value`, a number or a pair (low, high), as a pair, or raise as `validation.interval`."""
        return interval(name or self.id, value, self.unit, **self.limits._asdict())

    def by_ratio(self, low: float) -> bool:
        """Whether it is drawn log-uniformly from a range that begins at `low`."""
        return self.draw is not None and self.draw.by_ratio and low > 0.0

    def middle(self, low: float, high: float) -> float:
        """Return the median of a draw from a range: geometric mean of the ends if drawn by ratio, else arithmetic."""
        if low == high:
            return low
        return math.sqrt(low) * math.sqrt(high) if self.by_ratio(low) else 0.5 * (low + high)


def own(place: int, by_ratio: bool = False) -> Draw:
    """Return the draw of a number of the set-up, from its own stream."""
    return Draw(place, by_ratio, own_stream=True)


# Wide, but not as wide as floats: near the ends a run is either correct or its status says why not
MASS, STIFFNESS = Limits(at_least=1e-12, at_most=1e12), Limits(at_least=1e-9, at_most=1e18)
HERTZ, STOP = Limits(at_least=1e-12, at_most=1e20), Limits(at_least=1e-9, at_most=1e16)
AWAY, POSITIVE = Limits(at_least=1e-24, at_most=1e9), Limits(above=0.0, at_most=1e3)
LENGTH, PLACE = Limits(at_least=1e-9, at_most=1e9), Limits(at_least=-1e12, at_most=1e12)
RATE, NOT_NEGATIVE = Limits(at_least=1e-9, at_most=1e9), Limits(at_least=0.0, at_most=1e12)
RESTITUTION, DAMPING_RATIO = Limits(at_least=1e-12, at_most=1.0), Limits(at_least=0.0, at_most=1e6)
WEIGHT, SIZE, PART, LOST = (Limits(at_least=0.0, at_most=most) for most in (LARGEST_WEIGHT, 1e3, 1.0, 0.99))
SECONDS, OFFSET = SIZE, Limits(at_least=-1e3, at_most=1e3)
NEWTONS, EXPONENT = Limits(at_least=0.0, at_most=1e6), Limits(at_least=0.0, at_most=10.0)
FORCE, SHARE, GAP = Scale(0.0, 1000.0, 0.0, "log1p"), Scale(0.0, 1.0, 0.0), Scale(-0.5, 0.5)
SINCE_ALARM = Scale(0.0, AFTER_ALARM, 0.0, ends="after_alarm")
SENSED, ALARMED = ("reaction_delay", "force_noise", "force_bias", "alarm"), ("reaction_delay", "alarm")


def channel(way: str, place: int) -> tuple[Quantity, ...]:
    """Return the numbers of a channel; its draws begin at a place."""
    words = {"uplink": "the operator's commands", "downlink": "what the operator sees"}[way]
    rows = (
        ("delay", f"least delay of {words}", "s", SECONDS, Scale(0.0, 0.5, 0.0)),
        ("jitter", f"mean of a random delay of {words}", "s", SECONDS, Scale(0.0, 0.5, 0.0)),
        ("tail", f"mean of a longer random delay of {words}", "s", SECONDS, Scale(0.0, 0.5, 0.0)),
        ("tail_share", f"share of {words} with the longer delay", "-", PART, SHARE),
        ("loss", f"share of {words} that is lost", "-", LOST, SHARE),
        ("burst", f"mean number of losses in a row of {words}", "-", Limits(at_least=1.0, at_most=1e6), SHARE),
        ("timeout", "silence after which the arm stops", "s", POSITIVE, Scale(0.0, 0.5, 0.0)),
    )  # fmt: skip
    return tuple(
        Quantity(f"{way}.{name}", about, unit, limits, own(place + k), scale=scale)
        for k, (name, about, unit, limits, scale) in enumerate(rows)
        if (way, name) != ("downlink", "timeout")
    )


SENSORS = (
    Quantity("position", "flange position", "m", observed="always", scale=Scale(-0.25, 0.75, ends="operator")),
    Quantity("velocity", "flange velocity", "m/s", observed="always", scale=Scale(-0.5, 1.5, ends="velocity_range")),
    Quantity("time", "time", "s", observed="always", scale=Scale(0.0, 1.25 * HORIZON, ends="horizon")),
    Quantity("alarm", "alarm", "-", observed="always", scale=SHARE, shaped_by=ALARMED),
    Quantity("time_since_alarm", "time since the alarm", "s", observed="always", scale=SINCE_ALARM, shaped_by=ALARMED),
    Quantity("force", "contact force as sensed a delay ago", "N", observed="always", scale=FORCE, shaped_by=SENSED),
    Quantity("force_peak", "largest sensed force so far", "N", observed="always", scale=FORCE, shaped_by=SENSED),
)  # fmt: skip
"""Readings of the sensors at each step."""

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
    Quantity("noise_seed", "seed of the force noise", "-", Limits(at_least=0.0, at_most=2.0**53), Draw(10)),
)  # fmt: skip
"""What else an episode draws; with the scenario the keys of the final `info["record"]`."""

SET_UP = (
    Quantity("tool_mass", "tool mass", "kg", MASS, own(0, True), scale=Scale(0.01, 10.0, curve="log"),
             path="tool.mass"),
    Quantity("alarm_threshold", "contact force above which the alarm is sent", "N",
             Limits(at_least=1e-6, at_most=1e6), own(1, True), scale=Scale(0.1, 100.0, curve="log")),
    Quantity("range_noise", "standard deviation of the distance estimate", "m", SIZE,
             own(2), "observe_range_noise", Scale(0.0, 0.05, 0.0)),
    Quantity("range_bias", "error of every distance estimate", "m", OFFSET, own(3), scale=Scale(-0.1, 0.1)),
    Quantity("force_noise", "standard deviation of each force reading", "N", NEWTONS, own(4, True),
             scale=Scale(0.01, 10.0, curve="log")),
    Quantity("force_bias", "standard deviation of the force error of an episode", "N", NEWTONS, own(5),
             scale=Scale(0.0, 2.0)),
    Quantity("friction", "Coulomb friction of the object on the ground", "-", SIZE,
             own(17), scale=Scale(0.0, 1.0, 0.0), path="object.friction"),
    Quantity("coupling.stiffness", "stiffness of the coupling", "N/m", STIFFNESS, own(6, True),
             scale=Scale(1.0, 1e4, curve="log")),
    Quantity("coupling.damping_ratio", "damping ratio of the coupling", "-", DAMPING_RATIO, own(7),
             scale=Scale(0.0, 2.0)),
    Quantity("coupling.free_length", "free length of the mechanism's spring", "m", LENGTH, own(8),
             scale=Scale(0.0, 0.2)),
    Quantity("coupling.height", "height of the mechanism's pivot above its path", "m", LENGTH, own(9),
             scale=Scale(0.0, 0.1)),
    Quantity("coupling.front_stop", "front stop of the mechanism", "m", PLACE, own(10), scale=Scale(0.0, 0.1)),
    Quantity("coupling.rear_stop", "rear stop of the mechanism", "m", PLACE, own(11), scale=Scale(-0.1, 0.0)),
    Quantity("coupling.stop_stiffness", "stiffness of the mechanism's stops", "N/m", STOP, own(12, True),
             scale=Scale(1e3, 1e7, curve="log")),
    Quantity("coupling.stop_damping_ratio", "damping ratio of the mechanism's stops", "-", DAMPING_RATIO, own(13),
             scale=Scale(0.0, 2.0)),
    Quantity("coupling.stroke", "way of the tool to its stops, either side", "m", LENGTH, own(18),
             scale=Scale(0.0, 0.1, 0.0)),
    Quantity("robot.mass", "effective mass of the robot", "kg", MASS, own(14, True),
             scale=Scale(0.1, 100.0, curve="log")),
    Quantity("robot.stiffness", "stiffness of the robot", "N/m", STIFFNESS, own(15, True),
             scale=Scale(1e3, 1e7, curve="log")),
    Quantity("robot.damping", "damping of the robot", "N s/m", NOT_NEGATIVE, own(16), scale=Scale(0.0, 500.0)),
    Quantity("operator.speed", "fastest command of the operator", "m/s", POSITIVE, own(19), scale=Scale(0.0, 1.0)),
    Quantity("operator.reaction", "reaction time of the operator", "s", SECONDS, own(20), scale=Scale(0.0, 0.5, 0.0)),
    Quantity("operator.place_error", "how far beyond the object the operator believes it", "m",
             OFFSET, own(21), scale=Scale(-0.2, 0.2)),
    Quantity("operator.creep", "speed at which the operator searches further", "m/s", POSITIVE,
             own(22), scale=Scale(0.0, 0.5, 0.0)),
    Quantity("operator.lag_slope", "share by which a second of lag lengthens a reach", "1/s", NOT_NEGATIVE, own(23),
             scale=Scale(0.0, 10.0, 0.0)),
    Quantity("operator.noise", "noise of the operator's control as a share of it", "-", EXPONENT, own(27),
             scale=Scale(0.0, 1.0, 0.0)),
    Quantity("operator.stiffness", "stiffness of the operator's hand over its mass", "1/s^2", STIFFNESS, own(28, True),
             scale=Scale(1.0, 1e3, curve="log")),
    Quantity("operator.damping", "damping of the operator's hand over its mass", "1/s", NOT_NEGATIVE, own(29),
             scale=Scale(0.0, 20.0, 0.0)),
    Quantity("operator.gain", "crossover frequency of the operator", "rad/s", RATE, own(30),
             scale=Scale(0.0, 10.0, 0.0)),
    Quantity("operator.recording", "which of several recordings is played, its fraction dropped", "-",
             Limits(at_least=0.0, at_most=1e6), own(47), scale=Scale(0.0, 1e3, 0.0)),
    *channel("uplink", 33),
    *channel("downlink", 40),
    Quantity("range_sensor.noise", "standard deviation of each range reading at contact", "m",
             SIZE, own(48), scale=Scale(0.0, 0.05, 0.0)),
    Quantity("range_sensor.share", "further standard deviation as a share of the gap", "-", PART, own(49), scale=SHARE),
    Quantity("range_sensor.bias", "error of all range readings of the episode", "m",
             OFFSET, own(50), scale=Scale(-0.1, 0.1)),
    Quantity("range_sensor.dropout", "share of range readings that is lost", "-", LOST, own(51), scale=SHARE),
    Quantity("range_sensor.delay", "delay of range readings", "s", SECONDS, own(52), scale=Scale(0.0, 0.5, 0.0)),
)  # fmt: skip
"""Numbers of a set-up, arguments of the environment that may be ranges."""

DEFLECTION = Quantity("deflection", "tool minus flange from rest, as sensed a delay ago", "m", scale=Scale(-0.05, 0.05),
                      observed="deflection_sensor", shaped_by=("reaction_delay",))  # fmt: skip
PAST = tuple(
    replace(row, id=f"{row.id}_{before}", words=f"{row.words}, {before} before", observed="past_readings")
    for before in range(1, PAST_READINGS + 1)
    for row in (SENSORS[5], DEFLECTION)
)
SPEEDS = Scale(-0.5, 1.5, ends="velocity_range")
AGE, SPREAD, LAST_READ = (Scale(0.0, high, 0.0) for high in (1.0, 0.2, 0.5))
COMMANDS = (
    Quantity("command", "newest command of the operator that has arrived", "m/s", observed="operator", scale=SPEEDS),
    Quantity("command_age", "time since it was sent", "s", observed="operator", scale=AGE),
    Quantity("command_age_mean", "mean age of commands as they arrived", "s", observed="operator", scale=AGE),
    Quantity("command_age_spread", "standard deviation of that age", "s", observed="operator", scale=SPREAD),
    Quantity("executed", "velocity that the flange was last sent to", "m/s", observed="operator", scale=SPEEDS),
)  # fmt: skip
"""What the arm knows of the operator's commands."""
MORE_SENSORS = (
    DEFLECTION,
    *PAST,
    *COMMANDS,
    Quantity("range", "gap from tool to object as last read", "m", observed="range_sensor", scale=LAST_READ),
    Quantity("range_age", "time since that reading was taken", "s", observed="range_sensor", scale=LAST_READ),
    Quantity("time_since_touch", "time since a switch would have raised the alarm", "s", observed="privileged",
             scale=SINCE_ALARM),
)  # fmt: skip
"""Further readings, which arguments of the environment add."""

RESULTS = (
    Quantity("object_velocity", "V_p, the velocity that the object keeps", "m/s"),
    Quantity("approach_time", "time until the first contact", "s"),
    Quantity("peak_force", "largest contact force", "N"),
    Quantity("contact_count", "number of contacts", "-"),
    Quantity("missed", "whether the object was not touched", "-"),
)
"""Results of an episode."""

STEERED = (
    Quantity("done_time", "time until the end, when the object rests and the operator or the tool is done", "s"),
    Quantity("late", "time from a touch until the operator's stop reaches the arm, on average", "s"),
    Quantity("taken", "share of the operator's motion before the touch that was withheld", "-"),
)
"""Further results with an operator."""

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
    Quantity("duration", "length of a run", "s", Limits(at_least=1e-12, at_most=1e12)),
    Quantity("rtol", "relative error allowed in a contact", "-", Limits(at_least=1e-13, at_most=1e-2)),
    Quantity("force_weight", "cost of the peak force", "m/s per N", WEIGHT),
    Quantity("horizon", "end of an episode without an alarm", "s", Limits(at_least=1e-3, at_most=1e3)),
    Quantity("after_alarm", "time from the alarm to the end of an episode", "s", Limits(at_least=1e-3, at_most=1e3)),
    Quantity("missed_cost", "cost of an object that was not touched", "m/s", WEIGHT),
    Quantity("control_period", "control period", "s", Limits(at_least=1e-4, at_most=0.15)),
    Quantity("velocity_range", "what the first action is mapped to", "m/s", OFFSET),
    Quantity("acceleration_range", "what the second action is mapped to", "m/s^2", Limits(at_least=1e-9, at_most=1e6)),
)
"""Numbers of a scene, its motion or its run alone, and arguments of the environment that are never drawn."""

QUANTITIES: dict[str, Quantity] = {
    row.id: row for row in (*SENSORS, *SCENARIO, *EPISODE, *SET_UP, *MORE_SENSORS, *RESULTS, *STEERED, *OTHERS)
}
"""The table by id; in the order of the observation."""

BY_PATH: dict[str, Quantity] = {row.path or row.id: row for row in QUANTITIES.values() if row.path or "." in row.id}
"""The numbers of a scene and its motion, by dotted path."""
