"""Who else stands in the storm, what must not matter, and a quick study with its page."""

import json
import math
import shutil
from contextlib import closing
from dataclasses import replace
from functools import partial

import numpy as np
import polars as pl
import pytest
from pages import text_of_a_page_that_stands_on_its_own
from stability_scenes import COUPLINGS, ROBOTS, approach_of

import impact_gym as ig
from agents.jobs.store import Store
from experiments import reference
from experiments.lab import experiment
from experiments.lab.results import KEPT
from experiments.lab.tables import gathered
from experiments.speed_vs_error import quantities
from experiments.speed_vs_error.contenders import OURS
from experiments.stability import __main__ as study
from experiments.stability import agreement, hard_cases, invariances, promises, rivals, scenes, storm

FEW = 27  # scenes: every coupling with every robot, three times


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_solve_ivp_with_events_leads_to_the_truth_at_a_fine_tolerance(coupling):
    approach = approach_of(COUPLINGS[coupling])
    true = approach.solved(reference.simulate, rtol=1e-12)
    solution = rivals.plain(approach, "DOP853", 1e-10, 1e-14)
    assert solution.contacts == true.contacts
    assert solution.velocity == pytest.approx(true.velocity, rel=1e-7)
    assert solution.detection_time == pytest.approx(true.detection_time, abs=1e-8)


def test_whoever_takes_too_long_is_stopped():
    approach = approach_of(ig.SpringDamper(150.0))
    plain = partial(rivals.plain, approach, "RK45", 1e-10, 1e-14)
    careful = [partial(reference.simulate, *approach.run, method=method) for method in ("DOP853", "LSODA")]
    for solve in (plain, *careful):
        with pytest.raises(TimeoutError), rivals.limited(1e-2):
            solve()
    with rivals.limited(1e-2):
        pass
    reference.simulate(*approach.run)  # the time of one is not taken from another


def test_what_a_rival_says_is_graded():
    truth = {"velocity": 1.0, "contacts": 2.0}
    solution = quantities.Solution(1.0005, 1.0, 0.1, 0.3, contacts=2, passes=0)
    assert rivals.grade(solution, truth, 1.0) == rivals.GOOD
    assert rivals.grade(replace(solution, contacts=1), truth, 1.0) == rivals.MISCOUNTED
    assert rivals.grade(replace(solution, velocity=1.002), truth, 1.0) == rivals.WRONG
    assert rivals.grade(replace(solution, velocity=math.nan), truth, 1.0) == rivals.NOT_FINITE
    rows = [
        {"contender": OURS, "failure": kind, "contacts": contacts, "true_contacts": 2.0, "seconds": 1.0}
        for kind, contacts in ((rivals.GOOD, 2), (rivals.WRONG, 1), (rivals.LATE, math.nan), (rivals.GOOD, 2))
    ]
    (line,) = rivals.table(rows)
    assert sum(line[kind] for kind in rivals.CLASSES) == 1.0
    assert (line[rivals.GOOD], line["missed"], line["seconds"]) == (0.5, 0.25, 1.0)
    (hung,) = rivals.table([rows[0] | {"failure": "no answer within 60 s", "contacts": math.nan, "seconds": math.nan}])
    assert (hung[rivals.LATE], hung["missed"], hung["seconds"]) == (1.0, 0.0, math.inf)


def test_the_sample_of_rivals_is_what_all_can_do():
    for number in rivals.sample(5):
        approach = scenes.draw(number)
        assert approach.scene.robot is None
        assert approach.scene.contact.stiffness_exponent == approach.scene.contact.damping_exponent == 1.5


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("coupling", COUPLINGS)
@pytest.mark.parametrize("law", [{}, {"stiffness_exponent": 1.2, "damping_exponent": 1.0}], ids=["1.5", "1.2, 1"])
def test_other_units_change_only_the_numbers(coupling, robot, law):
    plain = approach_of(COUPLINGS[coupling], ROBOTS[robot], **law)
    for name, (mass, length, tick) in invariances.UNITS.items():
        other = invariances.scaled(plain, mass, length, tick)
        a, b = ig.simulate(*plain.run), ig.simulate(*other.run)
        assert len(a.contacts) == len(b.contacts), name
        # the same to rounding; where flight is integrated its steps may be other ones, and then to the tolerance
        tolerance = 1e-11 if ROBOTS[robot] is None and coupling != "bistable" else 1e-8
        assert b.object_velocity == pytest.approx(a.object_velocity * length / tick, rel=tolerance)
        force = mass * length / tick**2
        assert b.peak_force == pytest.approx(a.peak_force * force, rel=10 * tolerance)
        assert b.detection_time == pytest.approx(a.detection_time * tick, rel=tolerance)


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_a_moving_room_changes_nothing_within_it(coupling):
    approach = approach_of(COUPLINGS[coupling])
    there = [invariances.velocity_in_frame(approach, boost, 1e-8) for boost in (0.0, 2.0, -3.0)]
    assert there[0] == scenes.velocity(approach)
    # integrated flights count their errors in the speed of the flange, which another frame has differently
    tolerance = 1e-8 if coupling == "bistable" else 1e-11
    assert there[1:] == pytest.approx([there[0]] * 2, rel=tolerance)


