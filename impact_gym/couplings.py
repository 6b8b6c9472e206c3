"""Couplings of tool and flange: a coupling answers for itself what simulation, checks, filters and pictures ask.

The classes check their numbers, and store them as floats in SI units; `impact_gym.quantities` has the limits.
"""

import math
import warnings
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.kernels import BISTABLE, RIGID, SPRING_DAMPER, bistable_energy, bistable_force, rest_of
from impact_gym.parameters import Parameters

STOP_STIFFNESS, STOP_DAMPING_RATIO = 1e5, 1.0
"""Default stiffness (N/m) and damping ratio of the stops of a coupling."""

_FORCE, _ENERGY = (np.vectorize(law, otypes=[np.float64]) for law in (bistable_force, bistable_energy))


class Coupling(Parameters, path="coupling"):
    """The base class of couplings, which answer for themselves; ValueError: a class lacks an answer.

    Deflections are of the tool against the flange from its rest position, in m. `tool_mass` is in kg.
    """

    __slots__ = ()
    fixed: ClassVar[bool] = False  # whether tool and flange are one body
    drawing: ClassVar[str] = ""  # kind of picture, a key of `DRAWINGS` in `impact_gym.render.chain`

    def kernel(self) -> tuple[int, dict[str, float]]:
        """Return the kind of coupling in the compiled program, and the numbers of its record, by name.

        In a sweep, numbers of the coupling can be arrays; then the numbers of the record are arrays, too.
        """
        raise self._lacks("kernel: its kind and numbers in the compiled program")

    def pull(self, deflection: float, rate: float, tool_mass: float) -> float:
        """Return the force on the tool, N, at a deflection and its rate (m/s)."""
        raise self._lacks("pull: its force on the tool")

    def lag(self, tool_mass: float, acceleration: float) -> float:
        """Return how far the tool lags behind at a steady acceleration (m/s^2) that the coupling can hold, m."""
        raise self._lacks("lag: how far the tool lags behind")

    def oscillator(self, tool_mass: float) -> tuple[float, float] | None:
        """Return the square of the natural frequency (1/s^2) and the damping (1/s) in flight; None: no deflection."""
        raise self._lacks("oscillator: how the tool moves in flight")

    def response_time(self, tool_mass: float) -> float:
        """Return the time (s) in which a deflection decays."""
        raise self._lacks("response_time: how long a deflection lasts")

    def stop_time(self, tool_mass: float) -> float:
        """Return sqrt(m / k), the time scale (s) of a tool against a stop of stiffness k; infinity: no stops."""
        raise self._lacks("stop_time: how fast its stops are")

    def simplified(self) -> "Coupling":
        """Return the simplest coupling that may do instead."""
        raise self._lacks("simplified: a simpler coupling")

    def drawn_length(self, tool_mass: float) -> float:
        """Return the distance (m) drawn between flange and tool without a deflection; soft springs are drawn long."""
        raise self._lacks("drawn_length: its length in a picture")

    @property
    def holding_force(self) -> float:
        """Force on the tool (N) up to which there is no deflection."""
        raise self._lacks("holding_force: the force that it holds")

    def _lacks(self, answer: str) -> ValueError:
        return ValueError(f"the coupling {type(self).__name__} lacks {answer}; see Coupling in impact_gym/couplings.py")


class Held(Coupling):
    """The base class of couplings that hold the tool like a fixed one, up to their `holding_force`."""

    __slots__ = ()

    def lag(self, tool_mass: float, acceleration: float) -> float:
        """Return 0: the tool moves with the flange."""
        return 0.0

    def oscillator(self, tool_mass: float) -> None:
        """Return None: there is no deflection."""

    def response_time(self, tool_mass: float) -> float:
        """Return 0: there is no deflection."""
        return 0.0

    def simplified(self) -> Coupling:
        """Return this coupling."""
        return self


@dataclass(frozen=True, slots=True)
class Rigid(Held):
    """The tool is fixed to the flange. With a rigid robot the tool's motion is imposed (paper, Fig. 4a)."""

    fixed: ClassVar[bool] = True
    drawing: ClassVar[str] = "rigid"

    def stop_time(self, tool_mass: float) -> float:
        """Infinity."""
        return math.inf

    def kernel(self) -> tuple[int, dict[str, float]]:
        """Return the kind of coupling in the compiled program; its record has no numbers."""
        return RIGID, {}

    def drawn_length(self, tool_mass: float) -> float:
        """Return the drawn length, m."""
        return 0.04

    @property
    def holding_force(self) -> float:
        """Infinity."""
        return math.inf


