"""Speed against error: the contenders compute what they say, and what is on disk is drawn and not measured again."""

import json
import math
from contextlib import closing
from dataclasses import replace
from functools import partial
from xml.etree import ElementTree

import numpy as np
import polars as pl
import pytest
from pages import text_of_a_page_that_stands_on_its_own
from scipy.integrate import solve_ivp

import impact_gym as ig
from agents.jobs import Job
from agents.jobs.store import Store
from experiments import reference
from experiments.lab import experiment
from experiments.lab.charts import save
from experiments.lab.results import KEPT
from experiments.lab.tables import rows_of
from experiments.paper.scenes import MOTION, decoupled
from experiments.speed_vs_error import __main__ as study
from experiments.speed_vs_error import (
    by_hand,
    contenders,
    figures,
    heat_map,
    measure,
    peer,
    quantities,
    scenes,
    summary,
    taylor,
    truth,
)
from experiments.speed_vs_error.contenders import OURS
from experiments.speed_vs_error.quantities import ERRORS, Solution

NAMED = {approach.name: approach for approach in scenes.named()}
COUPLINGS = {"rigid": ig.Rigid(), "spring": ig.SpringDamper(150.0, 0.5), "bistable": ig.Bistable()}


def approach_with(coupling):
    scene = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.2505), ig.Contact(1e4, 0.5), coupling)
    return scenes.Approach("any", "", scene, MOTION, 1.0)


def true_solution(approach):
    return approach.solved(reference.simulate, rtol=1e-12)


def inside_a_contact(duration):
    """V_p of tool (0.125 kg, spring 150 N/m) and object (0.25 kg) that begin 1 mm into each other at 1 m/s."""
    k_c, d, m_t, m_p, k_t = 1e5, 1.5, 0.125, 0.25, 150.0
    c_t = math.sqrt(k_t * m_t)  # damping ratio 0.5

    def rates(t, y):
        x_t, v_t, x_p, v_p = y
        force = k_c * (x_t - x_p) ** 1.5 * (1 + d * (v_t - v_p))  # paper, eq. 5 and 7 with v_in = 1 m/s
        pull = k_t * (4 * t * t - x_t) + c_t * (8 * t - v_t)  # the flange starts at 8 m/s^2
        return v_t, (pull - force) / m_t, v_p, force / m_p

    return solve_ivp(rates, (0, duration), (1e-3, 1.0, 0.0, 0.0), "DOP853", rtol=1e-13, atol=1e-15).y[3, -1]


@pytest.mark.parametrize(("method", "order"), [("semi-implicit Euler", 1), ("RK4", 4)])
def test_a_hand_written_integrator_converges_with_its_order_inside_a_contact(method, order):
    law = by_hand.law_of(decoupled(1e5, 0.5, 150.0, damping_ratio=0.5))
    command = by_hand.command_of(ig.Trapezoid(1.0, 8.0))
    duration, start = 2e-3, (1e-3, 1.0, 0.0, 0.0)
    exact = inside_a_contact(duration)
    march = partial(by_hand.march, by_hand.METHODS[method], law, command, start, duration)
    errors = [abs(march(duration / n)[0] - exact) for n in (16, 32, 64)]
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx([order, order], abs=0.15)


@pytest.mark.parametrize("method", by_hand.METHODS)
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_a_small_fixed_step_leads_to_the_truth(method, coupling):
    approach, step = approach_with(COUPLINGS[coupling]), 2e-6
    solution, exact = by_hand.solve(method, approach, step), true_solution(approach)
    assert quantities.failure(solution, exact) == ""
    errors = quantities.errors(solution, exact)
    # the contact lasts some 30 ms: an onset noticed one step late is 1e-4 of it
    assert max(errors["velocity_error"], errors["peak_error"], errors["duration_error"]) < 2e-4
    assert errors["detection_error"] < 2 * step


def test_scipy_through_the_reference_is_judged_and_timed_in_its_contacts():
    approach = NAMED["soft"]
    contender = contenders.contender(approach, "SciPy RK45", 1e-8)
    plain, spent = reference._Run, []
    whole = contenders.repeated(lambda: spent.append(contender.seconds(1)))(1)
    assert reference._Run is plain
    assert 0 < spent[0] < whole  # of the same call, whatever else the machine does
    assert quantities.errors(contender.solve(), true_solution(approach))["velocity_error"] < 1e-7


@pytest.mark.parametrize("name", NAMED)
def test_taylor_series_lead_to_the_truth(name):
    pytest.importorskip("heyoka")
    exact = true_solution(NAMED[name])
    for tolerance, allowed in ((1e-6, 1e-5), (1e-15, 1e-10)):  # events in a row multiply errors
        solution = taylor.Run(NAMED[name], tolerance).solve()
        assert quantities.failure(solution, exact) == ""
        assert max(quantities.errors(solution, exact).values()) < allowed


def test_taylor_series_can_be_run_again():
    pytest.importorskip("heyoka")
    run = taylor.Run(NAMED["pushed"], 1e-9)
    assert run.solve() == run.solve()


