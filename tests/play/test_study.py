"""A study: its plan, what a person is told, what is found, and how often what is not there."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from playing import closed, heard, play, say, served
from scipy import stats

from experiments.play import calibration, plan, report
from experiments.play.tries import folder_of

TEXT = """
title = "Does a brake help?"
setup = "teleop-spring"
outcome = "slide at equal done_time"
smallest = 0.01
practice = 2
blocks = 1
tries = 2
consent = "You will push a tool."
[conditions.alone]
assist = "none"
delay = 0.3
[conditions.brake]
assist = "brake"
delay = 0.3
"""


@pytest.fixture
def study_file(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(TEXT)
    return path


@pytest.mark.parametrize(("old", "new", "message"), [
    ('outcome = "slide at equal done_time"', "", "outcome must be fixed before anybody plays"),
    ('outcome = "slide at equal done_time"', 'outcome = "whatever"', "outcome must be fixed before anybody plays"),
    ('assist = "brake"', 'assist = "magic"', r"conditions.brake.assist must be one of"),
    ("[conditions.brake]", "[conditions.alone.more]", "conditions must be two tables"),
    ("smallest = 0.01", "smallest = 0.0", "smallest must be finite and above 0 m"),
    ("smallest = 0.01", "", "smallest must be a number in m"),
    ('consent = "You will push a tool."', "", "consent must be a str"),
    ("practice = 2", "practice = -1", "practice must be a whole number of at least 0"),
    ("practice = 2", "practise = 2", "key must be one of"),
    ("delay = 0.3", "delay = 3.0", "delay must be finite and at least 0 and at most 1"),
    ('setup = "teleop-spring"', 'setup = "linear-blind"', "has no operator"),
    ("tries = 2", "power = nan", "power must be finite"),
], ids=str)  # fmt: skip
def test_bad_plans_are_refused_in_one_line(study_file, old, new, message):
    study_file.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(ValueError, match=message) as refusal:
        plan.read(study_file)
    assert "\n" not in str(refusal.value)
    assert "plan.toml" in str(refusal.value)


def test_blocks_are_counterbalanced_seeded_and_have_the_same_scenarios(study_file):
    the_plan = replace(plan.read(study_file), blocks=3, tries=5, practice=20)
    orders = [the_plan.order(person) for person in range(40)]
    for one, other in zip(orders[::2], orders[1::2], strict=True):
        assert [{*pair} for pair in zip(one, other, strict=True)] == [{"alone", "brake"}] * 6
    assert {order[0] for order in orders[::2]} == {"alone", "brake"}
    for person in range(4):
        schedule = the_plan.schedule(person)
        assert schedule == the_plan.schedule(person)
        assert [slot["block"] for slot in schedule[:20]] == [0] * 20
        seeds = {block: {slot["seed"] for slot in schedule if slot["block"] == block} for block in range(1, 7)}
        assert seeds[1] == seeds[2] != seeds[3] == seeds[4]
        for block in range(1, 7):
            (condition,) = {slot["condition"] for slot in schedule if slot["block"] == block}
            assert condition == the_plan.order(person)[block - 1]
    assert the_plan.schedule(0) != the_plan.schedule(1) != replace(the_plan, seed=1).schedule(1)


def test_person_reads_agrees_practises_and_is_not_told_the_condition(study_file, tmp_path):
    folder = tmp_path / "tries"
    with served(folder, "--plan", str(study_file)) as server, server.connect() as page:
        hello = heard(page, "hello")
        assert hello["study"]["consent"] == "You will push a tool."
        assert hello["study"]["person"] is None
        say(page, agree=1)
        person = heard(page, "study")["study"]["person"]
        for done in range(1, 7):
            said = play(page)
            assert said["study"]["done"] == done
            assert not {"brake", "alone"} & {*str(said).split("'")}
        found = [this for _, this in folder_of(folder)]
        assert [this.study["block"] for this in found] == [0, 0, 1, 1, 2, 2]
        assert {this.study["person"] for this in found} == {person}
        assert all(this.record["uplink.delay"] == pytest.approx(0.15) for this in found)
        assert all(this.assist == {"alone": "none", "brake": "brake"}[this.study["condition"]] for this in found)
        kept = " ".join(path.read_text() for path in folder.glob("*.json"))
        assert "date" not in kept
        say(page, begin={})
        assert closed(page)[0] == 1008
    with served(folder, "--plan", str(study_file)) as server, server.connect() as page:
        say(page, agree=1)
        other = heard(page, "study")["study"]
        assert other["person"] != person
        assert other["done"] == 0


def test_scripted_persons_go_the_whole_way_to_the_page(study_file, tmp_path):
    the_plan, folder = plan.read(study_file), tmp_path / "tries"
    study = plan.Study(the_plan, folder)
    assert "pilot, 0 persons so far" in report.standing(the_plan, folder)
    report.play_scripted(study, folder, 4)
    rows = report.table_of(folder)
    assert len(rows) == 4 * study.length
    page = report.write(the_plan, folder)
    text = page.read_text()
    finding = report.found(report.analysed(rows, the_plan), the_plan)
    assert finding.difference < 0.0  # who is stopped at once pushes less far
    assert ("Pilot." in text) == (finding.needed is None or finding.needed > 4)
    assert pl.read_parquet(page.parent / "tries.parquet").equals(rows)
    assert f"{100 * abs(finding.difference):.2f} cm less far" in text


def rows_of(differences, spread=0.3, tries=6, slope=2.0):
    """Tries of persons with levels, differences (cm) and a slope over done_time (cm/s) that are known."""
    rng, rows = np.random.default_rng(1), []
    for person, difference in enumerate(differences):
        for second in (0, 1):
            late = rng.normal(2.0 + 0.4 * second, 0.3, tries)  # the second is later, too
            noise = rng.normal(0.0, spread, tries)
            slide = 3.0 + person + difference * second + slope * late + noise - noise.mean()
            same = {"person": person, "condition": ["first", "second"][second]}
            rows += [same | {"slide": 0.01 * each, "done_time": time} for each, time in zip(slide, late, strict=True)]
    return pl.DataFrame(rows)


def test_finding_is_the_difference_at_equal_done_time_with_the_interval_of_t():
    differences = [1.0, 1.4, 0.2, 0.9, 1.9, 0.6]
    finding = report.found(rows_of(differences, spread=0.01), calibration.PLAN)
    assert 100.0 * finding.difference == pytest.approx(np.mean(differences), abs=0.01)
    half = stats.t.ppf(0.975, 5) * np.std(differences, ddof=1) / np.sqrt(6)
    assert 100.0 * (finding.high - finding.low) / 2.0 == pytest.approx(half, rel=0.02)
    assert 100.0 * finding.spread == pytest.approx(np.std(differences, ddof=1), rel=0.02)
    assert report.found(rows_of(differences[:2]), calibration.PLAN) is None


def test_persons_needed_have_the_power_that_the_plan_asks_for():
    """By simulation: with so many persons the difference is found in the asked share, with two fewer in less."""
    rng, the_plan = np.random.default_rng(0), replace(calibration.PLAN, power=0.9)
    for spread in (0.005, 0.01, 0.02):
        count = report.needed(spread, the_plan)
        drawn = rng.normal(the_plan.smallest, spread, (20_000, count))
        power = np.mean(stats.ttest_1samp(drawn, 0.0, axis=1).pvalue < the_plan.alpha)
        assert power > 0.9 - 0.007
        fewer = stats.ttest_1samp(drawn[:, : count - 2], 0.0, axis=1).pvalue
        assert np.mean(fewer < the_plan.alpha) < 0.9 + 0.007
    assert report.needed(1e3, the_plan) is None


def test_half_of_all_p_values_are_below_a_half_where_nothing_differs():
    """A small one of `calibration`: 60 studies of scripted persons, of which 50 % +- 3 standard errors."""
    share = calibration.share_found(replace(calibration.PLAN, alpha=0.5, tries=4), 60, 5, 0.0)
    assert abs(share - 0.5) < 3.0 * np.sqrt(0.25 / 60)
    assert calibration.share_found(replace(calibration.PLAN, tries=4), 20, 8, 0.6) > 0.8