@dataclass(frozen=True, slots=True)
class SpringDamper(Coupling):
    """A linear spring and damper (paper, eq. 17-18); the damping is 2 zeta sqrt(k_t m_t), with the tool mass m_t.

    A `stroke` adds a stop on each side, with the stiffness and damping ratio of the default stops of `Bistable`.
    """

    stiffness: float  # N/m, k_t
    damping_ratio: float = 1.0  # -, zeta
    stroke: float | None = None  # m, from the tool's rest position to the stop at either side; None: no stops
    drawing: ClassVar[str] = "spring"

    def kernel(self) -> tuple[int, dict[str, float]]:
        """Return the kind of coupling in the compiled program, and the numbers of its record, by name."""
        numbers = {"stiffness": self.stiffness, "damping_ratio": self.damping_ratio}
        if self.stroke is not None:
            numbers |= {
                "stop_stiffness": STOP_STIFFNESS,
                "stop_damping_ratio": STOP_DAMPING_RATIO,
                "stroke": self.stroke,
            }
        return SPRING_DAMPER, numbers

    def pull(self, deflection: float, rate: float, tool_mass: float) -> float:
        """Return the force on the tool, N, at a deflection and its rate, m/s (paper, eq. 17-18)."""
        damping = 2.0 * self.damping_ratio * math.sqrt(self.stiffness * tool_mass)
        force = -self.stiffness * deflection - damping * rate
        if self.stroke and (beyond := abs(deflection) - self.stroke) > 0.0:
            force -= _stop(STOP_STIFFNESS, STOP_DAMPING_RATIO, tool_mass, beyond, rate, math.copysign(1.0, deflection))
        return force

    def lag(self, tool_mass: float, acceleration: float) -> float:
        """Return m a / k, in m."""
        return tool_mass * acceleration / self.stiffness

    def oscillator(self, tool_mass: float) -> tuple[float, float]:
        """Return k / m (1/s^2) and 2 zeta sqrt(k / m) (1/s)."""
        square = self.stiffness / tool_mass
        return square, 2.0 * self.damping_ratio * math.sqrt(square)

    def response_time(self, tool_mass: float) -> float:
        """Return the period of the undamped oscillation (s), for zeta above 1 times zeta."""
        return 2.0 * math.pi * max(self.damping_ratio, 1.0) * math.sqrt(tool_mass / self.stiffness)

    def stop_time(self, tool_mass: float) -> float:
        """Return the time scale of the stops, s; without a stroke infinity."""
        return math.sqrt(tool_mass / STOP_STIFFNESS) if self.stroke else math.inf

    def simplified(self) -> Rigid:
        """Return a rigid coupling."""
        return Rigid()

    def drawn_length(self, tool_mass: float) -> float:
        """Return the drawn length, m."""
        return 0.04 + 1.25 * math.sqrt(tool_mass / self.stiffness)

    @property
    def holding_force(self) -> float:
        """Zero."""
        return 0.0


