"""The studies gain, bench, teleop, stock and speed: distances, rates, assistances, trainings, rivals of the solver."""

import importlib.util
import math
import sys
from dataclasses import asdict, replace
from html import unescape

import numpy as np
import polars as pl
import pytest
from browser_pages import text_of_a_page_that_stands_on_its_own
from small_studies import small_run

from agents.baselines import PaperTrapezoid
from agents.evaluate.scenario_batch import ScenarioBatch
from experiments.lab.study import Cell
from experiments.studies import bench, gain, speed, stock, teleop
from experiments.studies.solvers import approaches, contenders, taylor
from experiments.studies.solvers.approaches import Solution
from experiments.studies.solvers.contenders import CAREFUL, OURS, PEER


def test_distances_have_the_distribution_of_the_prior():
    uniform, memoryless = gain.Prior(0.15, 0.35), gain.Prior(0.001, 0.6, memoryless=True)
    assert np.sort(uniform.distances(1, 400)) == pytest.approx(0.15 + 0.2 * (np.arange(400) + 0.5) / 400)
    away = memoryless.distances(1, 100_000) - 0.001
    assert away.mean() == pytest.approx(memoryless.mean, rel=1e-3)
    for gone in (0.1, 0.3):  # the remaining distance has the same distribution everywhere
        assert (away[away > gone] - gone).mean() == pytest.approx(memoryless.mean, rel=1e-2)
    assert (away < 0.599).mean() == pytest.approx(0.95, abs=1e-3)


def test_steady_rule_keeps_its_speed_wherever_it_is():
    numbers = [0.4, 15.0, *(parameter.start for parameter in gain.REACTION)]
    played = ScenarioBatch.of("test", 20).play(gain.Steady(numbers))
    ramp = 0.4 / 15.0  # s, in which it travels half as far as at full speed
    assert played.approach_time == pytest.approx(played.scenario["distance"] / 0.4 + ramp / 2, abs=2e-2)


def test_search_prefers_a_gentle_touch_to_none_however_little_time_costs():
    assert not gain.searched((0.15, 0.35), "steady", 0.05, 20, 12, 50)["missed"].any()


def test_shares_add_up(tmp_path):
    few = {"scenarios": 10, "generations": 3, "tested": 20}
    searches = [cell for cell in gain.searches(True, {}) if cell.labels["near"] == 0.15]
    searches = [cell._replace(arguments=cell.arguments | few) for cell in searches]
    assert len(searches) == 1 + 2 * len(gain.QUICK_WEIGHTS)
    run = small_run(gain.STUDY, tmp_path, priors=lambda *_: searches)
    run.write()
    (line,) = gain.by_prior(run["priors"])
    assert line["limits"].value + line["place"].value == pytest.approx(line["all"].value, rel=1e-12)
    rule, steady, profile = line["velocity"]
    assert rule.value == pytest.approx(run["priors"].filter(rule="rule")["object_velocity"].mean())
    assert (line["limits"].value, line["profile"].value) == pytest.approx(
        ((rule.value - steady.value) / rule.value, 1.0 - profile.value / steady.value)
    )


def test_page_has_rates_beside_gymnasiums(tmp_path):
    name, quick = bench.SETUPS[0], {"quick": True}
    rates, environments = [Cell({"set-up": name}, {"name": name, **quick})], [Cell({}, quick)]
    run = small_run(bench.STUDY, tmp_path, environments=lambda *_: environments, rates=lambda *_: rates)
    run.write()
    text_of_a_page_that_stands_on_its_own(tmp_path, figures=0)
    (ours,) = run["rates"].to_dicts()
    assert 0.0 < ours["training"] < ours["environment"]  # the same steps without learning
    rows = {(name, envs): (steps, ratio) for name, envs, steps, ratio in run["environments"].rows()}
    steps, ratio = rows[bench.SCALE, 1]
    assert ratio == rows[bench.ID, 1][0] / steps
    assert {envs for name, envs in rows if name == bench.ID} == {1, *bench.SIZES[::2]}
    assert min(steps for steps, _ in rows.values()) > 0.0


@pytest.mark.parametrize(("takes", "steps", "expected"), [(0.25, 5, 20.0), (8.0, 4, 0.5)])
def test_rate_counts_every_step_of_the_calls_made(takes, steps, expected):
    now = [0.0]

    def wait():
        now[0] += takes

    assert bench.rate(wait, steps, 3.0, lambda: now[0]) == expected


