"""The L-stable pair: its stability, its Jacobians, and when the solver turns to it."""

import math

import numpy as np
import pytest
from impact_gym.kernels import STIFF_TABLEAU, inverse_of, step_once
from pieces import SPRING_PIECE, STATES, piece, rates_of, state
from scenes import CRUISE, scene
from scipy.integrate import solve_ivp

import impact_gym as ig

EXPONENTS = {"Hertz": (1.5, 1.5), "2-1": (2.0, 1.0), "1-0": (1.0, 0.0), "2.2-1.1": (2.2, 1.1)}


def test_the_stages_stand_at_the_published_times():
    # c = (sum of the rows of A times Gamma), Steinebach (2023), Table 1; Gamma from 1/gamma I - C = Gamma^-1
    gamma = np.linalg.inv(np.eye(8) / STIFF_TABLEAU["gamma"] - STIFF_TABLEAU["C"])
    times = (STIFF_TABLEAU["A"] @ gamma).sum(axis=1)
    published = [0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1, 1, 1]
    assert times == pytest.approx(published, abs=2e-14)


@pytest.mark.parametrize("name", STATES)
def test_a_step_is_that_of_the_tableau_with_the_linear_equations_solved_by_numpy(name):
    of, x, h = piece(name), STATES[name], 0.1
    rates, step = rates_of(of), step_once(*of, x, h, True)
    A, C, matrix = STIFF_TABLEAU["A"], STIFF_TABLEAU["C"], np.eye(len(x)) / (STIFF_TABLEAU["gamma"] * h)
    matrix -= step["jacobian"]
    k = np.zeros((8, len(x)))
    for stage in range(8):
        k[stage] = np.linalg.solve(matrix, rates(x + A[stage] @ k) + C[stage] @ k / h)
    end = x + A[7] @ k + k[7]
    assert step["end"] == pytest.approx(end, rel=1e-9, abs=1e-9)
    size = np.maximum(np.maximum(np.abs(x), np.abs(end)), 1.0)
    assert step["error"] == pytest.approx(np.sqrt(np.mean((k[7] / size) ** 2)), rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("rate", [1e4, 1e5, 1e6])
def test_steps_far_longer_than_a_decay_end_where_the_decay_does(rate):
    # an overdamped spring: y' decays to -(y + what the contact pushes) / rate; a method only A-stable keeps swinging
    of = piece(SPRING_PIECE, ig.Contact(1e3, 1.0), ig.SpringDamper(150.0, rate))
    x = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    assert abs(step_once(*of, x, 0.05, True)["jacobian"][5][5]) > 0.05 * rate
    for _ in range(4):
        x = step_once(*of, x, 0.05, True)["end"]
    step = step_once(*of, x, 0.05, True)
    slaved = x[5] - step["rate"][5] / step["jacobian"][5][5]  # where its rate vanishes
    assert x[5] == pytest.approx(slaved, rel=0.01)


@pytest.mark.parametrize("exponents", EXPONENTS.values(), ids=EXPONENTS)
@pytest.mark.parametrize("name", STATES)
def test_the_jacobian_is_that_of_the_rates(name, exponents):
    of = piece(name, ig.Contact(1e3, 0.5, "exact", *exponents))
    rates = rates_of(of)
    for seed in range(3):
        x = state(name, seed)
        written = step_once(*of, x, 0.1, True)["jacobian"]
        steps = np.diag(1e-6 * np.maximum(np.abs(x), 1.0))
        columns = [(rates(x + step) - rates(x - step)) / (2 * step.max()) for step in steps]
        measured = np.array(columns).T
        assert written == pytest.approx(measured, rel=1e-5, abs=1e-7 * np.abs(measured).max())
        assert np.abs(measured).max() > 0.1


@pytest.mark.parametrize("size", [1, 4, 10])
def test_a_matrix_is_inverted_with_rows_exchanged(size):
    matrix = np.random.default_rng(0).standard_normal((size, size))
    if size > 1:
        matrix[0, 0] = 0.0  # no pivot where one stands
    assert inverse_of(matrix) @ matrix == pytest.approx(np.eye(size), abs=1e-12)


def overdamped(ratio, stiffness=1e5):
    """A light tool on a stiff overdamped spring against a soft, heavy object: the coupling's decay is the fast part."""
    return scene(1e2, 0.5, ig.SpringDamper(stiffness, ratio), m_t=0.01, m_p=2.5, distance=0.1)


def test_a_stiff_contact_costs_no_more_steps_the_stiffer_it_is():
    steps = [ig.simulate(overdamped(ratio), CRUISE, 0.6).steps for ratio in (30.0, 300.0, 3000.0)]
    assert max(steps) < 1.5 * min(steps)  # an explicit method's would grow a hundredfold
    assert max(steps) < 500


def test_a_stiff_contact_is_that_of_an_independent_implicit_solver():
    outcome = ig.simulate(overdamped(30.0, 1e4), CRUISE, 0.3, rtol=1e-9)
    m_t, m_p, k_c, k_t, d = 0.01, 2.5, 1e2, 1e4, 1.5  # d: paper, eq. 7, of a restitution of 0.5
    c_t = 2 * 30.0 * math.sqrt(k_t * m_t)
    (touch,) = outcome.contacts

    def rates(t, state):
        tool, tool_v, thing, thing_v = state
        x_r, v_r = (4 * t * t, 8 * t) if t < 0.125 else (0.0625 + t - 0.125, 1.0)
        delta, rate = tool - thing, tool_v - thing_v
        force = max(k_c * max(delta, 0.0) ** 1.5 * (1 + d / touch.approach_velocity * rate), 0.0)
        pull = -k_t * (tool - x_r) - c_t * (tool_v - v_r)
        return [tool_v, (pull - force) / m_t, thing_v, force / m_p]

    state = [0.0, 0.0, 0.1, 0.0]
    for span in ((0.0, 0.125), (0.125, 0.3)):
        state = solve_ivp(rates, span, state, "Radau", rtol=1e-10, atol=1e-12, max_step=1e-3).y[:, -1]
    assert outcome.object_velocity == pytest.approx(state[3], rel=1e-6)
