"""One step of the integrator: the explicit pair, or the L-stable one where that is held back by stiffness.

The explicit pair knows that it is by the estimate of Hairer's code: the rates of its last two stages, which stand at
the same time, differ by about lambda times their states. Near the border of its stability, h lambda about 6, its error
estimate keeps it there however smooth the motion is. Attempts near it that repeat, good or not, hand over to the
L-stable pair, which hands back as soon as its own step, for the sake of accuracy, is one the explicit pair could take.
"""

import numpy as np

from impact_gym.kernel import inner_kernel
from impact_gym.physics.coupling import Law
from impact_gym.solver import coupled, dop853, rosenbrock
from impact_gym.solver.chained import Flight, Piece
from impact_gym.solver.collision import Collision
from impact_gym.solver.dop853 import STAGES, STATE, TRIAL
from impact_gym.solver.state import Array

EXPLICIT, STIFF = 0, 1
BORDER = 6.1  # of h lambda, of the explicit pair's stability: DOP853's own
NEAR = 3.5  # from here on an attempt counts; kept at the border, good ones and bad ones alternate between 4 and 7
UNWATCHED = 25  # attempts in a smooth piece that are not looked at: most have no more
LAMBDA, SHARE = 1, 2  # places of the largest eigenvalue at the hand-over, and of its share in the norm
REPEATED = 10  # attempts near the border that hand over


@inner_kernel
def workspace(law: Law) -> Array:
    """Scratch for the steps of either kind."""
    n = coupled.width(law)
    return np.zeros((rosenbrock.MATRIX + n, n))


@inner_kernel
def attempt(method: int, law: Law | Flight, collision: Collision | Piece, work: Array, h: float) -> None:
    """Try a step of `h` from row STATE (whose rate is row 0) into row TRIAL; the last row of rates is the trial's."""
    if method == EXPLICIT:
        dop853.attempt(law, collision, work, h)
    else:
        rosenbrock.attempt(law, collision, work, h)


@inner_kernel
def error(method: int, law: Law | Flight, work: Array, h: float, tolerance: float) -> float:
    """Estimated local error of the last attempt over what `tolerance` allows; at most 1 is good enough."""
    if method == EXPLICIT:
        explicit: float = dop853.error(law, work, h, tolerance)
        return explicit
    stiff: float = rosenbrock.error(law, work, tolerance)
    return stiff


@inner_kernel
def factor(method: int, error: float) -> float:
    """Factor on the step after one of this estimated error."""
    order = dop853.ORDER if method == EXPLICIT else rosenbrock.ORDER
    return min(5.0, max(0.2, 0.9 * error ** (-1.0 / order))) if error > 0.0 else 5.0


@inner_kernel
def accept(law: Law | Flight, work: Array) -> None:
    """Make the trial the state; its rate, the last row of rates, becomes row 0."""
    for component in range(coupled.width(law)):
        work[STATE, component] = work[TRIAL, component]
        work[0, component] = work[STAGES - 1, component]


@inner_kernel
def watch(method: int, seen: int, law: Law | Flight, work: Array, h: float) -> tuple[int, int]:
    """Return the method for the next step, and how much has been `seen`: attempts, then those near the border."""
    notes = work[rosenbrock.NORM]  # norm of the Jacobian, and what the explicit pair saw of its eigenvalues
    if method == STIFF:
        if notes[SHARE] == 0.0:
            notes[SHARE] = notes[LAMBDA] / notes[0]
        return (EXPLICIT, 0) if h * notes[0] * notes[SHARE] < BORDER else (STIFF, 0)
    if seen < UNWATCHED:
        return EXPLICIT, seen + 1
    strain = dop853.stiffness(law, work)
    if strain > NEAR:
        seen += 1
    if seen < UNWATCHED + REPEATED:
        return EXPLICIT, seen
    notes[LAMBDA], notes[SHARE] = strain / h, 0.0
    return STIFF, 0
