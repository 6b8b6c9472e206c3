"""Solvers of the study `speed`: they solve the same problems, and who is faster at an error is named."""

import ast
import shutil
import sys
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from matplotlib.figure import Figure
from solver_scenes import MOTION, scene

import impact_gym as ig
from experiments.studies.solvers import approaches, comparison, compiled, taylor
from experiments.studies.solvers.approaches import Approach, Solution
from experiments.studies.solvers.comparison import APPROACH, CALL, CONTACT, CVODE, HEYOKA, LANES, PLAIN, SCIPY, SWEEP
from experiments.studies.speed import precision

EXACT = {name: approach for name, (_, approach) in approaches.named().items()}
EXACT |= {"rigid": Approach(scene(1e5, 0.8), MOTION, 1.0), "elastic": Approach(scene(1e5, 1.0), MOTION, 1.0)}
problem = cache(comparison.problem)


@pytest.mark.parametrize("name", EXACT)
def test_named_approaches_agree_with_34_digits(name):
    heyoka = pytest.importorskip("heyoka")
    exact = taylor.TaylorApproach(*EXACT[name], 1e-30, heyoka.real128).solve()
    ours = Solution.of(ig.simulate(*EXACT[name], 1e-13), EXACT[name].duration)
    assert (ours.contacts, ours.passes) == (exact.contacts, exact.passes)
    for found, rel in (("velocity", 0.0), ("detection_time", 0.0), ("peak_force", 1e-13), ("contact_duration", 1e-13)):
        assert getattr(ours, found) == pytest.approx(float(getattr(exact, found)), rel=rel, abs=1e-13)


SETTINGS = {SWEEP: 1e-9, CALL: 1e-9, HEYOKA: 1e-9, LANES: 1e-9, PLAIN: (8, 0.1, 1e-6), CVODE: 1e-10,
            f"{SCIPY}: DOP853": 1e-9}  # fmt: skip
PACKAGES = {HEYOKA: "heyoka", LANES: "heyoka", CVODE: "sksundae"}


@pytest.mark.parametrize("solver", SETTINGS)
@pytest.mark.parametrize(("name", "what"), [("stiff", APPROACH), ("stiff", CONTACT), ("inelastic", CONTACT)])
def test_solvers_compute_the_same_velocities(name, what, solver):
    pytest.importorskip(PACKAGES.get(solver, "numpy"))
    if solver == PLAIN and shutil.which("cc") is None:
        pytest.skip("no C compiler")
    _, some, truth = problem(name, what, 16)
    contacts = [ig.simulate(*each).contacts for each in some.rows()]
    assert [each[-1].end for each in contacts[8:]] == [None] * 8  # the trajectory is compared within contacts
    if solver == LANES:  # it computes first contacts alone, to their end
        some, truth = some.part(slice(8)), np.array([each[0].object_velocity for each in contacts[:8]])
    velocities, counts, seconds = comparison.solved(solver, some, SETTINGS[solver])
    assert velocities == pytest.approx(truth, abs=1e-6)
    assert np.unique(truth[:8]).size == 8  # objects of other masses
    assert [*counts] == [len(each) if solver != LANES else 1 for each in contacts[: len(counts)]]
    assert seconds > 0.0


def test_a_rival_that_is_missing_or_fails_is_a_row(monkeypatch):
    monkeypatch.setitem(sys.modules, HEYOKA, None)
    monkeypatch.setattr(shutil, "which", lambda _: None)
    for function in (taylor.integrator, compiled.program):
        function.cache_clear()
    settings = [(SWEEP, 1e-6), (f"{SCIPY}: Euler", 1e-6), (HEYOKA, 1e-6), (PLAIN, (4, 0.5, 1e-2))]
    ours, *failed = comparison.timed("stiff", APPROACH, settings, 2, 16)
    assert (ours["failure"], ours["miscounted"], ours["setting"]) == ("", 0, "1e-06")
    assert ours["microseconds"] > 0.0
    assert 0.0 < ours["velocity_error"] < 1e-6
    for row, reason in zip(failed, ("ValueError", "ModuleNotFoundError", "FileNotFoundError"), strict=True):
        assert row["failure"].startswith(f"{comparison.GAVE_UP}: {reason}")
        assert row["microseconds"] is None


def test_wrong_velocities_and_counts_are_named():
    work, some, truth = problem("stiff", APPROACH, 16)
    counts, off = comparison.solved(SWEEP, work, 1e-9)[1], np.where(np.arange(16) == 11, 0.02, 0.0)
    for true, more, path, wrong, failure in (
        (truth, 0, 0.0, 0, ""), (truth, 1, 0.0, 16, ""), (truth + off, 0, 0.02, 0, ""),
        (truth + off[::-1], 0, 0.0, 0, comparison.WRONG),
    ):  # fmt: skip
        row = comparison.judged(SWEEP, 1e-9, work, some, true, counts + more)
        assert (row["failure"], row["miscounted"], row["path_error"]) == (failure, wrong, pytest.approx(path, abs=1e-7))


def test_c_programs_have_the_flags_of_the_solver():
    tree = ast.parse((Path(__file__).parents[2] / "setup.py").read_text())
    flags = [ast.literal_eval(each.value) for each in tree.body
             if isinstance(each, ast.Assign) and ast.unparse(each.targets) == "FLAGS"]  # fmt: skip
    assert flags == [compiled.FLAGS]


def test_faster_solvers_are_named_and_lines_drawn():
    plain = [(5.0, 1e-4, 1e-3), (7.0, 1e-3, 1e-6), (8.0, 1e-5, 1e-9), (20.0, 1e-7, 1e-2)]
    rows = [(APPROACH, SWEEP, 10.0, 1e-8, 1e-7), (CONTACT, SWEEP, 10.0, 1e-8, 1e-7), (APPROACH, CALL, 30.0, 1e-8, 1e-7),
            *((APPROACH, PLAIN, *each) for each in plain), (CONTACT, LANES, 4.0, 1e-8, None),
            (APPROACH, HEYOKA, 20.0, 1e-6, 1e-6), (CONTACT, HEYOKA, 20.0, 1e-6, 1e-6)]  # fmt: skip
    names = ("what", "solver", "microseconds", "velocity_error", "path_error")
    times = pl.DataFrame(rows, names, orient="row").with_columns(
        scene=pl.lit("soft"), failure=pl.lit(""), setting=pl.lit("1e-6"), miscounted=0
    )
    assert precision.ahead(times.filter(pl.col("solver").is_in([SWEEP, CALL]))) == "nobody"
    answer, (section, _) = precision.about_times(times)
    assert answer == (
        "Faster than impact_gym somewhere: plain C, approaches (soft 1e-3 to 1e-5; at most 2 times as fast); heyoka, "
        "approaches (soft 1e-3 to 1e-6; at most 1.5 times as fast); heyoka, batch, contacts (soft 1e-3 to 1e-8; at "
        "most 2.5 times as fast)."
    )
    table = {row[0]: row[1:] for row in section.parts[-2].rows}
    assert (table["soft, 1e-4"], table["soft, 1e-8"]) == (["10", "30", "5", "-", "20", "-"], ["10", "30", *"----"])
    lines = [(1e-7, 20.0), (1e-5, 8.0), (1e-4, 5.0)], [], [(1e-9, 8.0), (1e-6, 7.0), (1e-3, 5.0)]
    for name, shown in zip(precision.PICTURES, lines, strict=True):
        precision.draw(figure := Figure(), times, name)
        (line,) = (line for line in figure.axes[0].lines if line.get_label() == PLAIN)
        assert [*zip(line.get_xdata(), line.get_ydata(), strict=True)] == shown
