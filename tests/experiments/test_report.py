"""The report says what the episodes say, serves a user's own, and its page stands on its own."""

import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import polars as pl
import pytest
from pages import opened

from agents import load_policy
from agents.baselines.tuned import load_baseline
from agents.evaluate import RESULTS
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.setups import TUNED, load_setup
from experiments.report import matchups
from experiments.report.__main__ import ReportOptions, publish
from experiments.report.matchups import PAPER
from impact_gym.task import evaluation_sets

LINEAR = matchups.of_setup(load_setup("linear-blind"), {"set": "test", "count": 30})
FEW = [LINEAR.policy, next(seed for seed in LINEAR.seeds if seed.name != LINEAR.chosen)]
MATCHUP = replace(LINEAR, seeds=tuple(replace(seed, weights=(0.7, 1.0, 2.0, 4.0)) for seed in FEW))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("report") / "latest"
    assert publish([MATCHUP], ReportOptions(out=out, processes=0)) == out / "index.html"
    return out


@pytest.fixture(scope="module")
def episodes(folder):
    return pl.read_parquet(folder / "episodes.parquet")


@pytest.fixture(scope="module")
def results(folder):
    return json.loads((folder / "results.json").read_text())


def of(episodes, contestant, **columns):
    return episodes.filter(pl.col("contestant") == contestant, **columns)


def front_of(episodes, contestant):
    """Return mean approach time and V_p at each weight, the soonest first."""
    means = of(episodes, contestant).group_by("time_weight").agg(pl.mean("approach_time", "object_velocity"))
    return means.sort("approach_time").select("approach_time", "object_velocity").to_numpy().T


def test_answer_follows_from_the_episodes_on_disk(folder, results, episodes):
    answer = results["answers"]["linear-blind"]
    seeds = [name for name in results["contestants"]["linear-blind"] if name.startswith("seed-")]
    assert len(seeds) == 2
    paper, curve = of(episodes, PAPER), np.mean([front_of(episodes, seed) for seed in seeds], axis=0)
    velocity = np.interp(paper["approach_time"].mean(), *curve)
    assert answer["reduction"]["value"] == pytest.approx(1 - velocity / paper["object_velocity"].mean())
    time = np.interp(paper["object_velocity"].mean(), curve[1][::-1], curve[0][::-1])
    assert answer["sooner"]["value"] == pytest.approx(1 - time / paper["approach_time"].mean())
    for name in ("reduction", "sooner", "velocity", "improvement"):
        assert answer[name]["low"] <= answer[name]["value"] <= answer[name]["high"]
    assert f"{100 * answer['reduction']['value']:.1f} %" in (folder / "index.html").read_text()


def test_chain_follows_from_the_episodes_on_disk_and_is_the_first_table(folder, results, episodes):
    paper, *steps = results["chains"]["linear-blind"]
    assert [step["contestant"] for step in steps[:3]] == ["constant-speed", "constant-deceleration", "blind-profile"]
    time, before = (of(episodes, PAPER)[field].mean() for field in ("approach_time", "object_velocity"))
    for step in steps[:3]:
        after = np.interp(time, *front_of(episodes, step["contestant"]))
        assert step["velocity"]["less"]["value"] == pytest.approx(before - after)
        before = after
    reduction = results["answers"]["linear-blind"]["reduction"]["value"]
    gained = sum(step["velocity"]["less"]["value"] for step in steps[:4])
    assert gained == pytest.approx(reduction * paper["velocity"]["value"]["value"])
    assert sum(step["velocity"]["share"]["value"] for step in steps[:4]) == pytest.approx(1.0)
    page = (folder / "index.html").read_text()
    assert "+ the arm&#39;s limits" in page[page.index("<table>") : page.index("</table>")]
    assert f"{100 * steps[0]['velocity']['share']['value']:.1f} %" in results["sentences"][0]


def test_tolerance_bound_follows_from_the_seeds(folder, results, episodes):
    by_seed = results["answers"]["linear-blind"]["each"]
    paper = of(episodes, PAPER)
    seeds = sorted(name for name in episodes["contestant"].unique() if re.fullmatch(r"seed-\d+", name))
    assert len(by_seed) == len(seeds) == 2
    velocities = [np.interp(paper["approach_time"].mean(), *front_of(episodes, seed)) for seed in seeds]
    reductions = [1 - velocity / paper["object_velocity"].mean() for velocity in velocities]
    assert sorted(by_seed) == pytest.approx(sorted(reductions))
    k = 26.26  # one-sided 95/95 tolerance factor of two (M. G. Natrella, NBS Handbook 91, table A-7)
    bound = 100 * (np.mean(reductions) - k * np.std(reductions, ddof=1))
    page = (folder / "index.html").read_text()
    (printed,) = re.findall(r"\(95 % of trainings: at least (\S+) %\)", page)
    assert float(printed) == pytest.approx(bound, abs=0.06)


