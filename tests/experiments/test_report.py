"""A small report of real episodes: its numbers follow from the episodes on disk, and its page works offline."""

import html
import json
import os
import re
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from browser_pages import stands_on_its_own
from printed_commands import read_printed

from agents import load_policy
from agents.baselines import PaperTrapezoid
from agents.evaluate.scenario_batch import RESULTS, ScenarioBatch
from agents.setups import load_baseline
from experiments.lab.study import LOCK_FILE, StudyOptions, last_run, run
from experiments.report.__main__ import ReportOptions, comparisons_of, study_of
from experiments.report.comparisons import BOUND, PAPER
from impact_gym.support.files import UNFINISHED
from impact_gym.task import Task, evaluation_sets
from impact_gym.task.scenario import FIELDS

COUNT, SEARCHED, OWN = 80, 64, "agents.baselines:PaperTrapezoid"
COMMAND = "impact-gym report linear-blind"
CHAIN = [PAPER, "constant-speed", "constant-deceleration", "blind-profile"]  # from simple to complex
MEDIAN = f"seed-{load_policy('linear-blind').seed}"
SEEDS = sorted({"seed-0", "seed-1", "seed-2", MEDIAN})[-3:]
RANGES, TOOL = {"object_mass": 0.4, "distance": [0.2, 0.3]}, {"tool_mass": 0.2}
TOLERANCE_OF_THREE = 7.656  # one-sided 95/95 factor (M. G. Natrella, NBS Handbook 91, table A-7)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A report of a shipped set-up and of a user's policy with a baseline, scenarios and a tool of their own."""
    base = tmp_path_factory.mktemp("report")
    (linear,) = comparisons_of(ReportOptions(setups=("linear-blind",), count=COUNT))
    seeds = tuple(replace(seed, weights=(0.7, 1.0, 2.0, 4.0)) for seed in linear.seeds if seed.name in SEEDS)
    evaluation = replace(linear.evaluation, varied={"tool_mass": {"times": [0.7, 1.0]}, "scenario": ["hard"]})
    load_policy("linear-blind").save(base / "mine.npz")
    (base / "mine.json").write_text(json.dumps({"ranges": RANGES, "seed": 5, "count": 6, "environment": TOOL}))
    files = {"policy": (str(base / "mine.npz"),), "scenarios": str(base / "mine.json")}
    (own,) = comparisons_of(ReportOptions(**files, baseline=(OWN,)))
    own = replace(own, evaluation=replace(own.evaluation, varied={}))
    out = base / "latest"
    (out / "figures").mkdir(parents=True)
    for name in (LOCK_FILE, "letter", "figures/old.svg", f"figures/.x.1{UNFINISHED}", "index.html", "episodes.csv"):
        (out / name).write_text("earlier")
    for name in ("index.html", "episodes.csv"):
        os.link(out / name, base / name)
    linear, options = replace(linear, seeds=seeds, evaluation=evaluation), StudyOptions(out, processes=0)
    run(study_of([linear, own], True), options, COMMAND)
    return out


@pytest.fixture(scope="module")
def results(folder):
    return last_run(folder)["numbers"]


def rows_of(folder, comparison):
    return pl.read_csv(folder / "episodes.csv", infer_schema_length=None).filter(comparison=comparison)


@pytest.fixture(scope="module")
def episodes(folder):
    """Results and objects of the set-up's contestants by part of the report, arrays (weights, scenarios)."""
    shaped = {}
    for (part, name), rows in rows_of(folder, "linear-blind").sort("weight", "episode").group_by("part", "contestant"):
        if part != "varied":
            shape = (rows["weight"].n_unique(), -1)
            key = (part, name) if part in ("at_rule_time", "selection") else name
            shaped[key] = {each: rows[each].to_numpy().reshape(shape) for each in ("weight", *FIELDS, *RESULTS)}
    return shaped


def read_at(x, xs, ys):
    return np.interp(x, *np.array(sorted(zip(xs, ys, strict=True))).T)


def at_two(rows):
    """Return the costs (scenarios,) at a time weight of 2 m/s per s."""
    costs = rows["object_velocity"] + rows["weight"] * rows["approach_time"] + 2.0 * rows["missed"]
    return costs[rows["weight"] == 2.0]


def numbers(episodes, chosen, scenarios=slice(None), seeds=SEEDS):
    """Return lists of the report's numbers for some scenarios and seeds."""

    def front(*names):
        runs = [[episodes[name][field] for field in ("approach_time", "object_velocity")] for name in names]
        return np.mean([[field[:, scenarios].mean(axis=1) for field in run] for run in runs], axis=0)

    (time,), (velocity,) = front(PAPER)
    policy = front(*seeds)
    read = np.array([read_at(time, *front(name)) for name in CHAIN] + [read_at(time, *policy)])
    costs = [np.mean([at_two(episodes[name])[scenarios] for name in names]) for names in (*zip(CHAIN), seeds)]
    taken, steps = at_two(episodes[chosen])[scenarios].mean(), -np.diff(read)
    return {
        "reduction": [1.0 - read[-1] / velocity], "velocity": [read[-1]], "rival_reduction": [1.0 - read[3] / velocity],
        "cost": [taken], "above": [costs[0] / taken - 1.0],
        "less": steps, "share": steps / steps.sum(), "cheaper": -np.diff(costs),
    }  # fmt: skip


