"""The L-stable 5(4) pair Rodas5P, for what is stiff: a slow contact under a push, an overdamped spring, a hard stop.

A Rosenbrock method: linearly implicit, one factorisation of 1 / (gamma h) - J in a step and no iteration, with the
exact Jacobian J. Coefficients: Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks
within the Julia Differential Equations package (BIT Numerical Mathematics 63:27, 2023), in the form of Hairer, Wanner,
Solving Ordinary Differential Equations II (1996), IV.7, eq. 7.25. Time is a place of the state: the equations are
autonomous. It works on the same scratch array as `solver.dop853`, and below that on one matrix.
"""

import math

import numpy as np

from impact_gym.kernel import inner_kernel
from impact_gym.physics.coupling import Law
from impact_gym.solver import coupled, jacobian
from impact_gym.solver.chained import Flight, Piece
from impact_gym.solver.collision import Collision
from impact_gym.solver.dop853 import ROWS, STAGES, STATE, TRIAL
from impact_gym.solver.state import Array

ORDER = 5
FIRST, LAST = 1, 8  # rows of the eight stages; row 0 is the rate at the start of the step
RIGHT_SIDE = 9
PIVOTS, NORM, MATRIX = ROWS, ROWS + 1, ROWS + 2  # rows below those of `solver.dop853`; the matrix is the last

GAMMA = 0.21193756319429014

# fmt: off
A = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [2.849394379747939, 0.45842242204463923, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-6.954028509809101, 2.489845061869568, -10.358996098473584, 0.0, 0.0, 0.0, 0.0],
    [2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641, 0.0, 0.0, 0.0],
    [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946, 0.0, 0.0],
    [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946, 1.0, 0.0],
    [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946, 1.0, 1.0],
])
"""Weights of the earlier stages in the state of each; the last of these states and the last stage sum to the end."""

C = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-14.155112264123755, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-17.97296035885952, -2.859693295451294, 0.0, 0.0, 0.0, 0.0, 0.0],
    [147.12150275711716, -1.41221402718213, 71.68940251302358, 0.0, 0.0, 0.0, 0.0],
    [165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306, 0.0, 0.0, 0.0],
    [24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471, 0.0, 0.0],
    [
        30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623,
        -28.087943162872662, 0.0,
    ],
    [
        37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002,
        -54.66780262877968, -9.48861652309627,
    ],
])
"""Weights over h of the earlier stages on the right side of each stage's linear equations."""
# fmt: on


@inner_kernel
def attempt(law: Law | Flight, collision: Collision | Piece, work: Array, h: float) -> None:
    """Try a step of `h` from row STATE (whose rate is row 0) into row TRIAL; the last row of rates is the trial's."""
    n = coupled.width(law)
    matrix = work[MATRIX:]
    jacobian.fill(law, collision, work[STATE], matrix)
    largest = 0.0
    for row in range(n):
        total = 0.0
        for column in range(n):
            total += abs(matrix[row, column])
            matrix[row, column] = -matrix[row, column]
        matrix[row, row] += 1.0 / (GAMMA * h)
        largest = max(largest, total)
    work[NORM, 0] = largest
    factorise(n, matrix, work[PIVOTS])
    for stage in range(LAST):
        target, right_side = work[FIRST + stage], work[RIGHT_SIDE]
        for component in range(n):
            place = work[STATE, component]
            bias = 0.0
            for earlier in range(stage):
                place += A[stage, earlier] * work[FIRST + earlier, component]
                bias += C[stage, earlier] * work[FIRST + earlier, component]
            work[TRIAL, component] = place
            target[component] = bias / h
        coupled.rate(law, collision, work[TRIAL], right_side)
        for component in range(n):
            target[component] += right_side[component]
        solve(n, matrix, work[PIVOTS], target)
    for component in range(n):
        work[TRIAL, component] += work[LAST, component]
    coupled.rate(law, collision, work[TRIAL], work[STAGES - 1])


@inner_kernel
def factorise(n: int, matrix: Array, pivots: Array) -> None:
    """Replace the first `n` rows and columns of `matrix` by their LU factors; rows are exchanged as `pivots` says."""
    for k in range(n):
        pivot = k
        for row in range(k + 1, n):
            if abs(matrix[row, k]) > abs(matrix[pivot, k]):
                pivot = row
        pivots[k] = pivot
        if pivot != k:
            for column in range(n):
                matrix[k, column], matrix[pivot, column] = matrix[pivot, column], matrix[k, column]
        for row in range(k + 1, n):
            if matrix[row, k] != 0.0:
                share = matrix[row, k] / matrix[k, k]
                matrix[row, k] = share
                for column in range(k + 1, n):
                    matrix[row, column] -= share * matrix[k, column]


@inner_kernel
def solve(n: int, matrix: Array, pivots: Array, vector: Array) -> None:
    """Replace `vector` by the solution of the factorised equations with it on the right side."""
    for k in range(n):
        pivot = int(pivots[k])
        vector[k], vector[pivot] = vector[pivot], vector[k]
    for k in range(n):
        for earlier in range(k):
            vector[k] -= matrix[k, earlier] * vector[earlier]
    for k in range(n - 1, -1, -1):
        for later in range(k + 1, n):
            vector[k] -= matrix[k, later] * vector[later]
        vector[k] /= matrix[k, k]


@inner_kernel
def error(law: Law | Flight, work: Array, tolerance: float) -> float:
    """Estimated local error of the last attempt over what `tolerance` allows, measured as in `dop853.error`."""
    n = coupled.width(law)
    total = 0.0
    for component in range(n):
        size = tolerance * max(abs(work[STATE, component]), abs(work[TRIAL, component]), 1.0)
        total += (work[LAST, component] / size) ** 2
    return math.sqrt(total / n) if math.isfinite(total) else math.inf
