"""The L-stable 5(4) pair Rodas5P, for stiff pieces, such as a slow contact under a push or an overdamped spring.

A step of a Rosenbrock method needs no iteration. It inverts the matrix I / (gamma h) - J, with the exact Jacobian J.
Coefficients: Steinebach, BIT Numerical Mathematics 63:27 (2023), in the form of Hairer, Wanner, Solving Ordinary
Differential Equations II (1996), IV.7, eq. 7.25. Time is a component of the state, so the equations are autonomous.
"""

cdef enum:
    STIFF_STAGES = 8

cdef double STIFF_GAMMA = 0.21193756319429014

cdef double[STIFF_STAGES][STIFF_STAGES] STIFF_A  # row i: weights of the earlier stages in the state of stage i
STIFF_A[1][:1] = [3.0]
STIFF_A[2][:2] = [2.849394379747939, 0.45842242204463923]
STIFF_A[3][:3] = [-6.954028509809101, 2.489845061869568, -10.358996098473584]
STIFF_A[4][:4] = [2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641]
STIFF_A[5][:5] = [
    -7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946
]
STIFF_A[6][:6] = [
    -7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946, 1.0
]
STIFF_A[7][:7] = [
    -7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946, 1.0, 1.0
]  # state at the end of the step: the state at the last stage plus this stage's increment k

# row i / h: weights of the earlier stages on the right side of the equation of stage i
cdef double[STIFF_STAGES][STIFF_STAGES] STIFF_C
STIFF_C[1][:1] = [-14.155112264123755]
STIFF_C[2][:2] = [-17.97296035885952, -2.859693295451294]
STIFF_C[3][:3] = [147.12150275711716, -1.41221402718213, 71.68940251302358]
STIFF_C[4][:4] = [165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306]
STIFF_C[5][:5] = [24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471]
STIFF_C[6][:6] = [
    30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623,
    -28.087943162872662,
]
STIFF_C[7][:7] = [
    37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002,
    -54.66780262877968, -9.48861652309627,
]


cdef double stiff_step(const Piece *piece, Work *work, double h) noexcept nogil:
    """Try a step of `h` from `work.x` into `work.trial`; return (error estimate of order 4) / (allowed error)."""
    cdef int stage, earlier, i, n = piece.width
    cdef double total = 0.0, a, c, size
    cdef double[WIDTH] right
    cdef double *k
    jacobian(piece, work.x, work.matrix)
    for i in range(n):
        for earlier in range(n):
            work.matrix[i][earlier] = -work.matrix[i][earlier]
        work.matrix[i][i] += 1.0 / (STIFF_GAMMA * h)
    invert(n, work.matrix)  # faster than solving two triangular systems in each stage
    for stage in range(STIFF_STAGES):
        k = work.stage[stage]
        memcpy(work.trial, work.x, sizeof(right))
        memset(right, 0, sizeof(right))
        for earlier in range(stage):
            a, c = STIFF_A[stage][earlier], STIFF_C[stage][earlier] / h
            for i in range(WIDTH):
                work.trial[i] += a * work.stage[earlier][i]
                right[i] += c * work.stage[earlier][i]
        rates(piece, work.trial, work.trial_rate)
        memset(k, 0, sizeof(right))
        for earlier in range(n):
            c = right[earlier] + work.trial_rate[earlier]
            for i in range(WIDTH):
                k[i] += work.matrix[earlier][i] * c
    for i in range(n):
        work.trial[i] += k[i]
        size = k[i] / (piece.tolerance * max(max(fabs(work.x[i]), fabs(work.trial[i])), 1.0))
        total += size * size
    rates(piece, work.trial, work.trial_rate)
    return sqrt(total / n) if isfinite(total) else INFINITY


cdef void invert(int n, double[WIDTH] *matrix) noexcept nogil:
    """Replace the first `n` rows of `matrix` by the transposed inverse of its first `n` rows and columns, and by zeros.

    The method is that of Gauss and Jordan, with pivots.
    """
    cdef double[WIDTH][WIDTH] inverse
    cdef int k, row, column, pivot
    cdef double factor
    memset(inverse, 0, sizeof(inverse))
    for k in range(n):
        inverse[k][k] = 1.0
    for k in range(n):
        pivot = k
        for row in range(k + 1, n):
            if fabs(matrix[row][k]) > fabs(matrix[pivot][k]):
                pivot = row
        factor = 1.0 / matrix[pivot][k]
        for column in range(WIDTH):
            matrix[k][column], matrix[pivot][column] = matrix[pivot][column], matrix[k][column]
            inverse[k][column], inverse[pivot][column] = inverse[pivot][column], inverse[k][column]
        for column in range(WIDTH):
            matrix[k][column] *= factor
            inverse[k][column] *= factor
        for row in range(n):
            factor = matrix[row][k]
            if row != k and factor != 0.0:
                for column in range(WIDTH):
                    matrix[row][column] -= factor * matrix[k][column]
                    inverse[row][column] -= factor * inverse[k][column]
    for row in range(n):
        for column in range(WIDTH):
            matrix[row][column] = inverse[column][row]
