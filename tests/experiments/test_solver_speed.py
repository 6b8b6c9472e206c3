"""Speed against error: the contenders compute what they say, are timed and judged as said, and the page shows it."""

import json
import math
from contextlib import closing
from dataclasses import replace
from functools import partial

import numpy as np
import polars as pl
import pytest
from agents.jobs.store import Store
from pages import text_of_a_page_that_stands_on_its_own
from scenes import COUPLINGS, MOTION, scene

import impact_gym as ig
from experiments import reference
from experiments.lab import experiment
from experiments.lab.charts import save
from experiments.lab.results import KEPT
from experiments.solver import approaches, by_hand, figures, solutions, timing
from experiments.solver.solutions import ERRORS, OURS, Solution, solve
from experiments.solver.speed import __main__ as study

NAMED = {approach.name: approach for approach in approaches.named()}


def approach_with(coupling):
    return approaches.Approach("any", "", scene(1e4, 0.5, coupling), MOTION, 1.0)


def true_solution(approach):
    return solve(approach, reference.simulate, rtol=1e-12)


@pytest.mark.parametrize(("method", "order"), [("semi-implicit Euler", 1), ("RK4", 4)])
def test_march_converges_with_its_order_inside_a_contact(method, order):
    law = by_hand.law_of(scene(1e5, 0.5, ig.SpringDamper(150.0, 0.5)))
    command = by_hand.command_of(ig.Trapezoid(1.0, 8.0))
    duration, start = 2e-3, (1e-3, 1.0, 0.0, 0.0)  # tool and object begin 1 mm into each other at 1 m/s
    exact = by_hand.march(by_hand.RK4, law, command, start, duration, duration / 4096)[0]
    march = partial(by_hand.march, by_hand.METHODS[method], law, command, start, duration)
    errors = [abs(march(duration / n)[0] - exact) for n in (16, 32, 64)]
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx([order, order], abs=0.15)


@pytest.mark.parametrize("coupling", COUPLINGS.values(), ids=list(COUPLINGS))
def test_by_hand_leads_to_the_truth_where_it_is_fine(coupling):
    approach, step = approach_with(coupling), 2e-6
    exact = true_solution(approach)
    for method in by_hand.METHODS:
        solution = by_hand.fixed_step(approach, method, step)
        assert solutions.failure(solution, exact, timing.TOO_WRONG) == ""
        errors = solutions.errors(solution, exact)
        # the contact lasts some 30 ms: an onset noticed one step late is 1e-4 of it
        assert max(errors["velocity_error"], errors["peak_error"], errors["duration_error"]) < 2e-4
        assert errors["detection_error"] < 2 * step
    solution = by_hand.with_events(approach, "DOP853", 1e-10, 1e-14)
    assert solution.contacts == exact.contacts
    assert solution.velocity == pytest.approx(exact.velocity, rel=1e-7)
    assert solution.detection_time == pytest.approx(exact.detection_time, abs=1e-8)


def test_solved_charges_scipy_its_contacts_alone():
    begun = timing.thread_time()
    solution, charged = timing.solved(NAMED["soft"], "SciPy RK45", 1e-8)
    assert 0 < charged < timing.thread_time() - begun
    assert solutions.errors(solution, true_solution(NAMED["soft"]))["velocity_error"] < 1e-7


def test_limited_stops_whoever_takes_too_long():
    approach = approach_with(ig.SpringDamper(150.0))
    plain = partial(by_hand.with_events, approach, "RK45", 1e-10, 1e-14)
    careful = [partial(reference.simulate, *approach.run, method=method) for method in ("DOP853", "LSODA")]

    def again_and_again(run):
        while True:  # an error may be swallowed where Fortran calls back, but not for ever
            run()

    for run in (plain, *careful):
        with pytest.raises(TimeoutError), timing.limited(1e-3):
            again_and_again(run)
    with timing.limited(1e-3):
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
    assert solutions.failure(solution, EXACT, timing.TOO_WRONG) == kind
    if change != {"velocity": math.nan}:  # as a job gets it; nan is not equal to itself
        assert str(Solution(**solution.numbers)) == str(solution)
    if kind == solutions.MISCOUNTED:
        assert solutions.failure(solution, EXACT, 0.0, counted=()) == ""