def test_episodes_match_a_batch_on_the_same_scenarios(episodes):
    frozen = evaluation_sets.load("test")
    for name, weight in ((PAPER, 2.0), ("blind-profile", 4.0)):
        rows = of(episodes, name, time_weight=weight).sort("scenario")
        batch = ScenarioBatch.of("test", 30, time_weight=[weight])
        judged = batch.play(load_baseline("paper-trapezoid" if name == PAPER else name, weight))
        for field in RESULTS:
            assert (rows[field].to_numpy() == getattr(judged, field)).all()
    for (name, _), rows in episodes.group_by("contestant", "time_weight"):
        for field, values in frozen.scenario.items():
            assert (rows.sort("scenario")[field].to_numpy() == values[: len(rows)]).all(), name


def test_checksums_match_policies_and_files(results):
    checksums = results["contestants"]["linear-blind"]
    for seed in (name for name in checksums if name.startswith("seed-")):
        policy = load_policy("linear-blind", int(seed.removeprefix("seed-")))
        assert checksums[seed] == hashlib.sha256(policy.to_bytes()).hexdigest()
    assert checksums["blind-profile"] == json.loads((TUNED / "blind-profile.json").read_text())["sha256"]


def test_figures_lie_beside_the_page_as_picture_and_data(folder):
    class Page(HTMLParser):
        def handle_starttag(self, tag, attributes):
            values = dict(attributes)
            if "chart" in (values.get("class") or "").split():
                charts.append(values)
            links.extend(values[name] for name in ("href", "src") if name in values)

    charts, links = [], []
    text = (folder / "index.html").read_text()
    Page().feed(text)
    assert len(charts) + 1 == len(list((folder / "figures").glob("*.svg")))  # one stands still
    for chart in charts:
        assert len(chart["aria-label"]) > 20
        name = chart["data-spec"].removeprefix("spec-")
        assert ElementTree.parse(folder / "figures" / f"{name}.svg").getroot().tag.endswith("svg")
        assert len(pl.read_csv(folder / "figures" / f"{name}.csv", infer_schema_length=None)) > 1
    assert ElementTree.parse(folder / "figures" / "linear-blind_answer.svg").getroot().tag.endswith("svg")
    for link in links:
        assert link.startswith(("#", "data:")) or (folder / link).is_file(), link
    assert len(text) < 12e6


def unfold(page):
    page.evaluate("document.querySelectorAll('details').forEach(fold => { fold.open = true; })")
    page.evaluate("drawAll()")


@pytest.mark.parametrize("width", [390, 1280])
def test_page_fits_the_window_and_draws_every_chart(browser, folder, width):
    page, problems = opened(browser, folder / "index.html", width)
    unfold(page)
    charts = page.locator(".chart")
    page.wait_for_function("[...document.querySelectorAll('.chart')].every(chart => chart.querySelector('svg'))")
    for k in range(charts.count()):
        box = charts.nth(k).locator("svg").first.bounding_box()
        assert box["height"] > 150
        assert 0.6 * min(width, 420) < box["width"] <= width
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    pictures = []
    for share in (0.1, 0.6):
        page.evaluate("""share => { const slider = document.querySelector('.igw-slider');
            slider.value = share * slider.max; slider.dispatchEvent(new Event('input')); }""", share)  # fmt: skip
        pictures.append(page.locator(".igw-panel svg").first.evaluate("panel => panel.outerHTML"))
    assert pictures[0] != pictures[1]
    assert problems == []


def test_page_answers_the_pointer_and_changes_its_theme(browser, folder):
    page, problems = opened(browser, folder / "index.html")
    unfold(page)
    marks = page.locator("#linear-blind_trade_off .mark-symbol path")
    marks.first.wait_for()
    marks.nth(2).scroll_into_view_if_needed()
    marks.nth(2).hover(force=True)
    page.wait_for_selector("#vg-tooltip-element.visible")
    assert re.search("Vₚ", page.inner_text("#vg-tooltip-element"))
    colours = set()
    for _ in range(3):
        page.click("#theme")
        colours.add(page.evaluate("getComputedStyle(document.body).backgroundColor"))
    assert len(colours) == 2
    assert problems == []


