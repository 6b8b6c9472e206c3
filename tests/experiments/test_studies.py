"""The studies gain, bench and teleop: distributions of distances, rates, and the assistances of an operator."""

from html import unescape

import numpy as np
import pytest
from pages import text_of_a_page_that_stands_on_its_own
from studies import small_run

from agents.evaluate.scenario_batch import ScenarioBatch
from experiments.lab.study import Cell
from experiments.studies import bench, gain, teleop


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
    run = small_run(gain.STUDY, tmp_path, priors=searches)
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
    rates = [Cell({"set-up": name}, {"name": name, **quick})]
    run = small_run(bench.STUDY, tmp_path, environments=[Cell({}, quick)], rates=rates)
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


def test_page_has_every_contestant_and_numbers_that_hold_together(tmp_path):
    asked, cells = [("spring", "reach", 0.2), ("rigid", "steady", 0.2)], []
    for cell in teleop.assisted(True, {}):
        place = tuple(cell.labels[name] for name in ("coupling", "operator", "delay"))
        if place in asked and cell.labels["seed"] in (0, 1):
            scenarios = {**cell.arguments["scenarios"], "count": 25}
            cells.append(cell._replace(arguments=cell.arguments | {"scenarios": scenarios}))
    run = small_run(teleop.STUDY, tmp_path, episodes=cells)
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
