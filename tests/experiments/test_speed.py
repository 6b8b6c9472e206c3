"""Speed against error: contenders solve the approaches, are timed and judged, and the page shows the result."""

import math
import sys
from dataclasses import asdict, replace

import polars as pl
import pytest
from pages import text_of_a_page_that_stands_on_its_own
from studies import small_run

from experiments import reference
from experiments.lab.study import Cell
from experiments.studies import speed
from experiments.studies.solvers import approaches, contenders, taylor
from experiments.studies.solvers.approaches import Solution
from experiments.studies.solvers.contenders import CAREFUL, OURS, PEER

NAMED = {approach.name: approach for approach in approaches.named()}


def true_solution(approach):
    return Solution.of(reference.simulate(*approach.run, rtol=1e-12), approach.duration)


@pytest.mark.parametrize("approach", NAMED)
def test_heyoka_solves_a_named_approach_as_the_slow_solver_does(approach):
    pytest.importorskip(PEER)
    truth = true_solution(NAMED[approach])
    solution, _ = contenders.solved(NAMED[approach], PEER, 1e-10)
    assert contenders.failure(solution, truth, 1e-7) == ""
    assert solution.detection_time == pytest.approx(truth.detection_time, abs=1e-9)


def test_a_rival_that_is_missing_or_fails_is_a_row_that_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, PEER, None)
    taylor.integrator.cache_clear()
    tried = [(OURS, 1e-6), (f"{CAREFUL} Euler", 1e-6), (PEER, 1e-6)]
    ours, *failed = contenders.timed("stiff", asdict(true_solution(NAMED["stiff"])), tried, rounds=2)
    assert (ours["failure"], ours["contacts"]) == ("", 2)
    assert 0 < ours["microseconds"] < 1e4
    for row, reason in zip(failed, ("ValueError", "ModuleNotFoundError"), strict=True):
        assert row["failure"].startswith(f"{contenders.GAVE_UP}: {reason}")
        assert row["microseconds"] == math.inf


@pytest.mark.parametrize(("change", "kind"), [
    ({"velocity": 1.009}, ""), ({"velocity": 1.011}, contenders.WRONG), ({"velocity": math.nan}, contenders.NOT_FINITE),
    *(({name: value}, contenders.MISCOUNTED) for name, value in
      (("contacts", 1), ("passes", 0), ("detection_time", math.nan))),
])  # fmt: skip
def test_failure_names_the_error_of_a_solution(change, kind):
    exact = Solution(1.0, 10.0, 0.1, 0.3, contacts=2, passes=1)
    assert contenders.failure(replace(exact, **change), exact, contenders.TOO_WRONG) == kind


def test_ratio_is_that_of_the_cheapest_setting_with_an_error_that_is_not_small_by_chance():
    names = ["contender", "setting", "microseconds", "velocity_error"]
    rows = [["heyoka", 1e-3, 10.0, 1e-9], ["heyoka", 1e-4, 100.0, 1e-5], ["heyoka", 1e-5, 1e3, 1e-7]]
    rows = pl.DataFrame([*rows, [OURS, 1e-6, 50.0, 1e-8]], names, orient="row")
    rows = rows.with_columns(failure=pl.lit(""), scene=pl.lit("soft"), rival=pl.lit("heyoka"))
    assert speed.cheapest(rows, ["heyoka"], 1e-6)["setting"] == 1e-5
    assert speed.cheapest(rows, ["heyoka"], 1e-8) is None
    found = speed.ratios(rows)
    assert found["ratio"].to_list() == [0.2, 20.0, None, None]
    assert speed.answer(found).startswith("Faster than impact_gym: heyoka takes 0.20 times as long")
    assert speed.answer(found.filter(error=1e-6)).startswith("No rival is faster than impact_gym")


def test_page_has_every_contender_and_two_truths_that_agree(tmp_path):
    cells = [Cell({"scene": "soft"}, {"approach": "soft"})]

    def times(frames):
        return [cell for cell in speed.cells_of_times(True, frames) if cell.labels["rival"] == CAREFUL]

    run = small_run(speed.STUDY, tmp_path, truth=cells, times=times)
    run.write()
    rows = run["times"]
    assert {*rows["contender"]} == {OURS, *speed.RIVALS[CAREFUL]}
    assert rows.filter(contender=OURS, setting=1e-9)["velocity_error"].item() < 1e-7
    (truth,) = run["truth"].to_dicts()
    assert truth["second_contacts"] == truth["contacts"]
    assert truth["velocity_doubt"] < 1e-9
    assert "No rival is faster" in text_of_a_page_that_stands_on_its_own(tmp_path, figures=1)
