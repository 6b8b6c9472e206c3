"""Who assists an operator: the cells' numbers, and the page."""

from html import unescape

import pytest
from pages import text_of_a_page_that_stands_on_its_own

from experiments.lab import experiment
from experiments.teleop import __main__ as teleop
from experiments.teleop import cells


def test_page_has_every_contestant_and_numbers_that_hold_together(tmp_path):
    compute = lambda gather: {"cells": gather("cells", cells.played, [  # noqa: E731
        {"coupling": "spring", "delay": 0.2, "operator": cells.TRAINED, "count": 25},
        {"coupling": "rigid", "delay": 0.2, "operator": "steady", "count": 25},
    ], "")}  # fmt: skip
    made = {}
    show = lambda tables: teleop.shown(made.setdefault("tables", tables))  # noqa: E731
    experiment.run("teleop", tmp_path, "test", compute, show, processes=0)
    text = text_of_a_page_that_stands_on_its_own(tmp_path, figures=1)
    found = made["tables"]["cells"]
    names = {row["contestant"] for row in found}
    known = {cells.ALONE, cells.GAIN, cells.BRAKE, cells.POLICY, "paper's rule", "speed limit"}
    assert names == known | {name + cells.SHUFFLED for name in known}
    assert all(name in unescape(text) for name in names)
    for row in found:
        assert row["touch_time"] <= row["done_time"]
        assert row["slide_low"] <= row["slide"] <= row["slide_high"]
        if row["contestant"] in (cells.ALONE, cells.BRAKE, "paper's rule"):
            assert row["taken"] == 0.0  # they withhold nothing before the touch
        if row["contestant"] == cells.GAIN:
            assert row["less_slide"] == pytest.approx(0.0, abs=1e-12)
    by_name = {(row["operator"], row["contestant"]): row for row in found}
    for operator in (cells.TRAINED, "steady"):  # who senses at once stops before the operator has seen anything
        assert by_name[operator, cells.BRAKE]["slide"] < by_name[operator, cells.ALONE]["slide"]
