"""The L-stable pair: its order, its stability, its Jacobians, and when the solver turns to it."""

import math
from itertools import pairwise, product

import numba
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impact_gym as ig
from impact_gym.lowering import chain_law, contact_law
from impact_gym.physics import contact
from impact_gym.physics.contact import Hertz
from impact_gym.physics.coupling import RigidLaw, SpringDamperLaw
from impact_gym.solver import coupled, jacobian, rosenbrock, stepper
from impact_gym.solver.chained import Flight, Piece
from impact_gym.solver.collision import Collision
from impact_gym.solver.dop853 import STATE, TRIAL

TABLE = ig.RobotTable([0.0, 0.1, 0.2, 0.3, 0.5], [3, 4, 5, 4, 6], [1e4, 2e4, 3e4, 2e4, 2e4], [10, 20, 30, 20, 20])


@numba.njit(error_model="numpy")
def steps_of(law, collision, start, h, count):
    """Return the state after `count` steps of `h`, and the estimated error of the last with tolerance 1."""
    work = stepper.workspace(law)
    error = 0.0
    work[STATE] = start
    coupled.rate(law, collision, work[STATE], work[0])
    for _ in range(count):
        rosenbrock.attempt(law, collision, work, h)
        error = rosenbrock.error(law, work, 1.0)
        stepper.accept(law, work)
    return work[STATE].copy(), error


@numba.njit(error_model="numpy")
def derivatives(law, now, state):
    """Return the Jacobian as written down, and by central differences of the rates."""
    n = state.size
    written, measured = np.zeros((n, n)), np.zeros((n, n))
    ahead, behind = np.zeros(n), np.zeros(n)
    jacobian.fill(law, now, state, written)
    for column in range(n):
        h = 1e-6 * max(abs(state[column]), 1.0)
        moved = state.copy()
        moved[column] = state[column] + h
        coupled.rate(law, now, moved, ahead)
        moved[column] = state[column] - h
        coupled.rate(law, now, moved, behind)
        measured[:, column] = (ahead - behind) / (2 * h)
    return written, measured


def hertz(damping, push=0.0, frequency=0.0, ratio=0.0):
    return Collision(Hertz(1.0, damping), push, frequency, ratio, 0.5, math.inf)


def test_the_stages_stand_at_the_published_times():
    # c = (sum of the rows of A times Gamma), Steinebach (2023), Table 1; Gamma from 1/gamma I - C = Gamma^-1
    gamma = np.linalg.inv(np.eye(8) / rosenbrock.GAMMA - np.hstack([rosenbrock.C, np.zeros((8, 1))]))
    times = (np.hstack([rosenbrock.A, np.zeros((8, 1))]) @ gamma).sum(axis=1)
    published = [0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1, 1, 1]
    assert times == pytest.approx(published, abs=2e-14)


def test_halving_the_step_divides_the_error_by_two_to_the_fifth_and_the_estimate_by_no_less():
    law, collision = SpringDamperLaw(1.0, 1.0, 1.0), hertz(2.0, 0.3, 1.3, 0.4)
    start, span = np.array([0.3, 0.9, 0.0, 0.0, 0.1, -0.2, 0.0, 0.0]), 1.0
    exact = steps_of(law, collision, start, span / 2048, 2048)[0]
    counts = [16, 32, 64, 128]
    found = [steps_of(law, collision, start, span / count, count) for count in counts]
    errors = [np.abs(state - exact).max() for state, _ in found]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 4.8)
    estimates = np.array([estimate for _, estimate in found])
    assert np.all(np.log2(estimates[:-1] / estimates[1:]) > 4.5)  # fourth order, over one step


@pytest.mark.parametrize("rate", [1e4, 1e6, 1e9])
def test_steps_far_longer_than_a_decay_end_where_the_decay_does(rate):
    # an overdamped spring: y' decays at `rate` to -(y + f / 2) / rate; a method only A-stable keeps swinging about it
    law, collision = SpringDamperLaw(1.0, 1.0, 1.0), hertz(0.0, 0.0, 1.0, 0.5 * rate)
    start = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    state, _ = steps_of(law, collision, start, 0.05, 4)
    slaved = -(state[4] + 0.5 * state[0] ** 3) / rate
    assert state[5] == pytest.approx(slaved, rel=0.01)


def chains():
    """Every coupling on every robot, in contact; in flight and pressed where the equations of motion know of that."""
    for coupling, robot in product(
        [ig.Rigid(), ig.SpringDamper(150.0), ig.Bistable()], [None, ig.Robot(5, 1e5, 100), TABLE]
    ):
        law = chain_law(0.125, coupling, robot)
        closed = isinstance(law, (RigidLaw, SpringDamperLaw))
        stops = (-1, 0, 1) if isinstance(coupling, ig.Bistable) else (0,)
        for flying, pressed in product((False,) if closed else (False, True), stops):
            name = f"{type(coupling).__name__}-{type(robot).__name__}-{'flight' if flying else 'contact'}-{pressed}"
            yield pytest.param(law, flying, pressed, id=name)