def test_page_of_operators_has_every_contestant_and_numbers_that_hold_together(tmp_path):
    asked, cells = [("spring", "reach", 0.2), ("rigid", "steady", 0.2)], []
    for cell in teleop.assisted(True, {}):
        place = tuple(cell.labels[name] for name in ("coupling", "operator", "delay"))
        if place in asked and cell.labels["seed"] in (0, 1):
            scenarios = {**cell.arguments["scenarios"], "count": 25}
            cells.append(cell._replace(arguments=cell.arguments | {"scenarios": scenarios}))
    run = small_run(teleop.STUDY, tmp_path, episodes=lambda *_: cells)
    run.write()
    text = unescape(text_of_a_page_that_stands_on_its_own(tmp_path, figures=2))
    found = teleop.table_of_cells(run)
    names = {row["contestant"] for row in found}
    assert names == {*teleop.ASSISTANCE}
    assert all(name in text for name in names)
    assert "over 25 scenarios" in text
    by_name = {(row["operator"], row["contestant"]): row for row in found}
    for (operator, who), row in by_name.items():
        assert row["slide_low"] <= row["slide"] <= row["slide_high"]
        brake = by_name[operator, teleop.BRAKE]
        assert row["cost"] == pytest.approx(row["object_velocity"] + 0.5 * row["done_time"] + 2.0 * row["missed"])
        assert row["brake_slide"] == pytest.approx(brake["slide"] - row["slide"], abs=1e-12)
        assert row["brake_cost"] == pytest.approx(brake["cost"] - row["cost"], abs=1e-12)
        if who in (teleop.ALONE, teleop.BRAKE, teleop.RULE):
            assert row["taken"] == 0.0  # they do not change the command before the touch
    for operator in (teleop.REACH, "steady"):  # the brake stops before the operator sees the touch
        assert by_name[operator, teleop.BRAKE]["slide"] < by_name[operator, teleop.ALONE]["slide"]


NAMED = {approach.name: approach for approach in approaches.named()}


@pytest.mark.parametrize("approach", NAMED)
def test_a_solution_with_34_digits_confirms_the_truth_and_every_contender(approach):
    number = getattr(pytest.importorskip(PEER), "real128", None) or pytest.skip("heyoka has no numbers of 34 digits")
    exact, truth = taylor.Run(*NAMED[approach].run, 1e-30, number).solve(), contenders.true_row(approach)[0]
    assert truth["velocity"] == pytest.approx(float(exact.velocity), rel=0.0, abs=1e-13)
    for name, setting, error in ((OURS, 1e-13, 1e-14), (PEER, 1e-10, 1e-7)):
        solution, _ = contenders.solved(NAMED[approach], name, setting)
        assert contenders.failure(solution, exact, error) == ""
        assert solution.detection_time == pytest.approx(float(exact.detection_time), rel=0.0, abs=1e-9)


def test_a_rival_that_is_missing_or_fails_is_a_row_that_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, PEER, None)
    taylor.integrator.cache_clear()
    tried = [(OURS, 1e-6), (f"{CAREFUL} Euler", 1e-6), (PEER, 1e-6)]
    truth = asdict(Solution(0.753695, contacts=2, detection_time=0.36))  # V_p: heyoka with 34 digits
    ours, *failed = contenders.timed("stiff", truth, tried, rounds=2)
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

    def times(_, frames):
        return [cell for cell in speed.cells_of_times(True, frames) if cell.labels["rival"] == CAREFUL]

    run = small_run(speed.STUDY, tmp_path, truth=lambda *_: cells, times=times)
    run.write()
    rows = run["times"]
    assert {*rows["contender"]} == {OURS, *speed.RIVALS[CAREFUL]}
    assert rows.filter(contender=OURS, setting=1e-9)["velocity_error"].item() < 1e-7
    (truth,) = run["truth"].to_dicts()
    assert truth["second_contacts"] == truth["contacts"]
    assert truth["velocity_doubt"] < 1e-9
    assert "No rival is faster" in text_of_a_page_that_stands_on_its_own(tmp_path, figures=1)


@pytest.mark.skipif(importlib.util.find_spec("rl_zoo3") is None, reason="rl_zoo3 is not installed")
def test_trainings_of_stock_agents_end_after_their_steps_beside_the_rule(tmp_path):
    small, cells = {"n_timesteps": 64, "n_envs": 8, "n_steps": 4, "batch_size": 32, "learning_starts": 16}, {}
    for name in stock.ALGORITHMS:
        (cell, *_) = stock.trainings(name, True, {})
        settings = cell.arguments["settings"]
        settings |= {key: value for key, value in small.items() if key in settings}
        cells[name] = lambda *_, cell=cell: [cell]
    first = {"setup": "linear-blind"}
    run = small_run(stock.STUDY, tmp_path, others=lambda *_: [Cell(first, first)], **cells)
    run.write()
    text_of_a_page_that_stands_on_its_own(tmp_path, figures=1)
    assert {run[name]["steps"][-1] for name in stock.ALGORITHMS} == {64}
    rule = ScenarioBatch(41_000_000, 500, time_weight=[2.0]).play(PaperTrapezoid())
    assert run["others"]["rule"][0] == rule.loss(2.0).mean()
