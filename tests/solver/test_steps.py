"""One step of each method: compiled steps against published tableaus, and the order of their errors.

The steps are on smooth pieces of every chain, with the kernels opened for tests (`kernel_access.pyx`).
"""

import math
from itertools import product

import numpy as np
import pytest
from kernel_access import kernels
from scipy.integrate import DOP853, solve_ivp

import impact_gym as ig
from impact_gym.to_kernel import approach_to_kernel

TABLE = ig.RobotTable([0.0, 0.1, 0.2, 0.3, 0.5], [3, 4, 5, 4, 6], [1e4, 2e4, 3e4, 2e4, 2e4], [10, 20, 30, 20, 20])
COUPLINGS = {"rigid": ig.Rigid(), "spring": ig.SpringDamper(150.0, 0.4), "bistable": ig.Bistable()}
ROBOTS = {"": None, " on a robot": ig.Robot(5, 1e5, 100), " on a table": TABLE}
WIDTHS = {"rigid": 4, "spring": 7, "rigid on a robot": 7}  # of scaled states; of all others 10
PRESSED = {"": 0, ", front stop": 1, ", rear stop": -1}
EXPONENTS = {"Hertz": (1.5, 1.5), "2-1": (2.0, 1.0), "1-0": (1.0, 0.0), "2.2-1.1": (2.2, 1.1), "1-3": (1.0, 3.0)}


PIECES = [  # with every stop pressed; without "flight" it has a closed form
    f"{chain}, {phase}{stop}" for chain in (coupling + robot for coupling, robot in product(COUPLINGS, ROBOTS))
    for phase in (["contact"] if chain in WIDTHS else ["contact", "flight"])
    for stop in (PRESSED if chain.startswith("bistable") else [""])
]  # fmt: skip
SPRING_PIECE = "spring, contact"


def state(name, seed=0):
    """A random scaled state of the piece's chain."""
    return np.random.default_rng(seed).uniform(0.2, 1.5, WIDTHS.get(name.split(", ")[0], 10))


def stepper(name, contact=None, coupling=None, acceleration=3.0):
    """A function of scaled state and step length that returns a step on a piece, with its rates and errors."""
    chain, phase, *stop = name.split(", ")
    robot = next(robot for robot in reversed(ROBOTS) if chain.endswith(robot))
    coupling = coupling or COUPLINGS[chain.removesuffix(robot)]
    contact = contact or ig.Contact(1e3, 0.5, "exact")
    moving = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.3), contact, coupling, ROBOTS[robot])
    plan, table = approach_to_kernel(moving, ig.Trapezoid(1.0, 8.0), 1.0)
    row = np.zeros(1, kernels().CHAIN)
    row["units"] = (0.01, 0.02, 0.5, 3.0)  # arbitrary, so that no factor cancels
    row["holding"] = row["side"] = 1
    row["flange_position"], row["flange_velocity"] = 0.14, 0.8
    row["pressed"] = PRESSED["".join(f", {which}" for which in stop)]
    piece = np.array([plan], kernels().APPROACH), table, row, acceleration, phase == "flight"  # m/s^2, of the flange
    return lambda x, h=1e-3, method="explicit", tolerance=1.0: kernels().step_once(
        *piece, np.ascontiguousarray(x), h, method, tolerance
    )


MATRIX, LAST = np.zeros((16, 16)), 12  # weights of earlier stages in each stage; the one at the end of the step
MATRIX[:12, :12], MATRIX[LAST, :12], MATRIX[13:] = DOP853.A, DOP853.B, DOP853.A_EXTRA


def test_stiff_pair_has_its_stages_at_the_published_times():
    # c = (sum of the rows of A times Gamma), Steinebach (2023), Table 1; Gamma from 1/gamma I - C = Gamma^-1
    method = kernels().STIFF_TABLEAU
    gamma = np.linalg.inv(np.eye(8) / method["gamma"] - method["C"])
    published = [0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1, 1, 1]
    assert (method["A"] @ gamma).sum(axis=1) == pytest.approx(published, abs=2e-14)


