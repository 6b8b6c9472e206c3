"""The report agrees with its episodes, plays a user's baselines and scenarios, and its page works offline."""

import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from browser_pages import opened, stands_on_its_own
from cluster_work import kept
from printed_commands import read_printed

from agents.baselines import PaperTrapezoid
from agents.baselines.tuned import load_baseline
from agents.evaluate.play import pairs, play
from agents.evaluate.scenario_batch import RESULTS, ScenarioBatch
from agents.setups import TUNED, load_setup
from experiments.report import choice, jobs, matchups
from experiments.report.__main__ import ReportOptions, publish, write
from experiments.report.matchups import PAPER
from impact_gym.files import UNFINISHED
from impact_gym.task import Task, evaluation_sets

COUNT, OWN = 30, "agents.baselines:PaperTrapezoid"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A report of two matchups with the same episodes."""
    out = tmp_path_factory.mktemp("report") / "latest"
    linear = matchups.of_setup(load_setup("linear-blind"), {"set": "test", "count": COUNT})
    few = [linear.policy, next(seed for seed in linear.seeds if seed.name != linear.chosen)]
    seeds = tuple(replace(seed, weights=(0.7, 1.0, 2.0, 4.0)) for seed in few)
    evaluation = replace(linear.evaluation, varied={"tool_mass": {"times": [0.7, 1.0]}, "scenario": ["hard"]})
    linear = replace(linear, seeds=seeds, evaluation=evaluation)
    publish([linear, replace(linear, name="twin", title="A twin", bound=None)], ReportOptions(out=out, processes=0))
    return out


@pytest.fixture(scope="module")
def episodes(folder):
    return pl.read_parquet(folder / "episodes.parquet").filter(matchup="linear-blind")


@pytest.fixture(scope="module")
def results(folder):
    return json.loads((folder / "results.json").read_text())


def test_commands_on_the_page_are_read_by_their_own_parsers(folder, monkeypatch):
    printed = {*re.findall(r">(impact-gym [^<]*)<", (folder / "index.html").read_text())}
    assert len(printed) > 2
    for command in printed:
        read_printed(command, monkeypatch)


def of(episodes, contestant, **columns):
    return episodes.filter(pl.col("contestant") == contestant, **columns)


def front_of(episodes, contestant):
    """Return mean approach time and V_p at each weight, the soonest first."""
    means = of(episodes, contestant).group_by("time_weight").agg(pl.mean("approach_time", "object_velocity"))
    return means.sort("approach_time").select("approach_time", "object_velocity").to_numpy().T


def test_answer_and_ablation_follow_from_the_episodes_on_disk(folder, results, episodes):
    answer, (paper, *steps) = results["answers"]["linear-blind"], results["ablations"]["linear-blind"]
    seeds = [name for name in results["contestants"]["linear-blind"] if name.startswith("seed-")]
    time, velocity = (of(episodes, PAPER)[field].mean() for field in ("approach_time", "object_velocity"))
    curve = np.mean([front_of(episodes, seed) for seed in seeds], axis=0)
    assert len(seeds) == 2
    assert answer["reduction"]["value"] == pytest.approx(1 - np.interp(time, *curve) / velocity)
    sooner = np.interp(velocity, curve[1][::-1], curve[0][::-1])
    assert answer["sooner"]["value"] == pytest.approx(1 - sooner / time)
    by_seed = [1 - np.interp(time, *front_of(episodes, seed)) / velocity for seed in seeds]
    assert sorted(answer["each"]) == pytest.approx(sorted(by_seed))
    before = paper["velocity"]["value"]["value"]
    assert before == pytest.approx(velocity)
    assert [step["contestant"] for step in steps[:3]] == ["constant-speed", "constant-deceleration", "blind-profile"]
    for step in steps[:3]:
        after = np.interp(time, *front_of(episodes, step["contestant"]))
        assert step["velocity"]["less"]["value"] == pytest.approx(before - after)
        before = after
    assert f"{100 * answer['reduction']['value']:.1f} %" in (folder / "index.html").read_text()
    assert f"{100 * steps[0]['velocity']['share']['value']:.1f} %" in results["sentences"][1]


def test_episodes_match_a_batch_on_the_same_scenarios(episodes):
    frozen = evaluation_sets.load("test")
    for name, weight in ((PAPER, 2.0), ("blind-profile", 4.0)):
        rows = of(episodes, name, time_weight=weight).sort("scenario")
        batch = ScenarioBatch.of("test", COUNT, time_weight=[weight])
        judged = batch.play(load_baseline("paper-trapezoid" if name == PAPER else name, weight))
        for field in RESULTS:
            assert (rows[field].to_numpy() == getattr(judged, field)).all()
    for (name, _), rows in episodes.group_by("contestant", "time_weight"):
        for field, values in frozen.scenario.items():
            assert (rows.sort("scenario")[field].to_numpy() == values[: len(rows)]).all(), name


def test_checksums_are_those_of_the_files(folder, results):
    content = (folder / "episodes.parquet").read_bytes()
    assert results["episodes"]["sha256"] == hashlib.sha256(content).hexdigest()
    tuned = json.loads((TUNED / "blind-profile.json").read_text())
    assert results["contestants"]["linear-blind"]["blind-profile"] == tuned["sha256"]


@pytest.mark.parametrize("width", [390, 1280])
def test_page_stands_on_its_own_and_has_every_chart(browser, folder, width):
    page = stands_on_its_own(browser, folder / "index.html", width)
    page.evaluate("document.querySelectorAll('figure img').forEach(image => { image.loading = 'eager'; })")
    shown = "[...document.querySelectorAll('.setup:not([hidden]) figure img')]"
    page.wait_for_function(f"{shown}.filter(image => image.naturalWidth > 200).length === 2")
    assert (folder / "index.html").stat().st_size < 6e6
    pictures = {path.name for path in (folder / "figures").iterdir()}
    assert pictures == {f"{name}_{key}.svg" for name in ("linear-blind", "twin") for key in ("answer", "trade_off")}


def test_page_chooses_a_set_up_by_key_and_by_link(browser, folder):
    page, problems = opened(browser, folder / "index.html")
    page.wait_for_selector(".igw-panel")
    visible = "[...document.querySelectorAll('[role=tabpanel]')].filter(tab => tab.checkVisibility()).map(t => t.id)"
    assert page.evaluate(visible) == ["linear-blind"]
    page.focus("#tab-linear-blind")
    page.keyboard.press("ArrowRight")
    assert page.evaluate(visible) == ["twin"]
    page.evaluate("location.hash = '#trade-off-linear-blind'")
    page.wait_for_function(f"{visible}[0] === 'linear-blind'")
    assert page.evaluate("document.getElementById('trade-off-linear-blind').open")
    assert problems == []


def test_report_takes_a_users_baseline_ranges_and_tool_and_plays_and_writes_only_what_changed(tmp_path, capsys):
    scenarios = tmp_path / "mine.json"
    ranges, tool = {"object_mass": 0.4, "distance": [0.2, 0.3]}, {"tool_mass": 0.2}
    scenarios.write_text(json.dumps({"ranges": ranges, "seed": 5, "count": 6, "environment": tool}))
    options = ReportOptions(policy=("linear-blind",), baseline=(OWN,), scenarios=str(scenarios),
                            out=tmp_path / "out", processes=0)  # fmt: skip
    of_other_sources = tmp_path / ".out.episodes" / "0"
    of_other_sources.mkdir(parents=True)
    page = write(options)
    assert not of_other_sources.exists()
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == [".out.episodes"]
    (stored,) = (tmp_path / ".out.episodes").iterdir()
    answer, before, first = capsys.readouterr().out, page.stat().st_mtime_ns, kept(stored)
    assert f"results are kept in {stored}" in answer
    episodes = pl.read_parquet(page.with_name("episodes.parquet"))
    assert set(episodes["object_mass"]) == {0.4}
    assert episodes["distance"].is_between(0.2, 0.3).all()
    own = of(episodes, OWN).sort("scenario")
    judged = ScenarioBatch(5, 6, Task(scenario=ranges | {"distance": (0.2, 0.3)}, **tool)).play(PaperTrapezoid())
    assert (own["object_velocity"].to_numpy() == judged.object_velocity).all()

    assert write(options).stat().st_mtime_ns == before
    assert capsys.readouterr().out.splitlines()[-1] == answer.splitlines()[-1]
    letter, begun = page.with_name("letter"), page.with_name("figures") / f".old.svg.1{UNFINISHED}"
    for lost in (page, page.with_name("results.json")):  # as where it was killed
        lost.unlink()
        letter.touch()
        begun.touch()
        write(options)
        assert [path.exists() for path in (lost, letter, begun)] == [True, True, False]
    assert kept(stored) == first
    write(replace(options, count=4, force=True))
    assert len(of(pl.read_parquet(page.with_name("episodes.parquet")), OWN)) == 4
    assert kept(stored)
    assert not kept(stored).items() & first.items()  # what does not depend on how many scenarios there are, too
    write(replace(options, policy=("rigid-blind",), count=4))
    assert {path.name.partition("_")[0] for path in page.with_name("figures").iterdir()} == {"rigid-blind"}
    assert letter.is_file()


@pytest.mark.filterwarnings("ignore:the policy was trained for another environment")  # once in a process
@pytest.mark.parametrize("arm", [{}, {"velocity_range": [-0.2, 1.2], "acceleration_range": [1.0, 10.0]}], ids=str)
def test_play_as_late_has_the_rules_mean_time_on_the_validation_set_and_nearly_on_the_test_set(arm):
    scenarios, validation = ({"set": name, "count": 200} for name in ("test", "validation"))
    policy, rule = matchups.of_setup(load_setup("linear-blind"), scenarios).policy, {"baseline": "paper-trapezoid"}
    late = jobs.play_as_late(policy.controller, arm, scenarios, policy.weights)
    ours = play(policy.controller, validation, [float(late["weight"][0])], arm)
    chosen, other = (play(rule, each, environment=arm) for each in (validation, scenarios))
    assert ours["approach_time"].mean() == pytest.approx(chosen["approach_time"].mean(), abs=1e-3)
    assert ours["approach_time"].mean() <= chosen["approach_time"].mean()
    assert late["approach_time"].mean() == pytest.approx(other["approach_time"].mean(), rel=0.03)


@pytest.mark.parametrize(("given", "ranges", "seed"), [
    ({"set": "test", "count": 30}, "train", 60_000_000), ({"set": "hard", "count": 30}, "hard", 60_000_000),
    ({"ranges": "train", "seed": 5, "count": 30}, "train", 60_000_005),
])  # fmt: skip
def test_scenarios_of_the_choice_come_from_the_same_ranges_and_other_seeds(given, ranges, seed):
    drawn = choice.scenarios(given)
    assert (pairs(drawn["ranges"]), drawn["seed"], drawn["count"]) == (pairs(ranges), seed, 2000)
    table = {"table": {"distance": [0.2]}, "seed": 3, "count": 1}
    assert choice.scenarios(table) == table


@pytest.mark.parametrize(("scenarios", "holds_there"), [
    ({"set": "test", "count": 64}, True), ({"set": "test", "count": 63}, False), ({"set": "hard", "count": 64}, False),
    ({"ranges": pairs("test"), "seed": 2_000_000, "count": 64}, True),
    ({"ranges": pairs({"distance": [0.2, 0.4]}), "seed": 2_000_000, "count": 64}, False),
])  # fmt: skip
def test_bound_is_shown_only_for_the_scenarios_that_were_searched(scenarios, holds_there):
    assert (matchups.clairvoyant(load_setup("linear-blind"), scenarios) is not None) == holds_there
