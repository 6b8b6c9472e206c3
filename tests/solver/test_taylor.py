"""Smooth pieces against Taylor series of order 20 and more: heyoka's, which shares nothing with the solver."""

import math

import pytest
from scipy.optimize import brentq

import impact_gym as ig

hy = pytest.importorskip("heyoka")

TOOL, OBJECT, DISTANCE, STIFFNESS = 0.125, 0.25, 0.25, 1e5  # kg, kg, m, N/m^1.5
MOTION = ig.Trapezoid(3.0, 8.0)  # of constant acceleration up to 0.375 s; the object is reached at 0.25 s
TIGHT = 1e-16  # of the series' truncation
SIDES = {1: hy.event_direction.positive, -1: hy.event_direction.negative}


def solved(equations, start, event, side):
    """State where `event` first crosses zero to the other side."""
    stop = hy.t_event(event, direction=SIDES[side])
    integrator = hy.taylor_adaptive(equations, start, tol=TIGHT, t_events=[stop])
    assert int(integrator.propagate_until(10.0)[0]) == -1
    return integrator.state.copy()


def first_contact(coupling, restitution):
    """What the first contact comes to, from Taylor series of the flight and, in the root of penetration, of itself.

    State: time, tool, its velocity, object's velocity, then penetration or its root; dt = root dsigma in contact.
    """
    a, d = MOTION.acceleration, 1.5 * (1 - restitution) / restitution  # paper, eq. 7
    t, x, v, v_p, s = hy.make_vars("t", "x", "v", "v_p", "s")

    def tool(force):
        if isinstance(coupling, ig.Rigid):
            return a + 0.0 * t
        c_t = 2 * coupling.damping_ratio * math.sqrt(coupling.stiffness * TOOL)
        return (coupling.stiffness * (a / 2 * t * t - x) + c_t * (a * t - v) - force) / TOOL  # paper, eq. 17

    flight = [(t, 1.0 + 0.0 * t), (x, v), (v, tool(0.0)), (v_p, 0.0 * t), (s, v)]
    start = solved(flight, [0.0, 0.0, 0.0, 0.0, -DISTANCE], s, 1)
    start[4], v_in = 1e-20, start[2]  # beside zero, where the gauge of separation begins
    force = STIFFNESS * (s * s * s) * (1.0 + d / v_in * (v - v_p))  # paper, eq. 5
    rates = (1.0 + 0.0 * t, v, tool(force), force / OBJECT)
    contact = [*((z, s * rate) for z, rate in zip((t, x, v, v_p), rates, strict=True)), (s, 0.5 * (v - v_p))]
    slope = 1.5 * (v - v_p) * (1.0 + d / v_in * (v - v_p)) + d / v_in * s * s * (tool(force) - force / OBJECT)
    peak, end = solved(contact, start, slope, -1), solved(contact, start, s, -1)
    peak_force = STIFFNESS * peak[4] ** 3 * (1 + d / v_in * (peak[2] - peak[3]))
    return [start[0], v_in, peak_force, end[0], end[3] - end[2], end[3]]


@pytest.mark.parametrize("restitution", [1.0, 0.8, 0.5])
@pytest.mark.parametrize("coupling", [ig.Rigid(), ig.SpringDamper(150.0, 0.4), ig.SpringDamper(50.0, 1.0)], ids=str)
def test_a_contact_is_that_of_taylor_series(coupling, restitution):
    scene = ig.Scene(ig.Tool(TOOL), ig.Object(OBJECT, DISTANCE), ig.Contact(STIFFNESS, restitution), coupling)
    found = ig.simulate(scene, MOTION, 0.37, rtol=1e-13).contacts[0]
    ours = [found.start, found.approach_velocity, found.peak_force, found.end]
    ours += [found.separation_velocity, found.object_velocity]
    assert ours == pytest.approx(first_contact(coupling, restitution), rel=1e-11)


@pytest.mark.parametrize(("begin", "end"), [(0.03, 0.08), (0.08, 0.11)])  # s, before and across the snap-through
def test_a_flight_of_the_mechanism_between_its_stops_is_that_of_taylor_series(begin, end):
    coupling, a = ig.Bistable(), 12.0  # m/s^2, more than the mechanism's peak force gives the tool
    scene = ig.Scene(ig.Tool(TOOL), ig.Object(OBJECT, 1.0), ig.Contact(STIFFNESS, 0.5), coupling)
    k, H, k_s = coupling.stiffness, coupling.height, coupling.stop_stiffness

    def spring(slider, root):  # paper, eq. 23-24
        length = root(H * H + slider * slider)
        return k * (coupling.free_length - length) * slider / length

    front = coupling.front_stop
    rest = brentq(lambda slider: spring(slider, math.sqrt) - k_s * (slider - front), front, 0.07, xtol=1e-18)

    def state(duration):  # tool and flange, m and m/s
        trace = ig.simulate(scene, ig.Trapezoid(3.0, a), duration, rtol=1e-13, trace=True).trace
        names = ("tool_position", "tool_velocity", "flange_position", "flange_velocity")
        return [getattr(trace, name)[-1] for name in names]

    x, v, f, w = hy.make_vars("x", "v", "f", "w")
    equations = [(x, v), (v, spring(rest + x - f, hy.sqrt) / TOOL), (f, w), (w, a + 0.0 * x)]
    integrator = hy.taylor_adaptive(equations, state(begin), tol=TIGHT)
    integrator.propagate_for(end - begin)
    assert state(end) == pytest.approx(integrator.state.tolist(), rel=1e-11)
