"""Whole arms beside one mass: rows that hold together, and the page."""

import numpy as np
import pytest
from pages import text_of_a_page_that_stands_on_its_own

from experiments.arm import __main__ as arm
from experiments.arm import blows, gain, robots
from experiments.lab import experiment

pytest.importorskip("mujoco", reason="the extra robot is not installed")


def test_lines_are_two_easy_ones_and_one_past_a_singularity():
    for place, (low, high) in enumerate([(0.0, robots.EASY), (0.0, robots.EASY), (robots.NEAR, 30.0)]):
        made, approach = robots.approach_of("two links", place, 1.0)
        worst = max(made.condition(angles) for angles in approach.joint_angles)
        assert low - 0.5 < worst < high + 0.5  # looked at more closely than when they were drawn
    stiffer = robots.approach_of("two links", 0, 3.0)[1]
    np.testing.assert_allclose(stiffer.stiffness, 3.0 * robots.approach_of("two links", 0, 1.0)[1].stiffness, rtol=1e-9)


def test_page_has_every_model_and_numbers_that_hold_together(tmp_path):
    def compute(gather):
        scenes = gather("scenes", blows.played, [{"arm": "two links", "line": 0, "count": 9}], "")
        return {"scenes": scenes, "gain": gather("gain", gain.played, [{"arm": "viper", "first": 0, "count": 2}], "")}

    made = {}
    show = lambda tables: arm.shown(made.setdefault("tables", tables))  # noqa: E731
    experiment.run("arm", tmp_path, "test", compute, show, processes=0)
    text = text_of_a_page_that_stands_on_its_own(tmp_path, figures=2)
    assert all(model in text for model in blows.MODELS)
    scenes, played = made["tables"]["scenes"], made["tables"]["gain"]
    assert {row["status"] for row in (*scenes, *played)} == {"ok"}
    for row in scenes:  # the chain's commands and the arm's are the same: what differs is the arm
        assert row["impact_velocity"] == pytest.approx(row["speed"], rel=0.5)
        assert row["object_velocity"] == pytest.approx(row["object_velocity: effective"], rel=0.5)
    stiff = [row for row in scenes if row["factor"] == 3.0]
    assert np.median(np.abs(blows.errors(stiff, "rigid robot"))) < 0.1
    for row in played:
        assert row["whole_time"] == pytest.approx(row["chain_time"], abs=0.01)
        assert row["whole"] == pytest.approx(row["chain"], rel=0.3, abs=0.02)


def test_an_arm_whose_description_is_not_here_says_so(monkeypatch):
    monkeypatch.setattr(robots, "DESCRIPTIONS", "no such package")
    assert robots.present() == ["two links", "viper"]
    with pytest.raises(ValueError, match="no description of 'panda' here: pip install no such package"):
        robots.arm_of("panda")