def test_the_named_scenes_are_what_they_are_called():
    answers = {name: true_solution(approach) for name, approach in NAMED.items()}
    assert answers["multiple"].contacts == 6
    assert (answers["pushed"].contacts, answers["bistable"].passes) == (2, 2)
    slower = NAMED["bistable"]
    faster = replace(slower, motion=replace(slower.motion, speed=slower.motion.speed + 1e-4))
    assert true_solution(faster).passes == 1
    second = ig.simulate(*NAMED["pushed"].run).contacts[1]
    assert second.approach_velocity < 0.05 < 0.1 < second.end - second.start


def test_the_truth_is_what_a_second_method_finds():
    (row,) = rows_of(truth.truth("multiple", 1e-11))
    assert row["second_contacts"] == row["contacts"]
    assert max(row[f"{name}_doubt"] for name in ERRORS) < 1e-9


def test_what_is_a_failure():
    exact = Solution(1.0, 10.0, 0.1, 0.3, contacts=2, passes=1)
    assert quantities.failure(replace(exact, velocity=1.009), exact) == ""
    wrong = {"contacts": 1}, {"passes": 0}, {"detection_time": math.nan}, {"velocity": math.nan}, {"velocity": 1.011}
    for change, words in zip(wrong, ("1 contacts, not 2", "snap", "missed", "finite", "V_p"), strict=True):
        assert words in quantities.failure(replace(exact, **change), exact)


def row(contender, setting, microseconds, error, **changes):
    first = {"scene": "soft", "contender": contender, "setting": setting, "microseconds": microseconds}
    about = {"contacts": 1, "passes": 0, "steps": 50, "failure": "", "rounds": 1, "load": 0.5, "run": "one"}
    return first | dict.fromkeys(ERRORS, error) | about | changes


def table(rows):
    return pl.DataFrame(rows, infer_schema_length=None)


def read(path):
    return pl.read_csv(path, infer_schema_length=None, schema_overrides={"scene": pl.String, "failure": pl.String})


def test_an_error_that_is_small_by_chance_does_not_count():
    rows = [row("RK4", *numbers) for numbers in ((1e-3, 10.0, 1e-9), (1e-4, 100.0, 1e-5), (1e-5, 1000.0, 1e-7))]
    assert summary.cheapest(table(rows), ["RK4"], 1e-6)["setting"] == 1e-5
    assert summary.cheapest(table(rows), ["RK4"], 1e-8) is None
    compared = summary.compared(table([*rows, row(OURS, 1e-6, 50.0, 1e-8)]), ["RK4"], 1e-6)
    assert compared.ratio == 20.0
    assert summary.compared(table(rows), ["RK4"], 1e-6) is None  # ours is not there


def test_a_missing_answer_counts_as_an_infinite_error_and_a_failure():
    missing = row(OURS, 1e-6, 60.0, math.nan, failure="RuntimeError: none")
    rows = [row(OURS, 1e-6, 50.0, 1e-8), missing, row(OURS, 1e-6, 70.0, 1e-7)]
    (found,) = summary.over_population(table(rows)).to_dicts()
    assert (found["velocity_error_25"], found["velocity_error_50"]) == (1e-8, 1e-7)
    assert found["microseconds_50"] == 60.0
    assert found["failures"] == pytest.approx(1 / 3)


@pytest.fixture
def tables():
    """A frozen table of every kind."""
    counts = {"contacts": 1, "passes": 0, "second_contacts": 1, "second_passes": 0}
    doubt = {f"{name}_doubt": 1e-14 for name in ERRORS}
    truths = [{"scene": "soft", "description": "a scene", **counts, **doubt}]
    rows = [
        row(name, setting, 10.0 / setting, setting, failure="2 contacts, not 1" if setting > 1e-4 else "")
        for name in contenders.NAMES
        for setting in (1e-3, 1e-5, 1e-7)
    ]
    cells = [
        {"stiffness": k_c, "damping_factor": d, "velocity_error": 1e-9, "steps": 40, "ended": 1, "failure": ""}
        for k_c in (1e2, 1e4)
        for d in (1e-2, 1.0)
    ]
    cells[0] |= {"velocity_error": math.nan, "failure": "RuntimeError"}
    measured = {"named_truth": truths, "named": rows, "population_truth": truths, "population": rows}
    return measured | {"mujoco_fits": [], "heat_map": cells}


def test_a_frozen_table_draws_and_a_figure_follows_its_table(tables, tmp_path):
    experiment.write("speed_vs_error", tmp_path, tables, *study.shown(tables), [])
    names = [*ERRORS, "population", "heat_map"]
    first = {name: (tmp_path / f"{name}.svg").read_bytes() for name in names}
    for picture in first.values():
        ElementTree.fromstring(picture)
    for name in contenders.NAMES:
        assert name.encode() in first["velocity_error"]
    rows, truths = read(tmp_path / "named.csv"), read(tmp_path / "named_truth.csv")
    again = save(figures.named_scenes(rows, truths, "velocity_error"), tmp_path / "again.svg").read_bytes()
    assert again == first["velocity_error"]
    rows = rows.with_columns(pl.col("velocity_error") * 100)
    changed = save(figures.named_scenes(rows, truths, "velocity_error"), tmp_path / "changed.svg").read_bytes()
    assert changed != again