def test_numbers_and_intervals_follow_from_the_episodes(folder, results, episodes):
    answer, choice = (results[kind]["linear-blind"] for kind in ("answers", "choices"))
    first, *steps, last = results["ablations"]["linear-blind"]
    assert [first["contestant"], *(step["contestant"] for step in steps)] == [*CHAIN, "learned policy"]
    said = {name: [value] for name, value in {**answer, **choice, "above": choice["above"][PAPER]}.items()}
    said |= {name: [step["velocity"][name] for step in steps] for name in ("less", "share")}
    said["cheaper"] = [step["loss"]["less"] for step in steps]
    rng, of = np.random.default_rng(1), (episodes, choice["controller"])
    resampled = [numbers(*of, rng.choice(COUNT, COUNT - 1), rng.choice(SEEDS, 2)) for _ in range(1000)]
    for name, values in numbers(*of).items():
        lows, highs = np.percentile([each[name] for each in resampled], [2.5, 97.5], axis=0)
        for estimate, value, low, high in zip(said[name], values, lows, highs, strict=True):
            near = 0.1 * (high - low) + 1e-9
            assert estimate["value"] == pytest.approx(value), name
            assert (estimate["low"], estimate["high"]) == pytest.approx((low, high), abs=near), name
    each = [numbers(*of, seeds=[seed])["reduction"][0] for seed in SEEDS]
    assert answer["each"] == pytest.approx(each)
    assert (answer["missed"], answer["episodes"], answer["reached"]) == (0, 3 * 4 * COUNT, True)
    policy, knows = (np.mean([at_two(episodes[name])[:SEARCHED] for name in names]) for names in (SEEDS, [BOUND]))
    assert (last["contestant"], last["scenarios"]) == (BOUND, SEARCHED)
    assert (last["loss"]["value"]["value"], last["loss"]["less"]["value"]) == pytest.approx((knows, policy - knows))
    of_search = [episodes[BOUND][name].mean(axis=1) for name in ("approach_time", "object_velocity")]
    time = episodes[PAPER]["approach_time"][0, :SEARCHED].mean()
    assert last["velocity"]["value"]["value"] == pytest.approx(read_at(time, *of_search))
    bound = 100.0 * (np.mean(each) - TOLERANCE_OF_THREE * np.std(each, ddof=1))
    assert f"at least {bound:.1f} %)" in last_run(folder)["answer"].splitlines()[0]


def in_scenarios(task, scenarios, *names):
    """Return the episodes of contestants at a time weight of 2 m/s per s, and their costs, by name."""
    found = {}
    for name in names:
        tuned = "paper-trapezoid" if name == PAPER else name
        controller = load_policy("linear-blind") if name == MEDIAN else load_baseline(tuned, 2.0)
        rows = ScenarioBatch(*scenarios, task, time_weight=[2.0], quiet=True).play(controller)
        found[name] = rows, rows.object_velocity + 2.0 * rows.approach_time + 2.0 * rows.missed
    return found


def test_simplest_of_the_cheapest_in_other_scenarios_is_taken(results):
    choice, names = results["choices"]["linear-blind"], [*CHAIN, MEDIAN]
    costs = {name: cost for name, (_, cost) in in_scenarios(Task(), (60_000_000, 2000), *names).items()}
    least = min(costs.values(), key=np.mean)
    more = {name: cost - least for name, cost in costs.items()}
    fits = [name for name in names if more[name].mean() <= 1.96 * more[name].std(ddof=1) / 2000**0.5]
    assert (choice["controller"], choice["time_weight"]) == (fits[0], 2.0)
    assert results["choices"]["mine"]["controller"] == "mine"
    assert results["ablations"]["mine"][-1]["contestant"] != BOUND  # which was not searched in these scenarios


