"""The report says what the episodes say, and its page stands on its own."""

import csv
import json
import os
import re
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.stats import norm

from agents.baselines import PaperTrapezoid
from agents.evaluation import TEST_SEED, evaluate
from experiments import report
from experiments.replay import replay
from experiments.results import whole_folder
from experiments.statistics import mean, mean_reduction, relative_reduction


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("report") / "latest"
    page = report.write(report.Settings(out=out, scenarios=60))
    assert page == out / "index.html"
    return out


@pytest.fixture(scope="module")
def results(folder):
    return json.loads((folder / "results.json").read_text())


def columns(folder: Path, controller: str) -> dict[str, np.ndarray]:
    with (folder / "episodes.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["controller"] == controller]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_the_answer_follows_from_the_episodes_on_disk(folder, results):
    policy, paper = columns(folder, report.LEARNED), columns(folder, report.PAPER)
    velocity = [rows["object_velocity"].astype(float) for rows in (policy, paper)]
    times = [rows["approach_time"].astype(float) for rows in (policy, paper)]
    answer = results["answer"]
    assert answer["object_velocity_reduction"]["value"] == pytest.approx(1 - velocity[0].mean() / velocity[1].mean())
    assert answer["approach_time_saved"]["value"] == pytest.approx(times[1].mean() - times[0].mean())
    for estimate in (answer["object_velocity_reduction"], answer["approach_time_saved"]):
        assert estimate["low"] < estimate["value"] < estimate["high"]


def test_every_controller_meets_the_same_scenarios(folder):
    one, *others = (columns(folder, name) for name in report.controllers())
    for other in others:
        for field in ("seed", "object_mass", "contact_stiffness", "restitution", "distance"):
            assert (one[field] == other[field]).all()


def test_the_page_states_the_answer_and_leads_to_files_that_are_there(folder, results):
    page = (folder / "index.html").read_text()
    value = 100 * results["answer"]["object_velocity_reduction"]["value"]
    assert f"{value:.1f} %" in page
    for name in report.controllers():
        assert name.replace("'", "&#39;") in page
    links = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert links
    for link in links:
        assert (folder / link).is_file(), link
    assert "http" not in page


def test_every_picture_has_a_text_and_is_well_formed(folder):
    class Pictures(HTMLParser):
        def handle_starttag(self, tag, attributes):
            if tag == "img":
                found.append(dict(attributes))

    found: list[dict[str, str]] = []
    Pictures().feed((folder / "index.html").read_text())
    assert len(found) == 2
    for picture in found:
        assert len(picture["alt"]) > 40
        assert ElementTree.parse(folder / picture["src"]).getroot().tag.endswith("svg")


def test_a_replay_is_the_episode_that_was_judged():
    judged = evaluate(PaperTrapezoid(), TEST_SEED, 5)
    for k in range(5):
        trace, info = replay(PaperTrapezoid(), TEST_SEED + k)
        assert info["object_velocity"] == judged.object_velocity[k]
        assert trace.object_velocity[-1] == judged.object_velocity[k]
        touched = trace.time[trace.contact_force > 0]
        assert judged.approach_time[k] < touched[0] < judged.approach_time[k] + 2e-3


def test_a_report_of_one_scenario_is_refused(tmp_path):
    with pytest.raises(ValueError, match="scenarios must be at least 2"):
        report.write(report.Settings(out=tmp_path / "latest", scenarios=1))
    assert not (tmp_path / "latest").exists()


def test_a_folder_is_replaced_whole_or_not_at_all(tmp_path):
    target = tmp_path / "latest"
    with whole_folder(target) as unfinished:
        (unfinished / "page").write_text("first")

    def break_off():
        with whole_folder(target) as unfinished:
            (unfinished / "page").write_text("half")
            raise OSError("no room")

    with pytest.raises(OSError, match="no room"):
        break_off()
    assert (target / "page").read_text() == "first"
    with whole_folder(target) as unfinished:
        (unfinished / "page").write_text("second")
    assert (target / "page").read_text() == "second"
    assert [path.name for path in tmp_path.iterdir()] == ["latest"]


def test_the_interval_of_a_mean_is_that_of_normal_theory():
    sample = np.random.default_rng(0).standard_normal(2000)
    estimate = mean(sample)
    half = norm.ppf(0.975) * sample.std(ddof=1) / np.sqrt(2000)
    assert estimate.value == pytest.approx(sample.mean())
    assert estimate.low == pytest.approx(sample.mean() - half, abs=0.1 * half)
    assert estimate.high == pytest.approx(sample.mean() + half, abs=0.1 * half)


def test_pairing_takes_out_what_the_scenarios_share():
    rng = np.random.default_rng(1)
    hard = rng.uniform(1.0, 10.0, 500)
    ratio = relative_reduction(0.4 * hard, hard)
    assert (ratio.value, ratio.low, ratio.high) == pytest.approx((0.6, 0.6, 0.6))
    shift = mean_reduction(hard - 0.25, hard)
    assert (shift.value, shift.low, shift.high) == pytest.approx((0.25, 0.25, 0.25))


def test_a_folder_that_no_run_wrote_is_left_alone(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter").write_text("dear")
    with pytest.raises(ValueError, match="mine is not replaced"):
        report.write(report.Settings(out=tmp_path / "mine", scenarios=5))
    assert (tmp_path / "mine" / "letter").read_text() == "dear"


def test_an_interrupted_swap_brings_the_old_folder_back(tmp_path, monkeypatch):
    target = tmp_path / "latest"
    with whole_folder(target) as unfinished:
        (unfinished / "page").write_text("first")
    move = os.replace

    def replace(source, destination):
        if Path(destination) == target and Path(source).name != target.name:
            raise KeyboardInterrupt
        move(source, destination)

    def swap():
        monkeypatch.setattr(os, "replace", replace)
        with whole_folder(target) as unfinished:
            (unfinished / "page").write_text("second")

    with pytest.raises(KeyboardInterrupt):
        swap()
    assert (target / "page").read_text() == "first"
    assert [path.name for path in tmp_path.iterdir()] == ["latest"]
