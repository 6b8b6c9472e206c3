"""The studies gain, bench and teleop: distributions of distances, rates, and the assistances of an operator."""

import json
from html import unescape

import numpy as np
import polars as pl
import pytest
from pages import text_of_a_page_that_stands_on_its_own
from studies import small_run

from agents.evaluate.scenario_batch import ScenarioBatch
from experiments.lab.study import Cell
from experiments.studies import bench, gain, teleop
from impact_gym.task import Task
from impact_gym.teleop.channels import FIFTH_GENERATION


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


@pytest.mark.filterwarnings("ignore:SpringDamper.stroke")
def test_shares_add_up_and_worlds_differ_where_they_should(tmp_path):
    few = {"scenarios": 10, "generations": 3, "tested": 20}
    searches = [cell for cell in gain.searches(True, {}) if cell.labels["near"] == 0.15]
    searches = [cell._replace(arguments=cell.arguments | few) for cell in searches]
    assert len(searches) == 1 + 2 * len(gain.QUICK_WEIGHTS)
    asked = {("linear-blind", world) for world in ("as trained", "friction 0.3", "stroke 20 mm")}
    worlds = [cell for cell in gain.worlds(True, {}) if (cell.labels["setup"], cell.labels["change"]) in asked]
    worlds = [cell._replace(arguments=cell.arguments | {"scenarios": {"set": "test", "count": 8}}) for cell in worlds]
    run = small_run(gain.STUDY, tmp_path, priors=searches, worlds=worlds)
    run.write()
    (line,) = gain.by_prior(run.frames["priors"])
    assert line["limits"].value + line["place"].value == pytest.approx(line["all"].value, rel=1e-12)
    rows = gain.priors_section([line | {"missed": share} for share in (0.01, 0.011)]).parts[0].rows
    assert ["missed" in row[0] for row in rows] == [False, True]
    rule, steady, profile = line["velocity"]
    assert rule.value == pytest.approx(run.frames["priors"].filter(rule="rule")["object_velocity"].mean())
    assert (line["limits"].value, line["profile"].value) == pytest.approx(
        ((rule.value - steady.value) / rule.value, 1.0 - profile.value / steady.value)
    )
    frame, names = run.frames["worlds"], [gain.RULE, gain.PROFILE, gain.POLICY]
    assert frame["contestant"].unique(maintain_order=True).to_list() == names
    assert frame.filter(pl.col("slide").is_null())["change"].unique().sort().to_list() == ["as trained", "stroke 20 mm"]
    table = {(row["world"], row["contestant"]): row for row in gain.by_world(frame)}
    for who in names:
        assert table["as trained", who]["slides (cm)"] == "-" != table["friction 0.3", who]["slides (cm)"]
        trained, ends = (frame.filter(change=world, contestant=who) for world in ("as trained", "stroke 20 mm"))
        assert not trained["object_velocity"].equals(ends["object_velocity"])


QUICK = {"quick": True}


def test_page_has_rates_beside_gymnasiums_and_the_time_of_an_approach(tmp_path):
    name, cases = bench.SETUPS[0], bench.cases()["coupling"]
    run = small_run(
        bench.STUDY, tmp_path, environments=[Cell({}, QUICK)], rates=[Cell({"set-up": name}, {"name": name, **QUICK})],
        cost=[Cell({"by": "coupling", "case": case}, {"environment": cases[case], **QUICK}) for case in [*cases][:2]],
    )  # fmt: skip
    run.write()
    text = text_of_a_page_that_stands_on_its_own(tmp_path, figures=0)
    assert all(word in text for word in (name, bench.BATCH_SCALE, bench.SCALE, "the default"))
    (ours,) = run.frames["rates"].to_dicts()
    assert 0.0 < ours["training, torch threads: 1"] < ours["environment"]  # the same steps without learning
    rows = {(name, envs): (steps, ratio) for name, envs, steps, ratio in run.frames["environments"].rows()}
    steps, ratio = rows[bench.SCALE, 1]
    assert ratio == rows[bench.ID, 1][0] / steps
    assert {envs for name, envs in rows if name == bench.ID} == {1, *bench.SIZES[::2]}
    assert min(steps for steps, _ in rows.values()) > 0.0


def test_cost_is_beside_that_of_the_default():
    costs = pl.DataFrame({"case": ["rigid", "spring (the default)"], "microseconds": [5.0, 20.0]})
    assert bench.with_ratio(costs)["ratio"].to_list() == [0.25, 1.0]


@pytest.mark.parametrize("rounds", [1, 3])
@pytest.mark.parametrize(("takes", "steps", "expected"), [(0.25, 5, 20.0), (8.0, 4, 0.5)])
def test_rate_counts_every_step_of_the_calls_made(rounds, takes, steps, expected):
    now = [0.0]

    def wait():
        now[0] += takes

    assert bench.rate(wait, steps, 3.0, rounds, lambda: now[0]) == expected


COUNT = 25