@pytest.mark.parametrize("name", PIECES)
def test_explicit_step_is_the_loop_over_its_tableau(name):
    # a plain form of `solver/dop853.pxi`, with the rates of the kernel
    step, x, h = stepper(name), state(name), 0.02  # small enough for the stops
    k = np.zeros((16, len(x)))
    for stage in range(16):
        k[stage] = step(x + h * MATRIX[stage] @ k)["rate"]
    end, compiled = x + h * MATRIX[LAST] @ k, step(x, h)
    assert compiled["rate"] == pytest.approx(k[0], rel=1e-15)
    assert compiled["end"] == pytest.approx(end, rel=1e-13, abs=1e-13)
    assert compiled["end_rate"] == pytest.approx(k[LAST], rel=1e-12, abs=1e-12)
    size = np.maximum(np.maximum(np.abs(x), np.abs(end)), 1.0)
    fifth, third = (np.sum((weights @ k[: LAST + 1] / size) ** 2) for weights in (DOP853.E5, DOP853.E3))
    assert compiled["error"] == pytest.approx(h * fifth / math.sqrt((fifth + 0.01 * third) * len(x)), rel=1e-6)
    # dense output in the middle: Hairer's polynomial from both ends, their rates and four sums over the stages
    change, upper = end - x, h * DOP853.D @ k
    parts = [change, h * k[0] - change, 2 * change - h * (k[0] + k[LAST]), *upper]
    middle = np.zeros(len(x))
    for part in reversed(parts):
        middle = 0.5 * (middle + part)  # share and 1 - share are equal there
    assert compiled["middle"] == pytest.approx(x + middle, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", PIECES)
def test_stiff_step_is_that_of_its_tableau_solved_by_numpy(name):
    step, x, h, method = stepper(name), state(name), 0.1, kernels().STIFF_TABLEAU
    x[1] = -1.5  # the bodies separate
    compiled, A, C = step(x, h, "stiff"), method["A"], method["C"]
    matrix = np.eye(len(x)) / (method["gamma"] * h) - compiled["jacobian"]
    k = np.zeros((8, len(x)))
    for stage in range(8):
        k[stage] = np.linalg.solve(matrix, step(x + A[stage] @ k)["rate"] + C[stage] @ k / h)
    end = x + A[7] @ k + k[7]
    assert compiled["end"] == pytest.approx(end, rel=1e-9, abs=1e-9)
    size = np.maximum(np.maximum(np.abs(x), np.abs(end)), 1.0)
    assert compiled["error"] == pytest.approx(np.sqrt(np.mean((k[7] / size) ** 2)), rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("exponents", EXPONENTS.values(), ids=EXPONENTS)
def test_jacobian_is_that_of_the_rates_and_slopes_of_the_events(exponents):
    for name, seed in product(PIECES, range(2)):
        step, x = stepper(name, ig.Contact(1e3, 0.5, "exact", *exponents)), state(name, seed)
        at, changes = step(x), np.diag(1e-6 * np.maximum(np.abs(x), 1.0))
        columns = [(step(x + change)["rate"] - step(x - change)["rate"]) / (2 * change.max()) for change in changes]
        measured = np.array(columns).T
        assert at["jacobian"] == pytest.approx(measured, rel=1e-5, abs=1e-7 * np.abs(measured).max())
        assert np.abs(measured).max() > 0.1
        climbs = (step(x + 1e-6 * at["rate"])["height"] - step(x - 1e-6 * at["rate"])["height"]) / 2e-6
        assert at["slope"] == pytest.approx(climbs, rel=1e-5, abs=1e-6)
        assert np.abs(climbs).max() > 0.01


@pytest.mark.parametrize(("method", "what", "longest", "order"), [
    ("explicit", "end", 0.2, 8.5), ("explicit", "middle", 0.2, 7.5), ("series", "end", 0.4, 12.2),
    ("series", "middle", 0.8, 12.2), ("stiff", "end", 0.05, 5.6), ("stiff", "error", 0.05, 4.8),
])  # fmt: skip
def test_error_of_a_halved_step_falls_with_the_order(method, what, longest, order):
    step, x = stepper(SPRING_PIECE), state(SPRING_PIECE)
    errors = []
    for h in longest * 0.5 ** np.arange(3):
        compiled = step(x, h, method)[what]
        at = 0.5 * h if what == "middle" else h
        end = solve_ivp(lambda _, y: step(y)["rate"], (0.0, at), x, "DOP853", rtol=3e-14, atol=1e-16).y[:, -1]
        errors.append(compiled if what == "error" else np.abs(compiled - end).max())
    assert np.all(np.log2(np.divide(errors[:-1], errors[1:])) > order)  # of one step: one above the method's


@pytest.mark.parametrize("acceleration", [-30.0, 3.0])
@pytest.mark.parametrize("name", ["spring on a robot", "rigid on a table", "spring on a table"])
def test_blind_step_of_a_flight_ends_before_any_touch(name, acceleration):
    step, random = stepper(f"{name}, flight", acceleration=acceleration), np.random.default_rng(2)
    longer = 0
    for seed in range(40):
        size = 1.0 if seed < 25 else 1e-2  # little energy, and a near object
        x = state(name, seed) * random.choice([-1.0, 1.0], 10) * size
        x[0] = -(10 ** random.uniform(-3, 1)) * size
        blind = step(x)["blind"]
        longer += blind > kernels().BLIND[1]
        path = solve_ivp(lambda _, y: step(y)["rate"], (0.0, blind), x, max_step=0.1, rtol=1e-6).y[0]
        assert path.max() < 0.0
    assert longer > 10
