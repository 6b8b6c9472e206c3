"""The range sensor on the tool."""

from dataclasses import dataclass

from impact_gym.parameters import Parameters


@dataclass(frozen=True, slots=True)
class RangeSensor(Parameters, path="range_sensor"):
    """A proximity sensor on the tool, which measures the gap to the object.

    For every observation, a reading is drawn from a normal distribution with mean (1 + `scale`) x gap + `bias` and
    standard deviation `noise` + `share` x gap. The errors of successive readings have the `correlation` (autoregressive
    process of order 1, stationary from the first reading on). A negative reading becomes 0, and a reading is rounded to
    a multiple of `resolution` (0: not rounded).
    The fraction `dropout` of the readings is lost, and each reading at a gap below `nearest` or above `farthest`. The
    others reach the controller `delay` later. Before the first arrival, range and age are infinite.
    For sensors that are sold see `impact_gym.sensors`.
    """

    noise: float = 0.0  # m
    share: float = 0.0  # -
    bias: float = 0.0  # m
    dropout: float = 0.0  # -
    delay: float = 0.0  # s
    scale: float = 0.0  # -
    correlation: float = 0.0  # -
    resolution: float = 0.0  # m
    nearest: float = 0.0  # m
    farthest: float = 1e3  # m

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        if self.nearest > self.farthest:
            raise ValueError(
                f"RangeSensor.nearest must be at most farthest, {self.farthest:g} m, got {self.nearest:g} m"
            )