def few(cells):
    """Cells of two places, with few scenarios and one seed of the policy."""
    asked = {("spring", "reach", 0.2), ("rigid", "steady", 0.2)}
    for cell in cells:
        place = tuple(cell.labels[name] for name in ("coupling", "operator", "delay"))
        if place in asked and not cell.labels["channel"] and cell.labels["seed"] in (0, 1):
            scenarios = {**cell.arguments["scenarios"], "count": COUNT}
            yield cell._replace(arguments=cell.arguments | {"scenarios": scenarios})


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    run = small_run(teleop.STUDY, tmp_path_factory.mktemp("teleop"), episodes=list(few(teleop.assisted(True, {}))))
    run.write()
    return run


def test_page_has_every_contestant_and_numbers_that_hold_together(study):
    text = unescape(text_of_a_page_that_stands_on_its_own(study.folder, figures=2))
    found = teleop.table_of_cells(study.frames)
    names = {row["contestant"] for row in found}
    assert names == {*teleop.ASSISTANCE}
    assert all(name in text for name in names)
    assert f"over {COUNT} scenarios" in text
    by_name = {(row["operator"], row["contestant"]): row for row in found}
    for (operator, who), row in by_name.items():
        assert row["slide_low"] <= row["slide"] <= row["slide_high"]
        brake = by_name[operator, teleop.BRAKE]
        assert row["cost"] == pytest.approx(row["object_velocity"] + 0.5 * row["done_time"] + 2.0 * row["missed"])
        assert row["brake_slide"] == pytest.approx(brake["slide"] - row["slide"], abs=1e-12)
        assert row["brake_cost"] == pytest.approx(brake["cost"] - row["cost"], abs=1e-12)
        if who in (teleop.ALONE, teleop.BRAKE, teleop.RULE):
            assert row["taken"] == 0.0  # they do not change the command before the touch
        if who == teleop.ALONE:  # the gain of 1
            assert row["gain_slide"] == pytest.approx(0.0, abs=1e-12)
            assert row["gain_cost"] <= 0.0
    for operator in (teleop.REACH, "steady"):  # the brake stops before the operator sees the touch
        assert by_name[operator, teleop.BRAKE]["slide"] < by_name[operator, teleop.ALONE]["slide"]


def row_of(who, column, low, high, **others):
    """A row with one number, in an interval; all others are 0."""
    names = [*teleop.WORSE, "limit_cost"]
    numbers = dict.fromkeys([*names, *(f"{name}_{end}" for name in names for end in ("low", "high"))], 0.0)
    numbers |= {column: 0.5 * (low + high), f"{column}_low": low, f"{column}_high": high, "cost": 1.0}
    return {"contestant": who, "coupling": "rigid", "operator": "steady", "delay": 0.1} | numbers | others


def test_hurts_names_all_cells_that_are_worse_beyond_their_interval_and_the_worst():
    rows = [
        row_of(teleop.POLICY, "brake_slide", -0.03, -0.01), row_of(teleop.POLICY, "brake_slide", -0.03, 0.0, delay=0.2),
        row_of(teleop.POLICY, "brake_slide", -0.09, -0.05, delay=0.4), row_of(teleop.ALONE, "brake_slide", -0.9, -0.8),
        row_of(teleop.BRAKE, "gain_cost", -0.3, -0.1, operator="hand"),
    ]  # fmt: skip
    first, second = teleop.hurts(rows)
    assert first == (
        teleop.POLICY, f"slides further than with the {teleop.BRAKE}", "2",
        "7.00 [5.00, 9.00] cm (rigid, steady, 400 ms)", "rigid, steady: 100, 400 ms",
    )  # fmt: skip
    assert second[:3] == (teleop.BRAKE, "costs more than constant gains", "1")


def test_duel_counts_cells_and_weighs_all_of_them():
    rows = [row_of(teleop.POLICY, "brake_cost", low, low + 0.2) for low in (0.1, -0.2, -0.3, 0.0, 0.3)]
    text = teleop.duel([*rows, row_of(teleop.BRAKE, "brake_cost", 5.0, 6.0)], "brake")
    assert "clearly less than the local brake in 2 of 5 cells and clearly more in 1" in text  # 0 is neither
    assert f"over all {100.0 * 0.4 / 5.4:.1f} % less" in text
    assert "by 0.400 [0.300, 0.500] m/s (rigid, steady, 100 ms) at the most and -0.200 [-0.300, -0.100] m/s" in text


def test_recordings_have_the_whole_length_and_are_not_those_of_the_training():
    recorded, seen = teleop.recordings(), teleop.environment_of("rigid", teleop.SEEN, {"delay": 0.1})["operator"]
    task = Task(**teleop.environment_of("rigid", "recordings", {"delay": 0.1}))
    assert min(task.operator.velocity) == 0.0
    time, velocity = (np.array(recorded[name]).reshape(teleop.RECORDINGS, -1) for name in ("time", "velocity"))
    assert np.trapezoid(velocity, time, axis=1) == pytest.approx(teleop.WAY)
    assert (time[:, -1] - time[:, 0]).max() < teleop.APART
    assert {*seen["velocity"]} & {*velocity.ravel()} == {0.0}


def test_every_cell_has_arguments_that_a_job_can_take():
    channels = {cell.labels["channel"] for cell in teleop.assisted(True, {}) if json.dumps(cell.arguments)}
    assert channels == {"", *FIFTH_GENERATION}
