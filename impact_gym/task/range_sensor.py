"""The range sensor on the tool."""

from dataclasses import dataclass

from impact_gym.parameters import Parameters


@dataclass(frozen=True, slots=True)
class RangeSensor(Parameters, path="range_sensor"):
    """A proximity sensor on the tool, which measures the gap to the object.

    For every observation, a reading is drawn from a normal distribution with mean gap + `bias` and standard deviation
    `noise` + `share` x gap; a negative reading becomes 0. The fraction `dropout` of the readings is lost; the others
    reach the controller `delay` later. Before the first arrival, range and age are infinite.
    """

    noise: float = 0.0  # m
    share: float = 0.0  # -
    bias: float = 0.0  # m
    dropout: float = 0.0  # -
    delay: float = 0.0  # s