def row(contender, setting, microseconds, error, **changes):
    about = {"contacts": 1, "passes": 0, "steps": 50, "failure": ""}
    first = {"scene": "soft", "contender": contender, "setting": setting, "microseconds": microseconds}
    return first | dict.fromkeys(ERRORS, error) | about | changes


def test_cheapest_does_not_count_an_error_that_is_small_by_chance():
    rows = [row("RK4", *numbers) for numbers in ((1e-3, 10.0, 1e-9), (1e-4, 100.0, 1e-5), (1e-5, 1000.0, 1e-7))]
    assert timing.cheapest(pl.DataFrame(rows), ["RK4"], 1e-6)["setting"] == 1e-5
    assert timing.cheapest(pl.DataFrame(rows), ["RK4"], 1e-8) is None
    assert timing.beside_ours(pl.DataFrame([*rows, row(OURS, 1e-6, 50.0, 1e-8)]), ["RK4"], 1e-6)["ratio"] == 20.0
    assert timing.beside_ours(pl.DataFrame(rows), ["RK4"], 1e-6) is None  # ours is not there


def test_timed_keeps_the_best_round_and_the_reason_of_a_failure():
    tried = [(OURS, 1e-6), ("SciPy Euler", 1e-6)]
    ours, failed = timing.timed(NAMED["stiff"], true_solution(NAMED["stiff"]), tried, rounds=2)
    assert (ours["failure"], ours["contacts"]) == ("", 2)
    assert 0 < ours["microseconds"] < 1e4
    assert failed["failure"].startswith(f"{solutions.GAVE_UP}: ValueError: method must be")
    assert failed["microseconds"] == math.inf


def read(path):
    return pl.read_csv(path, infer_schema_length=None, schema_overrides={"scene": pl.String, "failure": pl.String})


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """The folder of a study that was run twice, and a table as it was after the first."""
    folder = tmp_path_factory.mktemp("study") / "speed"
    extent = study.Extent(timing.settings((1e-6, 1e-9), (1e-6,), (1e-3, 1e-4)), 1, names=("soft",))
    # other processes would only import everything anew
    run = partial(experiment.run, "solver/speed", folder, compute=partial(study.tables, extent), processes=0)
    run("first", show=study.shown)
    named = (folder / "named.csv").read_bytes()
    run("again", show=lambda tables: ({}, study.shown(tables)[1]))  # its figures stand there already
    return folder, named


def test_tables_have_every_contender_and_a_truth_without_doubt(quick):
    folder, _ = quick
    rows = read(folder / "named.csv").to_dicts()
    assert {row["contender"] for row in rows} == set(timing.NAMES)
    assert all(row["microseconds"] > 0 for row in rows)
    (fine,) = (row for row in rows if row["contender"] == OURS and row["setting"] == 1e-9)
    assert not fine["failure"]
    assert fine["velocity_error"] < 1e-7
    (truth,) = read(folder / "truth.csv").to_dicts()
    assert truth["second_contacts"] == truth["contacts"]
    assert max(truth[f"{name}_doubt"] for name in ERRORS) < 1e-9


def test_run_measures_nothing_again_that_is_on_disk(quick):
    folder, named = quick
    assert (folder / "named.csv").read_bytes() == named
    runs = json.loads((folder / "results.json").read_text())["runs"]
    with closing(Store(folder / KEPT)) as store:
        assert [run["computed"] for run in runs] == [len(store), 0]
    assert all(run["seconds"] > 0 and run["machine"] and run["versions"] for run in runs)


def test_page_stands_on_its_own_and_its_figures_follow_their_tables(quick, tmp_path):
    folder, _ = quick
    assert "times faster" in text_of_a_page_that_stands_on_its_own(folder, figures=len(ERRORS))
    truths, rows = read(folder / "truth.csv"), read(folder / "named.csv")
    drawn = [
        save(figures.named_scenes(table, truths, "velocity_error"), tmp_path / "again.svg").read_bytes()
        for table in (rows, rows.with_columns(pl.col("velocity_error") * 100))
    ]
    assert drawn[0] == (folder / "velocity_error.svg").read_bytes() != drawn[1]
    assert all(name.encode() in drawn[0] for name in rows["contender"])
