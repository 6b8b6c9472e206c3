"""The approaches that are timed: six with a name, and a population drawn at random."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from impact_gym.kernels import draw

import impact_gym as ig
from experiments.paper.scenes import DISTANCE, MECHANISM, MOTION, TOOL_MASS, decoupled, held
from experiments.speed_vs_error.quantities import Solution, solution_of
from impact_gym.envs.scenario import FIELDS, LOGARITHMIC, NAMED

POPULATION_SEED = 20_000  # of scene 0
SOURCES = (__name__, "experiments.paper.scenes", "impact_gym.envs.scenario")
"""What the approaches follow from."""
CRUISE = ig.Trapezoid(1.0, 8.0, ig.Brake(threshold=1.0, delay=10.0))  # the alarm is noted, the robot goes on


@dataclass(frozen=True)
class Approach:
    """One approach from rest, over `duration` s."""

    name: str
    description: str
    scene: ig.Scene
    motion: ig.Trapezoid
    duration: float

    @property
    def run(self) -> tuple[ig.Scene, ig.Trapezoid, float]:
        """What `simulate` takes."""
        return self.scene, self.motion, self.duration

    def solved(self, simulate: Callable[..., Any] = ig.simulate, **options: Any) -> Solution:
        """Return the solution by impact_gym, or by `simulate` of the reference."""
        return solution_of(simulate(*self.run, **options), self.duration)


def _at_threshold() -> Approach:
    """Bistable tool of Fig. 23, a little slower than the speed above which the slider passes its alignment for good.

    That speed lies between 0.9772 and 0.9773 m/s; see `experiments.paper.beyond_speed`, which places the object so too.
    """
    speed = 0.9772
    distance = speed**2 / (2 * MOTION.acceleration) + speed * (DISTANCE - 1 / (2 * MOTION.acceleration))
    motion = ig.Trapezoid(speed, MOTION.acceleration, MOTION.brake)
    words = "bistable coupling 4e-5 m/s below its threshold, k_c 1e3, e 0.1"
    return Approach("bistable", words, held(MECHANISM, 1e3, 0.1, distance), motion, 1.5)


def named() -> tuple[Approach, ...]:
    """Return the six approaches."""
    heavy = ig.Object(1.0, DISTANCE)
    pushed = "k_c 1e8, e 0.1, spring 150 N/m, no brake: the second contact is slow and pushed"
    bouncing = ig.Scene(ig.Tool(TOOL_MASS), heavy, ig.Contact(1e6, 1.0), ig.SpringDamper(150.0, 1.0))
    return (
        Approach("soft", "k_c 1e3, e 0.7, spring 50 N/m", decoupled(1e3, 0.7, 50.0), MOTION, 1.5),
        Approach("stiff", "k_c 1e8, e 0.7, spring 50 N/m: two short contacts", decoupled(1e8, 0.7, 50.0), MOTION, 1.5),
        Approach("inelastic", "k_c 1e5, e 0.02 (d = 73.5), spring 50 N/m", decoupled(1e5, 0.02, 50.0), MOTION, 1.5),
        Approach("multiple", "k_c 1e6, e 1, spring 150 N/m, object 1 kg: six contacts", bouncing, MOTION, 1.5),
        Approach("pushed", pushed, decoupled(1e8, 0.1, 150.0), CRUISE, 0.8),
        _at_threshold(),
    )


def population(count: int) -> tuple[Approach, ...]:
    """Return scenes with objects and contacts as the environment draws them, and one of four couplings.

    The couplings are that of the environment (50 N/m, critically damped), another spring and damper (10 to 2000 N/m,
    log-uniform, damping ratio 0 to 2), none and the bistable mechanism; the motion is the paper's.
    """
    return tuple(map(_member, range(count)))


def _member(place: int) -> Approach:
    rng = np.random.default_rng(POPULATION_SEED + place)
    ranges = zip(NAMED["test"].pairs(), LOGARITHMIC, rng.random(len(FIELDS)), strict=True)
    mass, stiffness, restitution, distance = (draw(low, high, log, u) for (low, high), log, u in ranges)
    spring = ig.SpringDamper(draw(10.0, 2000.0, True, rng.random()), 2.0 * rng.random())
    couplings = {"spring of 50 N/m": ig.SpringDamper(50.0, 1.0), "spring": spring, "rigid": ig.Rigid()}
    couplings["bistable"] = MECHANISM
    kind = list(couplings)[place % 4]
    scene = ig.Scene(ig.Tool(TOOL_MASS), ig.Object(mass, distance), ig.Contact(stiffness, restitution), couplings[kind])
    words = f"{kind}, k_c {stiffness:.3g}, e {restitution:.3f}, object {mass:.3f} kg at {distance:.3f} m"
    return Approach(f"{place:03d}", words, scene, MOTION, 1.2)


def approach_of(name: str) -> Approach:
    """Return the approach of this name."""
    return _member(int(name)) if name.isdecimal() else {one.name: one for one in named()}[name]
