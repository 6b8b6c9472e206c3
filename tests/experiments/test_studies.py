"""All studies by small runs: pages, tables, what kept cells depend on; then gain, teleop, stock, bench, stability."""

from dataclasses import replace
from functools import cache, partial
from html import unescape
from importlib.util import find_spec
from itertools import count

import numpy as np
import polars as pl
import pytest
from browser_pages import text_of_a_page_that_stands_on_its_own

from agents import jobs, load_policy
from agents.baselines import PaperTrapezoid
from agents.evaluate.scenario_batch import ScenarioBatch
from experiments import studies
from experiments.lab import study
from experiments.lab.parts import Table
from experiments.lab.study import Cell, Run, StudyOptions
from experiments.studies import bench, gain, speed, stability, stock, teleop
from experiments.studies.solvers import approaches, contenders
from experiments.studies.stability import promises, storm
from impact_gym.sources import compiled_from

FIGURES = {"paper": 2, "speed": 1, "stability": 0, "gain": 0, "teleop": 2, "bench": 0, "stock": 1}
SLOW = "bench", "stock"
EVERY = [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in studies.NAMES]


def beside_scipy(quick, frames):
    return [cell for cell in speed.cells_of_times(quick, frames) if cell.labels["rival"] == contenders.CAREFUL]


def cells_of(name):
    """The few cells of each table, or a function that returns them."""
    if name == "paper":
        return {figure: [Cell({}, {})] for figure in ("figure_02", "figure_23")}
    if name == "speed":
        return {"truth": [Cell({"scene": "soft"}, {"approach": "soft"})], "times": beside_scipy}
    if name == "stability":  # 27: every coupling with every robot, three times
        patience = {2: 1e-3, 5: 60.0}  # s; too little for the independent solver, and enough
        truth = [Cell({"scene": number}, {"number": number, "patience": each}) for number, each in patience.items()]
        return {"storm": [Cell({"scene": number}, {"number": number}) for number in range(27)], "truth": truth}
    if name == "gain":
        few = {"scenarios": 10, "generations": 3, "tested": 20}
        found = [cell for cell in gain.searches(True, {}) if cell.labels["near"] == 0.15]
        return {"priors": [cell._replace(arguments=cell.arguments | few) for cell in found]}
    if name == "teleop":
        return {"episodes": [*few_operators()]}
    if name == "bench":
        rates = [Cell({"set-up": bench.SETUPS[0]}, {"name": bench.SETUPS[0], "quick": True})]
        return {"environments": [Cell({}, {"quick": True})], "rates": rates}
    others = [Cell({"setup": stock.FIRST}, {"setup": stock.FIRST})]
    return {"others": others} | {name: [tiny_training(name)] for name in stock.ALGORITHMS}


def few_operators():
    for cell in teleop.assisted(True, {}):
        place = cell.labels["coupling"], cell.labels["operator"]
        if place in [("rigid", "reach"), ("rigid", "steady")] and cell.labels["seed"] in (0, 1):
            yield cell._replace(arguments=cell.arguments | {"scenarios": cell.arguments["scenarios"] | {"count": 15}})


def tiny_training(algorithm):
    small = {"n_timesteps": 64, "n_envs": 8, "n_steps": 4, "batch_size": 32, "learning_starts": 16}
    cell = next(iter(stock.trainings(algorithm, True, {})))
    cell.arguments["settings"].update({key: small[key] for key in small.keys() & cell.arguments["settings"].keys()})
    return cell