def test_rows_in_another_order_and_other_threads_are_the_same_to_the_bit():
    assert all(row["met"] and row["largest"] == 0.0 for row in invariances.sweeps(64))


def test_an_invariance_that_does_not_hold_is_missed():
    assert invariances.line("any", [0.0, 1e-16, 9e-8], exact=False)["met"]
    for differences in ([0.0, 1e-16, 2e-7], [1e-11, 1e-11, 0.0], [0.0, math.nan, 0.0]):
        assert not invariances.line("any", differences, exact=False)["met"]
    for differences in ([0.0, 1e-17], [0.0, math.nan]):
        assert not invariances.line("any", differences)["met"]
    number = next(number for number in range(20) if ig.simulate(*scenes.draw(number).run).contacts)
    true = scenes.velocity(scenes.draw(number))
    assert invariances.repeated([number], [true])[0]["met"]
    assert not invariances.repeated([number], [float(np.nextafter(true, 1.0))])[0]["met"]


def test_a_graze_is_seen_here_and_not_by_signs_at_the_ends_of_steps():
    scene, motion = hard_cases.swaying(0)
    when, far = hard_cases.summit(scene, motion)
    trace = ig.simulate(scene, motion, when + 1e-3, 1e-12, trace=True).trace
    assert trace.tool_position.max() == pytest.approx(far, abs=1e-6)
    saw = hard_cases.seen_by(scene, motion, when, far)
    assert all(saw[OURS])
    assert not all(saw["DOP853, solve_ivp events"])
    assert saw["DOP853, solve_ivp events"][0]


def test_a_tolerance_in_metres_floors_the_error():
    rows = list(hard_cases.tolerance(12))
    finest = {name: row["y"] for row in rows for name in [row["contender"]] if row["x"] == 1e-12}
    assert finest["RK45, solve_ivp, atol 1e-06"] > 1e-5
    assert finest[OURS] < 1e-11


def studied(folder, line, **options):
    compute = partial(study.tables, FEW, True)
    return experiment.run("stability", folder, line, compute, study.shown, processes=0, **options)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    return studied(tmp_path_factory.mktemp("study") / "stability", "first").parent


def read(path):
    return pl.read_csv(path, infer_schema=False).to_dicts()


def refuse(*_, **__):
    pytest.fail("computed again")  # not an Exception, which would be a row


def test_a_row_for_each_scene_and_a_page_that_stands_on_its_own(quick):
    assert [int(row["scene"]) for row in read(quick / "storm.csv")] == list(range(FEW))
    text = text_of_a_page_that_stands_on_its_own(quick, figures=3)
    assert all(promise in text for promise in promises.PROMISES)


def test_what_is_on_disk_is_not_computed_again(quick, monkeypatch):
    for place, name in (
        (storm, "row_of"),
        (agreement, "solution_of"),
        (agreement, "relative_error"),
        (rivals, "grade"),
    ):
        monkeypatch.setattr(place, name, refuse)
    for name in ("velocity_in_frame", "sweep_of", "velocity"):
        monkeypatch.setattr(invariances, name, refuse)
    monkeypatch.setattr(hard_cases, "row", refuse)
    studied(quick, "again")
    first, second = json.loads((quick / "results.json").read_text())["runs"]
    assert first["computed"] > FEW
    assert second["computed"] == 0


def test_the_page_lists_every_failure(quick, tmp_path, monkeypatch):
    gather = partial(gathered, quick, processes=0)
    rows = storm.rows(gather, FEW)
    rows[3] |= {"milliseconds": 77.0}
    rows[5] |= {"failure": "RuntimeError: the run stopped", "object_velocity": math.nan}
    rows[8] |= {"energy_created": 1e-3, "energy_doubt": 1e-9, "traced": 1}
    monkeypatch.setattr(storm, "rows", lambda *_: rows)
    tables = study.tables(FEW, True, gather)
    runs = json.loads((quick / "results.json").read_text())["runs"]
    text = experiment.write("stability", tmp_path, tables, *study.shown(tables), runs).read_text()
    found = {(row["scene"], row["contender"]) for row in read(tmp_path / "failures.csv")}
    assert {("3", promises.FAST), ("5", promises.FINISHED), ("8", promises.PASSIVE)} <= found
    assert "RuntimeError: the run stopped" in text
    assert "promises are missed" in text
    assert text.count('class="missed"') >= 3


def test_everything_is_computed_again_where_that_is_asked_for_and_a_stopped_run_is_noted(quick, tmp_path, monkeypatch):
    folder = tmp_path / "stability"
    shutil.copytree(quick, folder)

    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(storm, "row_of", stopped)
    with pytest.raises(KeyboardInterrupt):
        studied(folder, "anew", again=True)
    *_, last = json.loads((folder / "results.json").read_text())["runs"]
    assert (last["command"], last["seconds"], last["computed"]) == ("anew", None, 0)
    with closing(Store(folder / KEPT)) as store:
        assert len(store) == 0
