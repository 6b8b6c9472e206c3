"""The 8(5,3) pair of Dormand and Prince, DOP853 in Hairer and Wanner's code: order 8, 12 stages, first same as last.

Coefficients and error estimate: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I (1993), II.10,
in double precision. The method is its tableau; a step works on rows of one scratch array: the stages, the state the
step starts from, and the state it tries.
"""

import math

import numpy as np

from impact_gym.kernel import kernel
from impact_gym.physics.coupling import Law
from impact_gym.solver import coupled
from impact_gym.solver.chained import Flight, Piece
from impact_gym.solver.collision import Collision
from impact_gym.solver.state import Array

ORDER = 8
STAGES = 13  # the last is the rate at the end of the step
STATE, TRIAL = 13, 14  # rows of the scratch array behind the stages
ROWS = 15

# fmt: off
A = np.array([
    [
        0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    ],
    [
        0.05260015195876773, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    ],
    [
        0.0197250569845379, 0.0591751709536137, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    ],
    [
        0.02958758547680685, 0.0, 0.08876275643042054, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    ],
    [
        0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
        0.0,
    ],
    [
        0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242, 0.0, 0.0, 0.0, 0.0, 0.0,
        0.0, 0.0,
    ],
    [
        0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125, 0.0, 0.0, 0.0, 0.0,
        0.0, 0.0,
    ],
    [
        0.03709200011850479, 0.0, 0.0, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402,
        0.008273789163814023, 0.0, 0.0, 0.0, 0.0, 0.0,
    ],
    [
        0.6241109587160757, 0.0, 0.0, -3.3608926294469414, -0.868219346841726, 27.59209969944671,
        20.154067550477894, -43.48988418106996, 0.0, 0.0, 0.0, 0.0,
    ],
    [
        0.47766253643826434, 0.0, 0.0, -2.4881146199716677, -0.590290826836843, 21.230051448181193,
        15.279233632882423, -33.28821096898486, -0.020331201708508627, 0.0, 0.0, 0.0,
    ],
    [
        -0.9371424300859873, 0.0, 0.0, 5.186372428844064, 1.0914373489967295, -8.149787010746927,
        -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196, 0.0, 0.0,
    ],
    [
        2.273310147516538, 0.0, 0.0, -10.53449546673725, -2.0008720582248625, -17.9589318631188,
        27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303, 0.6433927460157636,
        0.0,
    ],
    [
        0.054293734116568765, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
        0.3111643669578199, -0.1521609496625161, 0.20136540080403034, 0.04471061572777259,
    ],
])
"""Weights of the earlier stages in each stage; the last row is also the solution of order 8."""

E5 = np.array([
        0.01312004499419488, 0.0, 0.0, 0.0, 0.0, -1.2251564463762044, -0.4957589496572502,
        1.6643771824549864, -0.35032884874997366, 0.3341791187130175, 0.08192320648511571,
        -0.022355307863886294, 0.0,
])
E3 = np.array([
        -0.18980075407240762, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
        -0.4226823213237919, -0.1521609496625161, 0.20136540080403034, 0.02265179219836082, 0.0,
])
"""Weights of all stages in the estimates of order 5 and 3."""
# fmt: on


@kernel
def attempt(law: Law | Flight, collision: Collision | Piece, work: Array, h: float) -> None:
    """Try a step of `h` from row STATE (whose rate is stage 0) into row TRIAL; the last stage is the trial's rate.

    Components stand innermost, so that one instruction moves all of them.
    """
    n = coupled.width(law)
    for stage in range(1, STAGES):
        for component in range(n):
            work[TRIAL, component] = 0.0
        for earlier in range(stage):
            weight = A[stage, earlier]
            if weight != 0.0:
                for component in range(n):
                    work[TRIAL, component] += weight * work[earlier, component]
        for component in range(n):
            work[TRIAL, component] = work[STATE, component] + h * work[TRIAL, component]
        coupled.rate(law, collision, work[TRIAL], work[stage])


@kernel
def error(law: Law | Flight, work: Array, h: float, tolerance: float) -> float:
    """Estimated local error of the last attempt over what `tolerance` allows; at most 1 is good enough.

    Each component counts relative to its size or to 1, its scale in the contact's own units; the two estimates are
    combined as in Hairer's code.
    """
    n = coupled.width(law)
    fifth = 0.0
    third = 0.0
    for component in range(n):
        e5 = 0.0
        e3 = 0.0
        for stage in range(STAGES):
            e5 += E5[stage] * work[stage, component]
            e3 += E3[stage] * work[stage, component]
        size = tolerance * max(abs(work[STATE, component]), abs(work[TRIAL, component]), 1.0)
        fifth += (e5 / size) ** 2
        third += (e3 / size) ** 2
    if not math.isfinite(fifth + third):
        return math.inf
    if fifth == 0.0:
        return 0.0
    return h * fifth / math.sqrt((fifth + 0.01 * third) * n)


@kernel
def stiffness(law: Law | Flight, work: Array) -> float:
    """Estimate of h lambda in the last attempt, lambda the largest eigenvalue of the equations (Hairer's HLAMB).

    The last two stages stand at the same time, the end of the step, with different states.
    """
    rates = 0.0
    states = 0.0
    for component in range(coupled.width(law)):
        apart = 0.0
        for stage in range(STAGES - 1):
            before = A[STAGES - 2, stage] if stage < STAGES - 2 else 0.0
            apart += (A[STAGES - 1, stage] - before) * work[stage, component]
        states += apart**2
        rates += (work[STAGES - 1, component] - work[STAGES - 2, component]) ** 2
    return math.sqrt(rates / states) if states > 0.0 else 0.0