def small_run(name, folder):
    """A run of a study, in this process, of the few cells alone."""
    whole, cells = studies.load(name), cells_of(name)
    few = [
        replace(each, cells=made if callable(made := cells[each.name]) else lambda *_, made=made: made, processes=0)
        for each in whole.measurements if each.name in cells
    ]  # fmt: skip
    return Run(replace(whole, measurements=few), StudyOptions(folder, quick=True, processes=0), "the command")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A function that returns the small run of a study; each study runs once."""

    @cache
    def run_of(name):
        if name == "stock":
            find_spec("rl_zoo3") or pytest.skip("rl_zoo3 is not installed")
        (run := small_run(name, tmp_path_factory.mktemp(name))).write()
        return run

    return run_of


@pytest.mark.parametrize("name", EVERY)
def test_page_and_tables_have_what_was_measured_once(name, small, monkeypatch):
    run = small(name)
    text = unescape(text_of_a_page_that_stands_on_its_own(run.folder, FIGURES[name])).replace("\N{NO-BREAK SPACE}", " ")
    findings = run.study.analyse(run, True)
    for words in (run.study.question, findings.answer, *(section.heading for section in findings.sections)):
        assert words.replace("^(1.5)", "^1.5") in text
    for table in (part for section in findings.sections for part in section.parts if isinstance(part, Table)):
        assert all(cell in text for row in (table.head, *table.rows) for cell in row) or not table.rows
    for table, frame in {**run, **findings.tables}.items():
        assert (run.folder / f"{table}.csv").read_text() == study.csv_of(frame)
    monkeypatch.setattr(jobs, "perform", None)  # nothing is measured again
    again = small_run(name, run.folder)
    assert all(again[table].equals(frame) for table, frame in run.items())


@pytest.mark.parametrize("name", studies.NAMES)
def test_kept_cells_depend_on_measure_and_solver(name, monkeypatch):
    assert studies.load(name).name == name
    monkeypatch.setattr(study, "digest_of", lambda *modules: " ".join(modules))
    for measurement in studies.load(name).measurements:
        solver, *modules = measurement.digest.split(" ")
        assert {*modules} == {measurement.measure.__module__, *measurement.depends}
        independent = measurement.measure in (contenders.true_row, storm.truth_row)
        assert solver == ("" if independent else compiled_from())


def test_distances_have_the_distribution_of_the_prior():
    uniform, memoryless = gain.Prior(0.15, 0.35), gain.Prior(0.001, 0.6, memoryless=True)
    assert np.sort(uniform.distances(1, 400)) == pytest.approx(0.15 + 0.2 * (np.arange(400) + 0.5) / 400)
    away = memoryless.distances(1, 100_000) - 0.001
    for gone in (0.0, 0.1, 0.3):  # the remaining distance has the same distribution everywhere
        assert (away[away > gone] - gone).mean() == pytest.approx(memoryless.mean, rel=1e-2)


def test_shares_of_the_gain_add_up(small):
    priors = small("gain")["priors"]
    rows, (line,) = priors.filter(rule="rule"), gain.by_prior(priors)
    assert line["limits"].value + line["place"].value == pytest.approx(line["all"].value, rel=1e-12)
    rule, steady, profile = (each.value for each in line["velocity"])
    assert (rule, line["time"]) == pytest.approx((rows["object_velocity"].mean(), rows["approach_time"].mean()))
    shares = (rule - steady) / rule, (steady - profile) / rule, 1.0 - profile / steady
    assert [line[name].value for name in ("limits", "place", "profile")] == pytest.approx(shares)


def test_assistances_are_compared_in_the_same_scenarios(small):
    run = small("teleop")
    cells = {row["contestant"]: row for row in teleop.table_of_cells(run) if row["operator"] == "steady"}
    assert {*cells} == {*teleop.ASSISTANCE}
    brake = cells[teleop.BRAKE]
    for who, row in cells.items():
        rows = run["episodes"].filter(contestant=who, operator="steady")
        assert (row["slide"], row["done_time"]) == pytest.approx((rows["slide"].mean(), rows["done_time"].mean()))
        assert row["slide_low"] <= row["slide"] <= row["slide_high"]
        assert row["cost"] == pytest.approx(row["object_velocity"] + 0.5 * row["done_time"] + 2.0 * row["missed"])
        assert row["brake_cost"] == pytest.approx(brake["cost"] - row["cost"], abs=1e-12)
        assert who == teleop.POLICY or row["taken"] == 0.0  # they do not change the command before the touch
    assert brake["slide"] < cells[teleop.ALONE]["slide"]  # the brake stops before the operator sees the touch


@pytest.mark.slow
def test_stock_agents_end_after_their_steps_beside_others(small):
    run = small("stock")
    assert {run[name]["steps"][-1] for name in stock.ALGORITHMS} == {64}
    scenarios = ScenarioBatch(41_000_000, 500, time_weight=[2.0])
    for name, controller in (("rule", PaperTrapezoid()), ("policy", load_policy(stock.FIRST))):
        assert run["others"][name][0] == scenarios.play(controller).loss(2.0).mean()


def test_rate_counts_every_step_of_the_calls_made():
    for takes, steps, expected in ((0.25, 5, 20.0), (8.0, 4, 0.5)):
        now = count(0.0, takes)  # each reading of the clock is one call later
        assert bench.rate(lambda: None, steps, 3.0, partial(next, now)) == expected


def test_page_of_stability_lists_every_failure(small):
    run = small("stability")
    late, _ = run["truth"].to_dicts()
    assert (late["speed"], late["velocity"]) == (approaches.storm(2).motion.speed, None)
    assert "TimeoutError" in late["failure"]
    change = pl.DataFrame({"scene": [3, 5], "milliseconds": [77.0, 0.1], "failure": ["", "RuntimeError: it stopped"]})
    findings = stability.STUDY.analyse(run | {"storm": run["storm"].update(change, on="scene")}, False)
    listed = {row[:2] for row in findings.tables["failures"].iter_rows()}
    assert listed >= {(3, promises.FAST.text), (5, promises.ENDED.text)}
    verdicts = {text: met for text, _, met in findings.sections[0].parts[0].rows}
    assert [verdicts[promise.text] for promise in (promises.FAST, promises.FINITE)] == ["missed", "met"]