def test_the_heat_map_runs_one_contact():
    (cell,) = rows_of(heat_map.cell(1e6, 10.0, 1e-12))
    assert cell["failure"] == ""
    assert cell["ended"] == 1
    assert cell["velocity_error"] < 1e-7  # ten times the rtol, of 0.7 m/s


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """The folder of a study that was run twice, and a table as it was after the first."""
    folder = tmp_path_factory.mktemp("study") / "speed_vs_error"
    compute = partial(study.tables, replace(study.QUICK, names=("soft",), scenes=4, fit=8))
    # other processes would only import everything anew
    run = partial(experiment.run, "speed_vs_error", folder, compute=compute, show=study.shown, processes=0)
    run("python -m experiments.speed_vs_error --quick")
    named = (folder / "named.csv").read_bytes()
    assert run("again") == folder / "index.html"
    return folder, named


def test_a_quick_run_measures_every_contender_on_every_scene(quick):
    folder, _ = quick
    expected = set(contenders.NAMES) - set(contenders.MISSING)
    named, population = (read(folder / f"{name}.csv").to_dicts() for name in ("named", "population"))
    assert {row["contender"] for row in named} == expected
    assert {row["scene"] for row in population} == {"000", "001", "002", "003"}
    assert all(row["microseconds"] > 0 for row in (*population, *named))
    fine = [row for row in population if row["contender"] == OURS and row["setting"] == 1e-9]
    assert len(fine) == 4
    assert all(not row["failure"] and row["velocity_error"] < 1e-7 for row in fine)
    assert read(folder / "heat_map.csv").height == len(heat_map.grid(study.QUICK.heat_map))


def test_what_is_on_disk_is_not_measured_again(quick):
    folder, named = quick
    assert (folder / "named.csv").read_bytes() == named
    runs = json.loads((folder / "results.json").read_text())["runs"]
    with closing(Store(folder / KEPT)) as store:
        assert [run["computed"] for run in runs] == [len(store), 0]
    assert all(run["seconds"] > 0 and run["machine"] and run["versions"] for run in runs)


def test_what_is_timed_in_turns_is_so_in_this_process_alone():
    asked = []
    gather = partial(lambda *_, processes: asked.append(processes), processes=None)
    for rounds in (1, 3):
        measure.rows(gather, "any", {"soft": Solution(1.0, 10.0, 0.1, math.nan, 2, 1)}, [], [(OURS, 1e-6)], rounds)
    assert asked == [None, 0]


def test_an_approach_is_drawn_again_by_its_name_and_an_answer_sent_is_that_which_comes():
    for approach in (*scenes.named(), *scenes.population(5)):
        assert scenes.approach_of(approach.name) == approach
    solution = Solution(1.0, 10.0, 0.1, math.nan, contacts=2, passes=1)
    sent = Job("cluster_work:fails_on", {"log": "", "number": quantities.as_json(solution), "bad": []})
    assert str(quantities.from_json(sent.arguments["number"])) == str(solution)  # nan is not equal to itself


def test_the_page_stands_on_its_own_and_leads_to_files_that_are_there(quick):
    assert "times faster" in text_of_a_page_that_stands_on_its_own(quick[0], figures=len(ERRORS) + 2)


def test_mujoco_repeats_its_steps_and_its_flange_follows_the_command():
    pytest.importorskip("mujoco")
    approach = NAMED["soft"]
    model = peer.Model(approach, peer.Fit(1000.0, 3.0), 1e-3)
    solution = model.run()
    assert model.repeat() == solution.velocity
    position, velocity = by_hand.flange(model.command, solution.detection_time + 0.016, approach.duration)
    # semi-implicit Euler is half a step's way off for each change of velocity; the tool weighs 1e-7 of the flange
    assert model.data.qpos[0] == pytest.approx(position, abs=2e-3)
    assert model.data.qvel[0] == pytest.approx(velocity, abs=1e-5)


def test_an_elastic_contact_in_mujoco_keeps_energy_and_momentum():
    pytest.importorskip("mujoco")
    weak = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.2505), ig.Contact(1e5, 1.0), ig.SpringDamper(1e-6, 0.0))
    approach = scenes.Approach("free", "", weak, ig.Trapezoid(1.0, 8.0), 0.3)
    start = np.array([[0.25, 0.0, 0.0], [1.0, 0.0, 0.0]])  # 0.5 mm before the object, at 1 m/s
    model = peer.Model(approach, peer.Fit(2e5, 1e-9), 1e-5, (0.2, 0.3), start)
    solution = model.run()
    # two free masses, e = 1 (paper, eq. 3-4): 2 m_t/(m_t + m_p) of 1 m/s
    assert solution.contacts == 1
    assert solution.velocity == pytest.approx(2 / 3, abs=2e-3)
