"""One step of each method, on smooth pieces of every chain, with the kernels opened for tests (`kernel_access.pyx`)."""

from functools import partial
from itertools import product

import numpy as np
import pytest
from kernel_access import kernels
from scipy.integrate import solve_ivp
from solver_scenes import TABLE

import impact_gym as ig
from impact_gym.pack import pack_approach

COUPLINGS = {"rigid": ig.Rigid(), "spring": ig.SpringDamper(150.0, 0.4), "bistable": ig.Bistable()}
ROBOTS = {"": None, " on a robot": ig.Robot(5, 1e5, 100), " on a table": TABLE}
WIDTHS = {"rigid": 4, "spring": 7, "rigid on a robot": 7}  # of scaled states; of all others 10
PRESSED = {"": 0, ", front stop": 1, ", rear stop": -1}
EXPONENTS = (1.5, 1.5), (2.0, 1.0), (1.0, 0.0), (2.2, 1.1), (1.0, 3.0)
PIECES = [  # with every stop pressed; without "flight" it has a closed form
    f"{chain}, {phase}{stop}" for chain in (coupling + robot for coupling, robot in product(COUPLINGS, ROBOTS))
    for phase in (["contact"] if chain in WIDTHS else ["contact", "flight"])
    for stop in (PRESSED if chain.startswith("bistable") else [""])
]  # fmt: skip


def state(name, seed=0):
    """A random scaled state of the piece's chain."""
    return np.random.default_rng(seed).uniform(0.2, 1.5, WIDTHS.get(name.split(", ")[0], 10))


def stepper(name, contact=None, acceleration=3.0, force=3.0):
    """A function of scaled state and step length that returns a step on a piece, with its rates and errors."""
    chain, phase, *stop = name.split(", ")
    robot = next(robot for robot in reversed(ROBOTS) if chain.endswith(robot))
    contact, coupling = contact or ig.Contact(1e3, 0.5, "exact"), COUPLINGS[chain.removesuffix(robot)]
    moving = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.3), contact, coupling, ROBOTS[robot])
    approach, table = pack_approach(moving, ig.Trapezoid(1.0, 8.0), 1.0)
    row = np.zeros(1, kernels().CHAIN)
    row["units"] = (0.01, 0.02, 0.5, force)  # arbitrary, so that no factor cancels
    row["force_active"] = row["side"] = 1
    row["flange_position"], row["flange_velocity"] = 0.14, 0.8
    row["pressed"] = PRESSED["".join(f", {which}" for which in stop)]
    piece = approach, table, row, acceleration, phase == "flight"  # m/s^2, of the flange
    return lambda x, h=1e-3, method="explicit": kernels().step_once(*piece, np.ascontiguousarray(x), h, method)


@pytest.mark.parametrize(("name", "mass"), [("rigid", 0.25), ("spring", 1 / 12), ("rigid on a robot", 5.125 / 21.5)])
def test_general_equations_agree_with_those_of_an_analytic_piece(name, mass):
    step = stepper(f"{name}, contact", force=mass * 0.5 / 0.02)  # kg, reduced mass; the units of a real contact
    general, analytic = (step(state(name), method=method)["rate"] for method in ("explicit", "series"))
    assert general[:6] == pytest.approx(analytic[:6], rel=1e-14)  # the last ones are other integrals


@pytest.mark.parametrize("exponents", EXPONENTS, ids=str)
def test_jacobian_is_that_of_the_rates_and_slopes_of_the_events(exponents):
    for name, method in product(PIECES, ("explicit", "stiff")):
        piece, x = stepper(name, ig.Contact(1e3, 0.5, "exact", *exponents)), state(name)
        step = partial(piece, method=method)
        at, changes = step(x), np.diag(1e-6 * np.maximum(np.abs(x), 1.0))
        columns = [(step(x + change)["rate"] - step(x - change)["rate"]) / (2 * change.max()) for change in changes]
        measured = np.array(columns).T
        assert at["jacobian"] == pytest.approx(measured, rel=1e-5, abs=1e-7 * np.abs(measured).max())
        assert np.abs(measured).max() > 0.1
        climbs = (step(x + 1e-6 * at["rate"])["height"] - step(x - 1e-6 * at["rate"])["height"]) / 2e-6
        assert at["slope"] == pytest.approx(climbs, rel=1e-5, abs=1e-6)
        assert np.abs(climbs).max() > 0.01


@pytest.mark.parametrize(("method", "what", "longest", "order"), [
    ("explicit", "end", 0.2, 8.5), ("explicit", "middle", 0.2, 7.5), ("explicit", "error", 0.1, 7.5),
    ("series", "end", 0.4, 12.2), ("series", "middle", 0.8, 12.2),
    ("stiff", "end", 0.05, 5.6), ("stiff", "error", 0.05, 4.8),
])  # fmt: skip
def test_error_of_a_halved_step_falls_with_the_order(method, what, longest, order):
    simple = "spring on a robot, contact" if method == "explicit" else "spring, contact"
    for piece in (simple, "bistable on a robot, contact")[: 1 if method == "series" else 2]:
        step, x, errors = stepper(piece), state(piece), []

        def rates(_, y, step=step):
            return step(y, method=method)["rate"]

        for h in longest * 0.5 ** np.arange(3):
            compiled, at = step(x, h, method)[what], 0.5 * h if what == "middle" else h
            end = solve_ivp(rates, (0.0, at), x, "DOP853", rtol=3e-14, atol=1e-16).y[:, -1]
            errors.append(compiled if what == "error" else np.abs(compiled - end).max())
        found = np.log2(np.divide(errors[:-1], errors[1:]))
        assert np.all(found > order), (piece, errors, found)  # of one step: one above the method's


@pytest.mark.parametrize("acceleration", [-30.0, 3.0])
@pytest.mark.parametrize("name", ["spring on a robot", "rigid on a table", "spring on a table"])
def test_blind_step_of_a_flight_ends_before_any_touch(name, acceleration):
    step, random = stepper(f"{name}, flight", acceleration=acceleration), np.random.default_rng(2)
    lengths = []
    for seed in range(40):
        size = 1.0 if seed < 25 else 1e-2  # little energy, and a near object
        x = state(name, seed) * random.choice([-1.0, 1.0], 10) * size
        x[0] = -(10 ** random.uniform(-3, 1)) * size
        lengths.append(step(x)["blind"])
        path = solve_ivp(lambda _, y: step(y)["rate"], (0.0, lengths[-1]), x, max_step=0.1, rtol=1e-6).y[0]
        assert path.max() < 0.0
    assert np.sum(np.array(lengths) > kernels().BLIND[1]) > 10


def test_fastest_rate_of_a_series_is_the_largest_eigenvalue():
    for restitution, seed in product([0.5, 0.02], range(10)):
        step = stepper("rigid, contact", ig.Contact(1e3, restitution, "exact"))
        found = step(state("rigid, contact", seed), method="series")
        assert found["fastest"] == pytest.approx(np.abs(np.linalg.eigvals(found["jacobian"])).max(), rel=1e-9)