@pytest.mark.parametrize("exponents", [(1.5, 1.5), (2.0, 1.0), (1.0, 0.0)], ids=["Hertz", "2-1", "1-0"])
@pytest.mark.parametrize(("of_chain", "flying", "pressed"), list(chains()))
def test_the_jacobian_is_that_of_the_rates(of_chain, flying, pressed, exponents):
    of_contact = contact_law(ig.Contact(1e3, 0.5, "exact", *exponents))
    if isinstance(of_chain, (RigidLaw, SpringDamperLaw)):
        now = Collision(of_contact, 0.3, 0.7, 0.9, 0.6, 0.1)
    else:
        now = Piece(of_contact, 0.1, 0.25, contact.Scales(0.01, 0.02, 0.5, 3.0), 3.0, 0.14, 0.8, pressed, 1, 1)
        of_chain = Flight(of_chain) if flying else of_chain
    size = {RigidLaw: 4, SpringDamperLaw: 8}.get(type(of_chain), 12)
    for seed in range(3):
        state = np.random.default_rng(seed).uniform(0.2, 1.5, size)
        written, measured = derivatives(of_chain, now, state)
        assert written == pytest.approx(measured, rel=1e-5, abs=1e-7 * np.abs(measured).max())
        assert np.abs(measured).max() > 0.1


def test_the_linear_equations_are_solved_with_rows_exchanged():
    rng = np.random.default_rng(0)
    matrix = rng.standard_normal((6, 6))
    matrix[0, 0] = 0.0  # no pivot where one stands
    right = rng.standard_normal(6)

    @numba.njit
    def solved(matrix, vector):
        pivots = np.zeros(6)
        rosenbrock.factorise(6, matrix, pivots)
        rosenbrock.solve(6, matrix, pivots, vector)
        return vector

    assert solved(matrix.copy(), right.copy()) == pytest.approx(np.linalg.solve(matrix, right), rel=1e-12)


def overdamped(ratio, stiffness=1e5):
    """A light tool on a stiff overdamped spring against a soft, heavy object: the coupling's decay is the fast part."""
    return ig.Scene(
        ig.Tool(0.01), ig.Object(2.5, 0.1), ig.Contact(1e2, 0.5), ig.SpringDamper(stiffness, damping_ratio=ratio)
    )


def test_a_stiff_contact_costs_no_more_steps_the_stiffer_it_is():
    motion = ig.Trapezoid(1.0, 8.0)
    steps = [ig.simulate(overdamped(ratio), motion, 0.6).steps for ratio in (30.0, 300.0, 3000.0)]
    assert max(steps) < 1.5 * min(steps)  # an explicit method's would grow a hundredfold
    assert max(steps) < 500


def test_a_stiff_contact_is_that_of_an_independent_implicit_solver():
    scene, motion = overdamped(30.0, 1e4), ig.Trapezoid(1.0, 8.0)
    outcome = ig.simulate(scene, motion, 0.3, rtol=1e-9)
    m_t, m_p, k_c, k_t = 0.01, 2.5, 1e2, 1e4
    damping = contact_law(scene.contact).damping
    c_t = 2 * 30.0 * math.sqrt(k_t * m_t)
    (touch,) = outcome.contacts

    def flange(t):
        return (4 * t * t, 8 * t) if t < 0.125 else (0.0625 + t - 0.125, 1.0)

    def rates(t, state):
        tool, tool_v, thing, thing_v = state
        x_r, v_r = flange(t)
        delta, rate = tool - thing, tool_v - thing_v
        chi = damping * k_c / touch.approach_velocity
        force = max(k_c * max(delta, 0.0) ** 1.5 * (1 + chi / k_c * rate), 0.0)
        pull = -k_t * (tool - x_r) - c_t * (tool_v - v_r)
        return [tool_v, (pull - force) / m_t, thing_v, force / m_p]

    knots, state = [0.0, 0.125, 0.3], [0.0, 0.0, 0.1, 0.0]
    for begin, end in pairwise(knots):
        run = solve_ivp(rates, (begin, end), state, "Radau", rtol=1e-10, atol=1e-12, max_step=1e-3)
        state = run.y[:, -1]
    assert outcome.object_velocity == pytest.approx(state[3], rel=1e-6)


def test_the_scratch_keeps_no_trace_of_the_stiff_steps():
    # places to spare in the rows of rates must stay zero, or the explicit pair's error estimate reads them
    @numba.njit
    def rows_after(law, collision):
        work = stepper.workspace(law)
        work[STATE, :] = 0.5
        coupled.rate(law, collision, work[STATE], work[0])
        rosenbrock.attempt(law, collision, work, 0.1)
        return work

    law = chain_law(0.125, ig.Bistable())
    now = Piece(Hertz(1e3, 1.0), 0.1, 0.25, contact.Scales(0.01, 0.02, 0.5, 3.0), 3.0, 0.1, 0.8, 0, 1, 0)
    work = rows_after(law, now)
    assert np.all(work[:STATE, 10:] == 0.0)
    assert np.any(work[TRIAL] != 0.5)
