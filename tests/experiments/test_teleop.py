"""Who assists an operator: the numbers of cells, and which sentences they allow."""

import json
from html import unescape

import numpy as np
import pytest
from pages import text_of_a_page_that_stands_on_its_own
from studies import small_run

from experiments.studies import teleop
from impact_gym.task import Task
from impact_gym.teleop.channels import FIFTH_GENERATION

COUNT = 25


def few(cells):
    """Cells with few scenarios, one seed of the policy, and two of the places."""
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
            assert row["taken"] == 0.0  # they withhold nothing before the touch
        if who == teleop.ALONE:  # one of the gains
            assert (row["gain_slide"], row["median_ratio"]) == pytest.approx((0.0, 1.0), abs=1e-12)
            assert row["gain_cost"] <= 0.0
    for operator in (teleop.REACH, "steady"):  # who senses at once stops before the operator has seen anything
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
    result = teleop.duel([*rows, row_of(teleop.BRAKE, "brake_cost", 5.0, 6.0)], "brake")
    assert (result["cells"], result["less"], result["more"]) == (5, 2, 1)  # 0 is not clearly less, nor more
    assert (result["best"], result["worst"]) == (rows[4], rows[2])
    assert result["share"] == pytest.approx(100.0 * 0.4 / 5.4)
    assert "clearly less than the local brake in 2 of 5 cells and clearly more in 1" in teleop.duel_sentence(result)


def test_recordings_go_the_whole_way_and_are_none_of_the_training():
    recorded, seen = teleop.recordings(), teleop.environment_of("rigid", teleop.SEEN, {"delay": 0.1})["operator"]
    task = Task(**teleop.environment_of("rigid", "recordings", {"delay": 0.1}))
    assert task.operator.recorded.min() == 0.0
    time, velocity = (np.array(recorded[name]).reshape(teleop.RECORDINGS, -1) for name in ("time", "velocity"))
    assert np.trapezoid(velocity, time, axis=1) == pytest.approx(teleop.WAY)
    assert (time[:, -1] - time[:, 0]).max() < teleop.APART
    assert {*seen["velocity"]} & {*velocity.ravel()} == {0.0}


def test_every_cell_has_arguments_that_a_job_can_take():
    channels = {cell.labels["channel"] for cell in teleop.assisted(True, {}) if json.dumps(cell.arguments)}
    assert channels == {"", *FIFTH_GENERATION}
