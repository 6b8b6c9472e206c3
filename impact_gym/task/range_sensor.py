"""The range sensor on the tool: a reading of the gap to the object at every control step."""

from dataclasses import dataclass

from impact_gym.parameters import Parameters


@dataclass(frozen=True, slots=True)
class RangeSensor(Parameters, path="range_sensor"):
    """A proximity sensor on the tool, which looks ahead.

    At every control step it reads the gap between the faces of tool and object, normally distributed about gap + `bias`
    with a standard deviation of `noise` + `share` x gap; no reading is below 0. A share `dropout` of the readings is
    lost; the others reach the controller `delay` later. Until the first arrives, range and age are infinite. In a dict
    each number may be a pair, from which episodes draw: a bias of (-0.005, 0.005) differs between episodes.
    """

    noise: float = 0.0  # m
    share: float = 0.0  # -
    bias: float = 0.0  # m
    dropout: float = 0.0  # -
    delay: float = 0.0  # s
