"""The report says what the episodes say, serves a user's own, and its page stands on its own."""

import hashlib
import json
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import polars as pl
import pytest
from browsers import chromium, opened
from episodes import assert_identical

from agents.baselines.tuned import load_baseline
from agents.evaluate import RESULTS
from agents.evaluate import play as evaluations
from agents.evaluate.stage import Stage
from agents.jobs import job
from agents.setups import load_setup
from experiments.lab.statistics import Estimate
from experiments.report import answer, matchups, measures, results
from experiments.report.__main__ import ReportOptions, publish
from experiments.report.matchups import PAPER
from impact_gym.envs import evaluation_sets

AGENTS = Path(matchups.__file__).parents[2] / "agents"
SCENARIOS = {"set": "test", "count": 30}
LINEAR = matchups.of_setup(load_setup("linear-blind"), SCENARIOS)
PAPERS_RULE = {"baseline": "paper-trapezoid"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("report") / "latest"
    few = [LINEAR.policy, next(seed for seed in LINEAR.seeds if seed.name != LINEAR.chosen)]
    matchup = replace(LINEAR, seeds=tuple(replace(seed, weights=(0.7, 1.0, 2.0, 4.0)) for seed in few))
    assert publish([matchup], ReportOptions(out=out, processes=0)) == out / "index.html"
    return out


@pytest.fixture(scope="module")
def episodes(folder):
    return pl.read_parquet(folder / "episodes.parquet")


def of(episodes, contestant, **columns):
    return episodes.filter(pl.col("contestant") == contestant, **columns)


def front_of(episodes, contestant):
    """Return mean approach time and V_p at each weight, the soonest first."""
    means = of(episodes, contestant).group_by("time_weight").agg(pl.mean("approach_time", "object_velocity"))
    return means.sort("approach_time").select("approach_time", "object_velocity").to_numpy().T


def test_the_answer_follows_from_the_episodes_on_disk(folder, episodes):
    found = json.loads((folder / "results.json").read_text())
    told = found["answers"]["linear-blind"]
    seeds = [name for name in found["contestants"]["linear-blind"] if name.startswith("seed-")]
    assert len(seeds) == 2
    paper = of(episodes, PAPER)
    curve = [
        [np.mean([of(episodes, seed, time_weight=w)[field].mean() for seed in seeds]) for w in (4.0, 2.0, 1.0, 0.7)]
        for field in ("approach_time", "object_velocity")
    ]
    there = np.interp(paper["approach_time"].mean(), *curve)
    assert told["reduction"]["value"] == pytest.approx(1 - there / paper["object_velocity"].mean())
    then = np.interp(paper["object_velocity"].mean(), curve[1][::-1], curve[0][::-1])
    assert told["sooner"]["value"] == pytest.approx(1 - then / paper["approach_time"].mean())
    for name in ("reduction", "sooner", "velocity", "improvement"):
        assert told[name]["low"] <= told[name]["value"] <= told[name]["high"]
    assert f"{100 * told['reduction']['value']:.1f} %" in (folder / "index.html").read_text()


def test_the_chain_follows_from_the_episodes_on_disk_and_is_the_first_table(folder, episodes):
    found = json.loads((folder / "results.json").read_text())
    paper, *steps = found["chains"]["linear-blind"]
    assert [step["contestant"] for step in steps[:2]] == ["constant-speed", "blind-profile"]
    time, before = (of(episodes, PAPER)[field].mean() for field in ("approach_time", "object_velocity"))
    for step in steps[:2]:
        means = (
            of(episodes, step["contestant"]).group_by("time_weight").agg(pl.mean("approach_time", "object_velocity"))
        )
        there = np.interp(time, *(means.sort("approach_time")[field] for field in ("approach_time", "object_velocity")))
        assert step["velocity"]["less"]["value"] == pytest.approx(before - there)
        before = there
    reduction = found["answers"]["linear-blind"]["reduction"]["value"]
    less = sum(step["velocity"]["less"]["value"] for step in steps[:3])
    assert less == pytest.approx(reduction * paper["velocity"]["value"]["value"])
    assert sum(step["velocity"]["share"]["value"] for step in steps[:3]) == pytest.approx(1.0)
    page = (folder / "index.html").read_text()
    assert "linear-blind: + the arm&#39;s limits" in page[page.index("<table>") : page.index("</table>")]
    assert f"{100 * steps[0]['velocity']['share']['value']:.1f} %" in found["sentences"][0]


def test_what_the_next_training_brings_follows_from_each_seed_by_itself(folder, episodes):
    told = json.loads((folder / "results.json").read_text())["answers"]["linear-blind"]["each"]
    paper = of(episodes, PAPER)
    seeds = sorted(name for name in episodes["contestant"].unique() if re.fullmatch(r"seed-\d+", name))
    assert len(told) == len(seeds) == 2
    each = []
    for seed in seeds:
        there = np.interp(paper["approach_time"].mean(), *front_of(episodes, seed))
        each.append(1 - there / paper["object_velocity"].mean())
    assert sorted(told) == pytest.approx(sorted(each))
    k = 26.26  # one-sided 95/95 tolerance factor of two (M. G. Natrella, NBS Handbook 91, table A-7)
    bound = 100 * (np.mean(each) - k * np.std(each, ddof=1))
    page = (folder / "index.html").read_text()
    (shown,) = re.findall(r"\(95 % of trainings: at least (\S+) %\)", page)
    assert float(shown) == pytest.approx(bound, abs=0.06)
    assert "at least 22 % are as good as the worst of 2" in page  # 0.05 ** (1 / 2)


def test_episodes_are_those_of_a_stage_and_of_the_same_scenarios(episodes):
    frozen = evaluation_sets.load("test")
    for name, weight in ((PAPER, 2.0), ("blind-profile", 4.0)):
        rows = of(episodes, name, time_weight=weight).sort("scenario")
        stage = Stage.of("test", 30, time_weight=[weight])
        judged = stage.play(load_baseline("paper-trapezoid" if name == PAPER else name, weight))
        for field in RESULTS:
            assert (rows[field].to_numpy() == getattr(judged, field)).all()
    for (name, _), rows in episodes.group_by("contestant", "time_weight"):
        for field, values in frozen.scenario.items():
            assert (rows.sort("scenario")[field].to_numpy() == values[: len(rows)]).all(), name


def test_as_late_is_as_late_on_the_validation_set():
    found = measures.play_as_late(LINEAR.policy.controller, LINEAR.environment, SCENARIOS, LINEAR.policy.weights)
    validation = {"set": "validation", "count": SCENARIOS["count"]}
    weight = float(found["weight"][0])
    ours = evaluations.play(LINEAR.policy.controller, validation, [weight])
    rule = evaluations.play(PAPERS_RULE, validation)
    assert ours["approach_time"].mean() == pytest.approx(rule["approach_time"].mean(), abs=1e-3)
    assert ours["approach_time"].mean() <= rule["approach_time"].mean()


def test_the_papers_rule_does_after_the_alarm_what_it_says():
    seen = measures.reactions(PAPERS_RULE, {}, SCENARIOS, 2.0)
    assert seen["velocity"] == pytest.approx(0.0, abs=1e-6)
    assert seen["acceleration"] == pytest.approx(8.0, abs=1e-5)
    assert set(seen["scenario"]) == set(range(30))
    assert seen["since"].min() == 0.0
    assert seen["since"].max() < 0.15
    assert (seen["sensed"] >= 1.0 - 1e-3).all()  # the alarm comes with the reading that caused it


def test_a_profile_is_the_flanges():
    found = measures.profile(PAPERS_RULE, {}, [2.0], 0.36)
    x = found["position"]
    reached = x < 0.35  # the tool swings ahead of the flange and touches first
    assert found["velocity"][0][reached] == pytest.approx(np.minimum(np.sqrt(16.0 * x), 1.0)[reached], abs=2e-3)


def test_scenarios_come_from_sets_tables_and_ranges_alike():
    frozen = evaluation_sets.load("test")
    table = {name: values[:20].tolist() for name, values in frozen.scenario.items()}
    ranges = {"object_mass": [0.1, 2.5], "contact_stiffness": [1e3, 1e6], "restitution": [0.1, 1.0],
              "distance": [0.15, 0.35]}  # fmt: skip
    same = [{"set": "test"}, {"table": table, "seed": frozen.seed}, {"ranges": ranges, "seed": frozen.seed}]
    first, *others = (
        evaluations.play(PAPERS_RULE, {**one, "count": 20}, environment={"range_noise": 0.01}) for one in same
    )
    for other in others:
        assert_identical(first, other)


def test_what_was_played_is_not_played_again(tmp_path, monkeypatch):
    matchup = replace(LINEAR, seeds=(replace(LINEAR.policy, weights=(2.0,)),), scenarios={"set": "test", "count": 4})
    alone = replace(matchup, baselines=matchup.baselines[:1])
    (first,) = results.gather_matchups([alone], tmp_path, processes=0)
    calls = []
    monkeypatch.setattr(evaluations, "play", lambda *a, _play=evaluations.play, **k: calls.append(k) or _play(*a, **k))
    job.resolve.cache_clear()
    (second,) = results.gather_matchups([alone], tmp_path, processes=0)
    assert calls == []
    (third,) = results.gather_matchups([matchup], tmp_path, processes=0)
    assert calls
    assert all(call["controller"] != PAPERS_RULE for call in calls)
    job.resolve.cache_clear()
    for one in (second, third):
        assert np.array_equal(first.paper["object_velocity"], one.paper["object_velocity"])


def test_a_curve_that_does_not_come_to_the_papers_time_says_so():
    one = replace(LINEAR, seeds=(replace(LINEAR.policy, weights=(8.0,)),), scenarios={"set": "test", "count": 20})
    fast = answer.answer(played_alone(one))
    assert not fast.reached
    assert fast.later < 0.0
    assert "no weight makes its approach as long" in answer.sentence(fast, one)
    assert f"{-100 * fast.later:.1f} % sooner" in answer.sentence(fast, one)
    assert fast.each == ()
    late = replace(fast, later=0.02)
    assert "no weight makes its approach as short" in answer.sentence(late, one)
    assert "2.0 % later" in answer.sentence(late, one)
    slow = replace(fast, reached=True, reduction=Estimate(-0.2, -0.3, -0.1), beyond="faster")
    assert "20.0 % [10.0, 30.0] faster" in answer.sentence(slow, one)
    assert "nowhere leaves the object as slow" in answer.sentence(slow, one)


def played_alone(matchup):
    """Return what `answer` needs of a matchup, nothing else."""
    played = results.Played(matchup)
    for one in (*matchup.seeds, *matchup.baselines):
        arrays = evaluations.play(one.controller, matchup.scenarios, list(one.weights), matchup.environment)
        runs = played.seeds if one in matchup.seeds else played.baselines
        runs[one.name] = results.Run(one.weights, arrays)
    played.as_late = played.seeds
    return played


def test_a_report_needs_no_more_than_its_extra():
    extras = tomllib.loads((AGENTS.parent / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    names = {extra: {re.split("[><=]", one)[0].replace("-", "_") for one in extras[extra]} for extra in extras}
    others = set().union(*names.values()) - names["report"]
    assert {"torch", "cma", "mujoco", "ray"} <= others
    program = (
        f"import sys; sys.modules.update(dict.fromkeys({sorted(others)})); import experiments.report.__main__; "
        "from experiments.report.__main__ import ReportOptions, matchups_of; matchups_of(ReportOptions())"
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=AGENTS.parent)


def test_checksums_are_those_of_the_files(folder):
    found = json.loads((folder / "results.json").read_text())["contestants"]["linear-blind"]
    files = {name: f"policies/linear-blind/{name}.npz" for name in found if name.startswith("seed-")}
    for name, file in files.items():
        assert found[name] == hashlib.sha256((AGENTS / file).read_bytes()).hexdigest()
    tuned = json.loads((AGENTS / "tuned" / "blind-profile.json").read_text())
    assert found["blind-profile"] == tuned["sha256"]


def test_every_figure_is_there_as_picture_and_data(folder):
    class Page(HTMLParser):
        def handle_starttag(self, tag, attributes):
            given = dict(attributes)
            if "chart" in (given.get("class") or "").split():
                charts.append(given)
            links.extend(given[name] for name in ("href", "src") if name in given)

    charts, links = [], []
    text = (folder / "index.html").read_text()
    Page().feed(text)
    assert len(charts) >= 15
    for chart in charts:
        assert len(chart["aria-label"]) > 20
        name = chart["data-spec"].removeprefix("spec-")
        assert ElementTree.parse(folder / "figures" / f"{name}.svg").getroot().tag.endswith("svg")
        assert len(pl.read_csv(folder / "figures" / f"{name}.csv", infer_schema_length=None)) > 1
    for link in links:
        assert link.startswith(("#", "data:")) or (folder / link).is_file(), link
    assert len(text) < 12e6


@pytest.fixture(scope="module")
def browser():
    with chromium() as program:
        yield program


@pytest.mark.parametrize("width", [390, 1280])
def test_the_page_in_a_browser(browser, folder, width):
    page, problems = opened(browser, folder / "index.html", width)
    page.evaluate("drawAll()")
    charts = page.locator(".chart")
    page.wait_for_function("[...document.querySelectorAll('.chart')].every(one => one.querySelector('svg'))")
    for k in range(charts.count()):
        box = charts.nth(k).locator("svg").first.bounding_box()
        assert box["height"] > 150
        assert 0.6 * min(width, 420) < box["width"] <= width
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    pictures = []
    for share in (0.1, 0.6):
        page.evaluate("""share => { const slider = document.querySelector('.igw-slider');
            slider.value = share * slider.max; slider.dispatchEvent(new Event('input')); }""", share)  # fmt: skip
        pictures.append(page.locator(".igw-panel svg").first.evaluate("one => one.outerHTML"))
    assert pictures[0] != pictures[1]
    assert problems == []


def test_a_chart_answers_the_pointer_and_the_theme_changes(browser, folder):
    page, problems = opened(browser, folder / "index.html")
    page.evaluate("drawAll()")
    marks = page.locator("#linear-blind_trade_off .mark-symbol path")
    marks.first.wait_for()
    marks.nth(2).scroll_into_view_if_needed()
    marks.nth(2).hover(force=True)
    page.wait_for_selector("#vg-tooltip-element.visible")
    assert re.search(r"V_p", page.inner_text("#vg-tooltip-element"))
    colours = set()
    for _ in range(3):
        page.click("#theme")
        colours.add(page.evaluate("getComputedStyle(document.body).backgroundColor"))
    assert len(colours) == 2
    assert problems == []
