"""Speed against error: the contenders compute what they say, are timed and judged as said, and the page says so."""

import math
import re
from dataclasses import replace
from functools import partial

import polars as pl
import pytest
from pages import text_of_a_page_that_stands_on_its_own
from scenes import MOTION, scene
from studies import small_run

import impact_gym as ig
from experiments import reference
from experiments.lab.study import Cell
from experiments.studies import speed
from experiments.studies.solvers import approaches, contenders, solutions
from experiments.studies.solvers.contenders import CAREFUL, OURS
from experiments.studies.solvers.solutions import ERRORS, Solution, solve

NAMED = {approach.name: approach for approach in approaches.named()}


def approach_with(coupling):
    return approaches.Approach("any", "", scene(1e4, 0.5, coupling), MOTION, 1.0)


def true_solution(approach):
    return solve(approach, reference.simulate, rtol=1e-12)


def test_solved_charges_scipy_its_contacts_alone():
    begun = contenders.thread_time()
    solution, charged = contenders.solved(NAMED["soft"], f"{CAREFUL} RK45", 1e-8)
    assert 0 < charged < contenders.thread_time() - begun
    assert solutions.errors(solution, true_solution(NAMED["soft"]))["velocity_error"] < 1e-7


def test_limited_stops_whoever_takes_too_long():
    approach = approach_with(ig.SpringDamper(150.0))
    runs = [partial(reference.simulate, *approach.run, method=method) for method in ("DOP853", "LSODA")]

    def again_and_again(run):
        while True:  # an error may be swallowed where Fortran calls back, but not for ever
            run()

    for run in runs:
        with pytest.raises(TimeoutError), contenders.limited(1e-3):
            again_and_again(run)
    with contenders.limited(1e-3):
        pass
    reference.simulate(*approach.run)  # the time of one is not taken from another


def test_named_scenes_are_what_they_are_called():
    answers = {name: true_solution(NAMED[name]) for name in ("multiple", "pushed", "bistable")}
    assert answers["multiple"].contacts == 6
    assert (answers["pushed"].contacts, answers["bistable"].passes) == (2, 2)
    slower = NAMED["bistable"]
    faster = replace(slower, motion=replace(slower.motion, speed=slower.motion.speed + 1e-4))
    assert true_solution(faster).passes == 1
    second = ig.simulate(*NAMED["pushed"].run).contacts[1]
    assert second.approach_velocity < 0.05 < 0.1 < second.end - second.start


EXACT = Solution(1.0, 10.0, 0.1, 0.3, contacts=2, passes=1)


@pytest.mark.parametrize(("change", "kind"), [
    ({"velocity": 1.009}, ""), ({"velocity": 1.011}, solutions.WRONG), ({"velocity": math.nan}, solutions.NOT_FINITE),
    *(({name: value}, solutions.MISCOUNTED) for name, value in
      (("contacts", 1), ("passes", 0), ("detection_time", math.nan))),
])  # fmt: skip
def test_failure_is_the_class_of_what_is_wrong(change, kind):
    solution = replace(EXACT, **change)
    assert solutions.failure(solution, EXACT, contenders.TOO_WRONG) == kind
    if change != {"velocity": math.nan}:  # as a job gets it; nan is not equal to itself
        assert str(Solution(**solution.numbers)) == str(solution)
    if kind == solutions.MISCOUNTED:
        assert solutions.failure(solution, EXACT, 0.0, counted=()) == ""


def row(contender, setting, microseconds, error, **changes):
    return {
        "contender": contender,
        "setting": setting,
        "microseconds": microseconds,
        "velocity_error": error,
        **changes,
    }


def test_scipy_takes_as_many_times_longer_as_its_cheapest_setting_whose_error_is_not_small_by_chance():
    rk45 = f"{CAREFUL} RK45"
    rows = [row(rk45, *numbers) for numbers in ((1e-3, 10.0, 1e-9), (1e-4, 100.0, 1e-5), (1e-5, 1000.0, 1e-7))]
    assert speed.cheapest(pl.DataFrame(rows), [rk45], 1e-6)["setting"] == 1e-5
    assert speed.cheapest(pl.DataFrame(rows), [rk45], 1e-8) is None
    rows.append(row(f"{CAREFUL} Radau", 1e-9, 5.0, None))  # gave up
    ratio, words = speed.compared("soft", "", pl.DataFrame([*rows, row(OURS, 1e-6, 50.0, 1e-8)]))
    assert ratio == 20.0
    assert words[1:] == ["50 µs", "20", f"{rk45}, rtol 1e-5"]
    assert speed.compared("soft", "", pl.DataFrame(rows))[0] is None  # ours is not there


def test_timed_keeps_the_best_round_and_the_reason_of_a_failure():
    tried = [(OURS, 1e-6), (f"{CAREFUL} Euler", 1e-6)]
    ours, failed = contenders.timed("stiff", true_solution(NAMED["stiff"]).numbers, tried, rounds=2)
    assert (ours["failure"], ours["contacts"]) == ("", 2)
    assert 0 < ours["microseconds"] < 1e4
    assert failed["failure"].startswith(f"{solutions.GAVE_UP}: ValueError: method must be")
    assert failed["microseconds"] == math.inf


def test_page_has_every_contender_and_a_truth_without_doubt(tmp_path):
    cells = [Cell({"scene": "soft"}, {"approach": "soft"})]
    run = small_run(speed.STUDY, tmp_path, truth=cells, times=lambda frames: speed.cells_of_times(True, frames))
    run.write()
    rows = run.frames["times"]
    assert {*rows["contender"]} == {*speed.STYLES}
    assert rows.filter(contender=OURS, setting=1e-9)["velocity_error"].item() < 1e-7
    (truth,) = run.frames["truth"].to_dicts()
    assert truth["second_contacts"] == truth["contacts"]
    assert max(truth[f"{name}_doubt"] for name in ERRORS) < 1e-9
    assert "times faster" in text_of_a_page_that_stands_on_its_own(tmp_path, figures=len(ERRORS))
    ours = pl.when(contender=OURS, scene="other").then(0.1).otherwise(1.0) * pl.col("microseconds")
    both = {name: pl.concat([frame, frame.with_columns(scene=pl.lit("other"))]) for name, frame in run.frames.items()}
    both["times"] = both["times"].with_columns(microseconds=ours)
    said = speed.analyse(both, True).answer.replace(",", "")
    least, most = map(float, re.search(r"is ([\d.]+) to ([\d.]+) times", said).groups())
    assert most == pytest.approx(10.0 * least, rel=0.06)  # of two digits
