"""The independent solver by itself: its floor of the damping, and its search for events."""

from math import pi
from types import SimpleNamespace as Record

import numpy as np
import pytest
from solver_scenes import scene

import impact_gym as ig
from experiments import reference
from experiments.reference.integration import Switch, advance
from impact_gym.physics import dissipation


def test_reference_has_a_floor_for_the_velocity_in_the_damping():
    a_tenth = scene(1e5, 0.1, distance=1e-8), ig.Trapezoid(1e-7, 1e-3)  # of the floor
    (contact,) = reference.simulate(*a_tenth, 1.0).contacts
    assert contact.approach_velocity == pytest.approx(1e-7, rel=1e-9)
    delivered = dissipation.delivered(1.5 * 0.9 / 0.1 * 0.1)
    assert contact.separation_velocity == pytest.approx(1e-7 * delivered, rel=1e-8)


def first_turn(switches, method="DOP853"):
    """x'' = -x from (0, 1): x = sin(tau)."""
    swing = Record(rates=lambda _, y: [y[1], -y[0]])
    return advance(swing, 3.0, np.array([0.0, 1.0]), switches, method, 1e-11, np.full(2, 1e-13), np.inf)


@pytest.mark.parametrize(("method", "above"), [("DOP853", 1e-3), ("DOP853", 1e-8), ("Radau", 1e-6), ("LSODA", 1e-8)])
def test_advance_finds_a_switch_there_and_back_in_a_step(method, above):
    tau, y, switch = first_turn([Switch("touch", False, lambda _, y: y[0] - (1 - above))], method)
    assert switch is not None
    # near the maximum a small error of x is a large error of the time
    assert tau == pytest.approx(np.arcsin(1 - above), abs=1e-10 / np.sqrt(2 * above))
    assert y[0] == pytest.approx(1 - above, abs=1e-10)
    assert first_turn([Switch("touch", False, lambda _, y: y[0] - (1 + above))], method)[2] is None


def test_advance_stops_at_the_first_switch_and_at_once_if_wrong():
    late, early = (Switch(name, True, lambda _, y, x=x: x - y[0]) for name, x in (("late", 0.6), ("early", 0.5)))
    tau, _, switch = first_turn([late, early])
    assert (switch.name, tau) == ("early", pytest.approx(pi / 6, rel=1e-12))
    tau, y, switch = first_turn([Switch("wrong", True, lambda _, y: y[0] - 2.0)])
    assert (switch.name, tau, y.tolist()) == ("wrong", 0.0, [0.0, 1.0])