def tables_of(folder, tab):
    """Return the tables of a tab, each a list of rows by heading."""
    text, found = html.unescape((folder / "index.html").read_text()).replace("\N{NO-BREAK SPACE}", " "), []
    text = text.partition(f'<div class="setup" id="{tab}"')[2].partition('<div class="setup"')[0]
    for table in re.findall("<table.*?</table>", text, re.DOTALL):
        rows = [re.findall("<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall("<tr>(.*?)</tr>", table, re.DOTALL)]
        head, *rows = [[re.sub("<[^>]+>", "", cell) for cell in row] for row in rows]
        found.append([dict(zip(head, row, strict=True)) for row in rows])
    return found


def test_tables_follow_from_the_episodes(folder, episodes):
    measures, *_ = tables_of(folder, "linear-blind")
    for row, rows in ((measures[0], episodes[PAPER]), (measures[-1], episodes["at_rule_time", MEDIAN])):
        peak, velocity = rows["peak_force"][0], rows["object_velocity"][0]
        assert row["T (s)"] == f"{rows['approach_time'].mean():.4f}"
        assert row["Vp (m/s)"].startswith(f"{velocity.mean():.3f} [")
        assert row["Vp, mean of the worst 5 %"] == f"{np.sort(velocity)[-4:].mean():.3f}"
        assert row["peak force (N): mean, 95 %"] == f"{peak.mean():.1f}, {np.quantile(peak, 0.95):.0f}"
        assert row["impulse (N s)"] == f"{(velocity * rows['object_mass'][0]).mean():.4f}"
        assert row["several contacts"] == f"{100 * (rows['contact_count'] > 1).mean():.1f} %"


@pytest.mark.parametrize(("place", "task", "name"), [
    ("objects outside the training ranges", Task(), "hard"), ("tool mass", Task(tool_mass=0.7 * 0.125), "test"),
])  # fmt: skip
def test_robustness_is_of_the_changed_environment(folder, place, task, name):
    *_, changed = tables_of(folder, "linear-blind")
    played = in_scenarios(task, (evaluation_sets.load(name), COUNT), PAPER, CHAIN[3], MEDIAN)
    (row,) = (row for row in changed if f", {place}: " in row["set-up, change"] and "100 %" not in str(row))
    *_, missed = (episodes.missed.sum() for episodes, _ in played.values())
    assert [*row.values()][1:] == [*(f"{cost.mean():.3f}" for _, cost in played.values()), f"{missed} of {COUNT}"]


def test_files_of_earlier_reports_are_replaced(folder):
    of_page = {path.name for path in (folder / "figures").iterdir()}
    assert of_page == {"linear-blind_answer.svg", "mine_answer.svg"}
    assert {path.name for path in folder.iterdir()} >= {"letter", LOCK_FILE}
    for name in ("index.html", "episodes.csv"):  # replaced, not overwritten
        assert (folder.parent / name).read_text() == "earlier"
    others = [path.stat().st_mtime_ns for path in folder.rglob("*") if path.name != "results.json"]
    assert max(others) <= (folder / "results.json").stat().st_mtime_ns  # its key says that the page is complete


def test_episodes_match_a_batch_on_the_same_scenarios(folder, episodes):
    for name, (alone, _) in in_scenarios(Task(), (evaluation_sets.load("test"), COUNT), PAPER, "blind-profile").items():
        for field in RESULTS:
            assert (episodes[name][field][episodes[name]["weight"] == 2.0] == getattr(alone, field)).all()
        for field, values in alone.scenario.items():
            assert (episodes[name][field] == values).all()
    own = rows_of(folder, "mine").filter(part="baselines", contestant=OWN).sort("episode")
    alone = ScenarioBatch(5, 6, Task(scenario=RANGES | {"distance": (0.2, 0.3)}, **TOOL)).play(PaperTrapezoid())
    assert set(own["object_mass"]) == {0.4}
    assert (own["object_velocity"].to_numpy() == alone.object_velocity).all()


def test_page_stands_on_its_own_and_chooses_by_key_and_link(browser, folder, monkeypatch):
    page = stands_on_its_own(browser, folder / "index.html", 390)
    visible = "[...document.querySelectorAll('[role=tabpanel]')].filter(tab => tab.checkVisibility()).map(t => t.id)"
    assert page.evaluate(visible) == ["linear-blind"]
    film, taken = page.locator("#linear-blind .films > div:not([hidden]) h3"), page.locator("#linear-blind .finding")
    page.locator("#linear-blind .beside").scroll_into_view_if_needed()
    film.first.wait_for()
    assert taken.inner_text().startswith(f"Take the {film.all_inner_texts()[1]}. ")
    page.locator("#linear-blind .beside").select_option("tuned constant speed")
    film.first.wait_for()
    assert film.all_inner_texts() == [PAPER, "tuned constant speed"]
    page.focus("#tab-linear-blind")
    page.keyboard.press("ArrowRight")
    assert page.evaluate(visible) == ["mine"]
    page.evaluate("location.hash = '#robustness-linear-blind'")
    page.wait_for_function(f"{visible}[0] === 'linear-blind'")
    printed = {*re.findall(r">(impact-gym [^<]*)<", (folder / "index.html").read_text())}
    assert len(printed) > 2
    for command in printed:
        read_printed(command, monkeypatch)
