"""Who assists an operator: the cells' numbers, and the page."""

import math
from html import unescape

import numpy as np
import pytest
from pages import text_of_a_page_that_stands_on_its_own

from experiments.lab import experiment
from experiments.teleop import __main__ as teleop
from experiments.teleop import cells
from impact_gym.task import Task


def test_page_has_every_contestant_and_numbers_that_hold_together(tmp_path):
    compute = lambda gather: {"cells": gather("cells", cells.played, [  # noqa: E731
        {"coupling": "spring", "delay": 0.2, "operator": cells.REACH, "count": 25},
        {"coupling": "rigid", "delay": 0.2, "operator": "recordings", "count": 25},
    ], "")}  # fmt: skip
    made = {}
    show = lambda tables: teleop.shown(made.setdefault("tables", tables))  # noqa: E731
    experiment.run("teleop", tmp_path, "test", compute, show, processes=0)
    text = unescape(text_of_a_page_that_stands_on_its_own(tmp_path, figures=2))
    found = made["tables"]["cells"]
    names = {row["contestant"] for row in found}
    known = {cells.ALONE, cells.RULE, cells.BRAKE, cells.LIMIT, cells.POLICY}
    assert names == known | {name + cells.SHUFFLED for name in (cells.ALONE, cells.BRAKE, cells.POLICY)}
    assert all(name in text for name in names)
    assert "over 25 scenarios" in text
    by_name = {(row["operator"], row["contestant"]): row for row in found}
    for (operator, who), row in by_name.items():
        assert row["slide_low"] <= row["slide"] <= row["slide_high"]
        brake = by_name[operator, cells.BRAKE]
        if cells.SHUFFLED in who:
            assert math.isnan(row["brake_cost"])
            continue
        assert row["cost"] == pytest.approx(row["object_velocity"] + 0.5 * row["done_time"] + 2.0 * row["missed"])
        assert row["brake_slide"] == pytest.approx(brake["slide"] - row["slide"], abs=1e-12)
        assert row["brake_cost"] == pytest.approx(brake["cost"] - row["cost"], abs=1e-12)
        if who in (cells.ALONE, cells.BRAKE, cells.RULE):
            assert row["taken"] == 0.0  # they withhold nothing before the touch
        if who == cells.ALONE:  # one of the gains
            assert (row["gain_slide"], row["median_ratio"]) == pytest.approx((0.0, 1.0), abs=1e-12)
            assert row["gain_cost"] <= 0.0
    for operator in (cells.REACH, "recordings"):  # who senses at once stops before the operator has seen anything
        assert by_name[operator, cells.BRAKE]["slide"] < by_name[operator, cells.ALONE]["slide"]


def row_of(who, column, low, high, **others):
    """A row with one number, in an interval; all others are 0."""
    names = [*teleop.WORSE, "limit_cost"]
    numbers = dict.fromkeys([*names, *(f"{name}_{end}" for name in names for end in ("low", "high"))], 0.0)
    numbers |= {column: 0.5 * (low + high), f"{column}_low": low, f"{column}_high": high, "cost": 1.0}
    return {"contestant": who, "coupling": "rigid", "operator": "steady", "delay": 0.1} | numbers | others


def test_hurts_names_all_cells_that_are_worse_beyond_their_interval_and_the_worst():
    rows = [
        row_of(cells.POLICY, "brake_slide", -0.03, -0.01), row_of(cells.POLICY, "brake_slide", -0.03, 0.01, delay=0.2),
        row_of(cells.POLICY, "brake_slide", -0.09, -0.05, delay=0.4), row_of(cells.ALONE, "brake_slide", -0.9, -0.8),
        row_of(cells.BRAKE, "gain_cost", -0.3, -0.1, operator="hand"),
    ]  # fmt: skip
    first, second = teleop.hurts(rows)
    assert first == {
        "who": cells.POLICY, "what": f"slides further than with the {cells.BRAKE}", "count": "2",
        "where": "rigid, steady: 100, 400 ms", "most": "7.00 [5.00, 9.00] cm (rigid, steady, 400 ms)",
    }  # fmt: skip
    assert (second["who"], second["what"], second["count"]) == (cells.BRAKE, "costs more than constant gains", "1")


def test_duel_counts_cells_and_weighs_all_of_them():
    rows = [row_of(cells.POLICY, "brake_cost", low, low + 0.2) for low in (0.1, -0.1, -0.3, 0.3)]
    result = teleop.duel([*rows, row_of(cells.BRAKE, "brake_cost", 5.0, 6.0)], "brake")
    assert (result["cells"], result["less"], result["more"]) == (4, 2, 1)
    assert (result["best"], result["worst"]) == (rows[3], rows[2])
    assert result["share"] == pytest.approx(100.0 * 0.4 / 4.4)


def test_recordings_go_the_whole_way_and_are_none_of_the_training():
    recorded, seen = cells.recordings(), cells._environment("rigid", cells.SEEN, {"delay": 0.1})["operator"]
    assert Task(**cells._environment("rigid", "recordings", {"delay": 0.1})).operator.recorded.min() == 0.0
    time, velocity = (np.array(recorded[name]).reshape(cells.RECORDINGS, -1) for name in ("time", "velocity"))
    assert np.trapezoid(velocity, time, axis=1) == pytest.approx(cells.WAY)
    assert (time[:, -1] - time[:, 0]).max() < cells.APART
    assert {*seen["velocity"]} & {*velocity.ravel()} == {0.0}
