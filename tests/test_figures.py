"""The figures of the paper say what its text says."""

import importlib

import numpy as np
import pytest

from experiments.paper import __main__ as command
from experiments.paper import figure_05, figure_16, figure_17, tables


@pytest.mark.parametrize("number", command.NUMBERS)
def test_a_figure_is_drawn_from_its_table_on_disk(number, tmp_path):
    module = importlib.import_module(f"experiments.paper.figure_{number:02}")
    table = module.compute()
    tables.write(tmp_path / "table.csv", table)
    again = tables.read(tmp_path / "table.csv")
    assert list(again) == list(table)
    for name, column in table.items():
        assert (again[name] == column).all()
    figure = module.plot(again)
    for axes in figure.axes:
        assert axes.get_xlabel() or axes.get_title()
        assert axes.get_ylabel()
        assert axes.has_data()


def test_the_damping_force_changes_sign_where_the_penetration_peaks():
    trace = tables.trace_of(figure_05.compute(), "a")
    penetration = trace.tool_position - trace.object_position
    elastic = figure_05.STIFFNESS * np.maximum(penetration, 0.0) ** 1.5
    touching = trace.contact_force > 0.0
    damping = (trace.contact_force - elastic)[touching]
    change = trace.time[touching][np.flatnonzero(damping < 0.0)[0]]
    assert change == pytest.approx(trace.time[np.argmax(penetration)], abs=2e-4)
    assert change == pytest.approx(0.321, abs=5e-4)  # printed in the paper, section 2.2


def test_the_fixed_tool_strikes_almost_twice_as_hard():
    table = figure_05.compute()
    fixed, free = (tables.trace_of(table, case).contact_force.max() for case in "ab")
    assert fixed / free == pytest.approx(3**0.6, rel=1e-3)  # masses 0.25 and 0.25 / 3: F0 goes with M^(3/5)


def test_the_slope_of_the_stiffest_contact_breaks_near_90_newton_per_metre():
    table = figure_16.compute()
    stiffest = table["contact_stiffness"] == max(figure_16.CONTACT_STIFFNESSES)
    stiffness, velocity = table["coupling_stiffness"][stiffest], table["object_velocity"][stiffest]
    slope = np.diff(velocity) / np.diff(stiffness)
    range_of_text = (stiffness > 60.0) & (stiffness < 120.0)
    jump = np.where(range_of_text[1:-1], np.diff(slope), -np.inf)
    assert stiffness[1:-1][np.argmax(jump)] == pytest.approx(90.0, abs=3.0)
    contacts = table["contacts"][stiffest]
    assert (contacts[stiffness < 85.0] == 1).all()
    assert (contacts[stiffness > 95.0] == 2).all()


def test_two_force_peaks_at_the_stiffer_contact_and_one_at_the_softer():
    table = figure_17.compute()
    for case, peaks in {"a": 2, "b": 1}.items():
        force = tables.trace_of(table, case).contact_force
        inner = force[1:-1]
        assert np.sum((inner > force[:-2]) & (inner >= force[2:]) & (inner > 0.1)) == peaks
