"""Whole arms beside one mass: rows that hold together, and the page."""

from zlib import crc32

import numpy as np
import pytest
from pages import text_of_a_page_that_stands_on_its_own

from experiments.arm import __main__ as arm
from experiments.arm import blows, gain, robots
from experiments.lab import experiment

pytest.importorskip("mujoco", reason="the extra robot is not installed")


def test_lines_are_two_easy_ones_and_one_near_a_singularity_and_differ_from_arm_to_arm():
    for place, (low, high) in enumerate([(0.0, robots.EASY), (0.0, robots.EASY), (robots.NEAR, 30.0)]):
        made, approach = robots.approach_of("two links", place)
        worst = max(made.condition(angles) for angles in approach.joint_angles)
        assert low - 0.5 < worst < high + 0.5  # looked at more closely than when they were drawn
    stiffer = robots.approach_of("two links", 0, 3.0)[1]
    np.testing.assert_allclose(stiffer.stiffness, 3.0 * robots.approach_of("two links", 0)[1].stiffness, rtol=1e-9)
    masses = [blows.played(arm, 0, 1)["rows"]["object_mass"][0] for arm in ("viper", "viper", "two links")]
    assert masses[0] == masses[1] != masses[2]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The page of a small study, its folder and its tables; one scene of it cannot be run."""
    folder, tables, plain = tmp_path_factory.mktemp("arm"), {}, blows.simulate

    def compute(gather):
        scenes = gather("scenes", blows.played, [{"arm": "two links", "line": 0, "count": 9}], "")
        played = [{"arm": "viper", "setup": "linear-blind", "first": 0, "count": 3}]
        linear = blows.linear_rows(gather, ["two links"])
        return {"scenes": scenes, "linear": linear, "gain": gather("gain", gain.played, played, "")}

    def broken(scene, *given, **options):
        if scene.object.mass == spoiled:
            raise RuntimeError("made up")
        return plain(scene, *given, **options)

    drawn = blows._scenes(np.random.default_rng((crc32(b"two links"), 0, 9)), 9)
    spoiled = [mass for _, _, mass, _, _ in drawn][4]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blows, "simulate", broken)
        experiment.run("arm", folder, "test", compute, lambda rows: arm.shown(tables.setdefault("", rows)), processes=0)
    return folder, tables[""]


def test_page_has_every_model_and_a_bad_scene_spoils_no_other(made):
    folder, tables = made
    text = text_of_a_page_that_stands_on_its_own(folder, figures=2)
    assert all(model in text for model in blows.MODELS)
    assert "1 scenes have no result: made up" in text
    assert [row["status"] for row in tables["scenes"]] == ["ok"] * 4 + ["made up"] + ["ok"] * 4
    assert "impact-gym, MIT" in text


def test_rows_hold_together(made):
    _, tables = made
    scenes = [row for row in tables["scenes"] if row["status"] == "ok"]
    for row in scenes:  # the chain's commands and the arm's are the same: what differs is the arm
        assert row["impact_velocity"] == pytest.approx(row["speed"], rel=0.5)
        assert row["object_velocity"] == pytest.approx(row["object_velocity: effective"], rel=0.5)
    stiff = [row for row in scenes if row["factor"] == 3.0]
    assert np.median(np.abs(blows.errors(stiff, "rigid robot"))) < 0.1
    (by_arm,) = arm.linearised(tables["linear"])
    assert by_arm["count"] == 9
    assert 0.0 < by_arm["median"] < 0.1  # a mechanism that snaps in one of the two and not in the other is far off
    for row in tables["gain"]:
        assert row["whole_time"] == pytest.approx(row["chain_time"], abs=0.01)
        assert row["whole"] == pytest.approx(row["chain"], rel=0.3, abs=0.02)


def test_decision_names_the_mass_with_the_least_error_and_the_gain_leaves_out_what_has_no_result(made):
    _, tables = made
    rows = [{"arm": "a", "line": k % 2, "object_velocity": 1.0, "impact_velocity": 1.0, "peak_force": 1.0,
             "contact_time": 1.0} for k in range(8)]  # fmt: skip
    off = {"held": 0.3, "effective": 0.1, "composite": 0.2, "rigid robot": 0.0}
    for k, row in enumerate(rows):
        row |= {f"{m}: {model}": 1.0 + error for m in blows.MEASURES for model, error in off.items()}
        if k == 0:
            row["object_velocity: effective"] = 1.9
    found = arm.decision("all", rows)
    assert (found["median"], found["most"], found["nearest"]) == ("effective", "composite", [0, 7, 1])
    assert found["errors"]["peak_force"]["held"][0].value == pytest.approx(0.3)
    played = [dict(row) for row in tables["gain"]]
    lost = next(row for row in played if row["contestant"] == "policy")
    lost |= {"whole": np.nan, "status": "made up"}
    for line in gain.table(played):
        assert (line["count"], line["left_out"]) == (2, 1)
        mine = [row for row in played if row["contestant"] == line["contestant"]]
        kept = [row["whole"] for row in mine if row["scenario"] != lost["scenario"]]
        assert line["whole"].value == pytest.approx(np.mean(kept))


def test_an_arm_whose_description_is_not_here_says_so(monkeypatch):
    kinds = {name: kind._replace(package=kind.package and "no such package") for name, kind in robots.KINDS.items()}
    monkeypatch.setattr(robots, "KINDS", kinds)
    assert robots.present() == ["two links", "viper"]
    with pytest.raises(ValueError, match=r"no description of 'panda' here: pip install 'impact-gym\[arms\]'"):
        robots.arm_of("panda", 7.0)
