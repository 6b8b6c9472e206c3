"""The range sensor on the tool."""

from dataclasses import dataclass

from impact_gym.parameters import Parameters


@dataclass(frozen=True, slots=True)
class RangeSensor(Parameters, path="range_sensor"):
    """A proximity sensor on the tool, which measures the gap to the object.

    At every control step the reading is normally distributed about gap + `bias`, with a standard deviation of `noise` +
    `share` x gap; negative readings become 0. The fraction `dropout` of the readings is lost; the others reach the
    controller `delay` later. Before the first reading has arrived, range and age are infinite. In a dict a number may
    be a pair (low, high), from which each episode draws.
    """

    noise: float = 0.0  # m
    share: float = 0.0  # -
    bias: float = 0.0  # m
    dropout: float = 0.0  # -
    delay: float = 0.0  # s