def test_page_answers_on_one_screen_and_plays_its_film(browser, folder):
    page, problems = opened(browser, folder / "index.html", 1280, 800, reduced_motion="no-preference")
    for name in (".finding", ".still svg", ".fails", ".igw-panels", ".igw-controls"):
        box = page.locator(name).first.bounding_box()
        assert box["height"] > 15, name
        assert box["y"] + box["height"] <= 800, name
        assert name != ".fails" or box["height"] < 25  # one line
    page.wait_for_function("document.querySelector('.igw-play').textContent === 'Pause'")
    assert page.locator(".igw-select").first.input_value() == "0"
    assert "median" in page.locator(".igw-select option").first.inner_text()
    for name in ("learned policy", "paper's rule", "tuned profile"):
        assert name in page.locator(".still svg").first.text_content()
    assert page.evaluate("document.documentElement.scrollHeight") <= 6 * 800
    assert problems == []


def test_page_prints_a_set_up_unfolded_on_twelve_sheets(browser, folder):
    page, problems = opened(browser, folder / "index.html")
    page.wait_for_function("document.querySelectorAll('.chart svg').length > 0")
    closed = page.locator("details:not([open])").count()
    page.evaluate("""addEventListener("beforeprint", () => setTimeout(() => {
        window.undrawn = document.querySelectorAll(".setup:not([hidden]) .chart:not(:has(svg))").length; }))""")
    printed = page.pdf(format="A4")
    assert 6 <= len(re.findall(rb"/Type\s*/Page[^s]", printed)) <= 12
    assert page.evaluate("window.undrawn") == 0
    assert page.locator("details:not([open])").count() == closed
    assert problems == [], problems


def test_page_names_every_control_and_link(browser, folder):
    page, _ = opened(browser, folder / "index.html")
    page.wait_for_selector(".igw-panel")
    controls = page.evaluate("""() => [...document.querySelectorAll(
        "a[href], button, select, input, summary, slow-motion, [role=img]:not(svg *), [role=region]")].map(control => {
        const name = control.getAttribute("aria-label") || control.labels?.[0]?.textContent || control.textContent;
        return [control.localName, name.trim()]; })""")
    assert {tag for tag, _ in controls} >= {"a", "button", "select", "input", "summary", "slow-motion", "div"}
    assert [tag for tag, name in controls if not name] == []
    links = [name for tag, name in controls if tag == "a"]
    assert len(set(links)) == len(links)


def test_page_controls_are_reached_by_keyboard(browser, folder):
    page, _ = opened(browser, folder / "index.html")
    page.evaluate("""() => {
        const folded = control => control.parentElement.closest("details:not([open])");
        const holder = control => control.matches("summary") ? control.parentElement : control;
        const hidden = control => folded(holder(control)) || control.closest("[hidden]");
        const controls = [...document.querySelectorAll("a[href], button, select, input, summary, [tabindex='0']")];
        window.wanted = new Set(controls.filter(control => control.tabIndex >= 0 && !hidden(control)));
        addEventListener("focusin", event => window.wanted.delete(event.target)); }""")
    count = page.evaluate("window.wanted.size")
    assert count > 25
    for _ in range(2 * count):
        page.keyboard.press("Tab")
    unreached = page.evaluate("[...window.wanted].map(control => control.outerHTML.slice(0, 80))")
    assert unreached == [], unreached


def test_page_chooses_a_set_up_by_keyboard_or_link(browser, folder, tmp_path):
    twin = replace(MATCHUP, name="twin", title="A twin, in plain words")
    (jobs_folder,) = folder.with_name(f".{folder.name}.episodes").iterdir()
    file = publish([MATCHUP, twin], ReportOptions(out=tmp_path / "out", episodes=jobs_folder, processes=0))
    page, problems = opened(browser, file)
    chosen = "document.querySelector('[aria-selected=true]').id"
    panels = "[...document.querySelectorAll('[role=tabpanel]')]"
    visible = f"{panels}.filter(panel => panel.checkVisibility()).map(panel => panel.id)"
    assert page.evaluate(chosen) == "tab-linear-blind"
    assert page.evaluate(visible) == ["linear-blind"]
    assert page.inner_text("#tab-twin").split("\n") == ["A twin, in plain words", "twin"]
    page.focus("#tab-linear-blind")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("document.activeElement.id") == page.evaluate(chosen) == "tab-twin"
    assert page.evaluate(visible) == ["twin"]
    page.click("nav [data-part=engineer-]")
    assert page.evaluate("location.hash") == "#engineer-twin"
    page.evaluate("location.hash = '#trade-off-linear-blind'")
    page.wait_for_function(f"{chosen} === 'tab-linear-blind'")
    assert page.evaluate("document.getElementById('trade-off-linear-blind').open")
    page.wait_for_selector("#linear-blind_trade_off svg")
    assert problems == []