@dataclass(frozen=True, slots=True)
class Bistable(Held):
    """A coupling by a bistable mechanism with two stops (paper, eq. 23-24, Fig. 21-22).

    The tool is fixed to its slider. Positions of the slider are measured from the alignment, where the spring is
    perpendicular to the slider's path. A stop is a linear spring and damper that never pulls; its damping is 2 zeta_s
    sqrt(k_s m_t), with the tool mass m_t. At zeta_s = 1 the restitution of a stop is exp(-2) = 0.135; the paper's stops
    are completely inelastic. The paper prints no position, stiffness or damping of a stop (docs/provenance.md). At
    t = 0 the spring presses the slider against the front stop. The slider leaves this stop if the flange acceleration
    exceeds `holding_force` / m_t.
    """

    stiffness: float = 50.0  # N/m, k
    free_length: float = 0.07  # m, L0
    height: float = 0.028  # m, H, height of the pivot above the path of the slider
    front_stop: float = 0.0208  # m, slider position; above 0 and below the stroke sqrt(L0^2 - H^2)
    rear_stop: float = -0.02  # m, slider position; above minus the stroke and below 0
    stop_stiffness: float = STOP_STIFFNESS  # N/m, k_s
    stop_damping_ratio: float = STOP_DAMPING_RATIO  # -, zeta_s
    drawing: ClassVar[str] = "bistable"

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        if not self.height < self.free_length:
            raise ValueError(
                f"Bistable.height must be below Bistable.free_length = {self.free_length!r} m, got {self.height!r} m: "
                "two stable positions need a spring that is compressed where it is perpendicular to the path"
            )
        stroke = self.stroke
        if not 0 < self.front_stop < stroke:
            allowed = f"above 0 and below the stroke {stroke:.6g} m"
            raise ValueError(f"Bistable.front_stop must be {allowed}, got {self.front_stop!r} m")
        if not -stroke < self.rear_stop < 0:
            allowed = f"above minus the stroke, {-stroke:.6g} m, and below 0"
            raise ValueError(f"Bistable.rear_stop must be {allowed}, got {self.rear_stop!r} m")

    def fits(self) -> Any:
        """Return whether the numbers, which may be arrays, pass the checks of `__post_init__`."""
        stroke = np.sqrt(np.maximum((self.free_length - self.height) * (self.free_length + self.height), 0.0))
        return (self.front_stop > 0) & (self.front_stop < stroke) & (-stroke < self.rear_stop) & (self.rear_stop < 0)

    @property
    def stroke(self) -> float:
        """Distance from the alignment to either stable equilibrium of a slider without stops, m."""
        return math.sqrt((self.free_length - self.height) * (self.free_length + self.height))

    @property
    def rest(self) -> float:
        """Position of the slider at t = 0, where the spring presses it against the front stop, m."""
        return float(rest_of(self.stiffness, self.free_length, self.height, self.front_stop, self.stop_stiffness))

    @property
    def holding_force(self) -> float:
        """Absolute force of the front stop on the tool at rest, N."""
        return float(self.force(self.rest))

    def kernel(self) -> tuple[int, dict[str, float]]:
        """Return the kind of coupling in the compiled program, and the numbers of its record, by name."""
        return BISTABLE, {name: getattr(self, name) for name in self.__slots__}

    def pull(self, deflection: float, rate: float, tool_mass: float) -> float:
        """Return the force of spring and stops on the tool, N, at a deflection and its rate, m/s (paper, eq. 23-24)."""
        place, force = self.rest + deflection, 0.0
        for stop, side in ((self.front_stop, 1.0), (self.rear_stop, -1.0)):
            if (beyond := side * (place - stop)) > 0.0:
                force -= _stop(self.stop_stiffness, self.stop_damping_ratio, tool_mass, beyond, rate, side)
        return float(self.force(place)) + force

    def stop_time(self, tool_mass: float) -> float:
        """Return the time scale of the stops, s."""
        return math.sqrt(tool_mass / self.stop_stiffness)

    def drawn_length(self, tool_mass: float) -> float:
        """Return the drawn length, m: room for the slider."""
        return 2.0 * (self.front_stop - self.rear_stop) + 0.012

    def force(self, position: ArrayLike) -> NDArray[np.float64] | float:
        """Return the force (N) of the spring alone on the tool, at slider positions (m) of any shape."""
        return _FORCE(self.stiffness, self.free_length, self.height, position)[()]

    def energy(self, position: ArrayLike) -> NDArray[np.float64] | float:
        """Return the energy of the spring, J, at slider positions (m) of any shape."""
        return _ENERGY(self.stiffness, self.free_length, self.height, position)[()]


def _stop(stiffness: float, damping_ratio: float, tool_mass: float, depth: float, rate: float, side: float) -> float:
    """Return the force of a stop that never pulls, N, in the direction `side` (1 or -1) and `depth` (m) inside it."""
    damping = 2.0 * damping_ratio * math.sqrt(stiffness * tool_mass)
    return side * max(stiffness * depth + damping * side * rate, 0.0)


COUPLINGS = (Rigid, SpringDamper, Bistable)


def warn_of_stroke(coupling: Coupling, tool_mass: float, acceleration: float) -> None:
    """Warn if a tool on a spring with a stroke would lie against a stop at a steady `acceleration` (m/s^2)."""
    stroke = coupling.stroke if isinstance(coupling, SpringDamper) else None
    if stroke and (rest := coupling.lag(tool_mass, acceleration)) > stroke:
        where = f"the tool's place of rest is {rest:.3g} m away: the tool then lies against a stop"
        text = f"SpringDamper.stroke is {stroke:g} m, but under {acceleration:g} m/s^2 {where}"
        warnings.warn(text, stacklevel=4)
