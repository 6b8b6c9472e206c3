"""The page of a study of designs, and the checks of the search and of one tuning for all sizes."""

import numpy as np
import pytest
from browsers import chromium, opened
from policies import made_up_policy

from agents.archive import write_archive
from agents.baselines.tuned import read_tuned
from agents.design.__main__ import FORMAT
from agents.design.search import play_one
from agents.design.study import PAPERS_RULE
from agents.evaluate import Episodes, Stage
from agents.setups import load_setup
from experiments.design import watch
from experiments.design.__main__ import read, reduction, show
from experiments.design_check import agreement, sizes, told
from experiments.lab.statistics import Resamples
from experiments.lab.tables import rows_of

SCENARIOS = 40


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study as `agents.design` writes it: V_p falls by 0.5 m/s per s from one approach time to the next.

    Nobody played it, so there is nothing to watch.
    """
    monkeypatch.setattr(watch, "front", lambda *_: {"contestants": [], "columns": [], "scenes": []})
    shares = [("paper's rule", 1.0, 0.6), ("designs", 1.0, 0.2), ("chosen", 1.1, 0.17), ("chosen", 0.9, 0.23)]
    shares += [("designs", 1.2, 0.1)]
    entries = [{"line": line, "share": share, "design": {"tool_mass": 0.1}, "pad": ""} for line, share, _ in shares]
    arrays = {}
    for place, (_, share, velocity) in enumerate(shares):
        same = {"approach_time": 0.3 * share, "object_velocity": velocity, "deflection": 0.01, "stroke": 0.02}
        same |= {"peak_force": 9.0, "contact_count": 1.0, "missed": 0.0, "energy": 0.1}
        arrays |= {f"{name}_{place}": np.full(SCENARIOS, value) for name, value in same.items()}
        arrays[f"distance_{place}"] = np.linspace(0.15, 0.35, SCENARIOS)
    content = {
        "command": "python -m agents.design",
        "seconds": 1.0,
        "setup": "linear-blind",
        "tolerance": 0.05,
        "entries": entries,
    }
    write_archive(tmp_path / "designs.npz", FORMAT, content, arrays)
    return tmp_path


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """A study of two springs with a shipped controller, one on a pad, as they were played on the test set."""
    folder, weights = tmp_path_factory.mktemp("played"), read_tuned("blind-profile")["weights"].values()
    controllers = [list(found["parameters"].values()) for found in weights]
    spring = {"coupling.stiffness": 70.0, "coupling.damping_ratio": 0.4}
    profile = {"design": spring, "rule": "BlindProfile", "environment": {"tool_mass": 0.125}}
    entries = [{"line": "paper's rule", "design": {}, **PAPERS_RULE, "environment": {}, "pad": ""}]
    entries += [{"line": "designs", **profile, "parameters": controllers[-1], "pad": ""}]
    entries += [{"line": "designs", **profile, "parameters": controllers[0], "pad": "memory-foam"}]
    entries += [entries[1] | {"line": "chosen"}]
    arrays = {}
    for place, entry in enumerate(entries):
        rest = {name: value for name, value in entry.items() if name != "line"}
        result = play_one(**rest, tolerance=0.05, scenarios=["test", None])
        arrays |= {f"{name}_{place}": values for name, values in result.items()}
    content = {"command": "python -m agents.design", "seconds": 1.0, "setup": "linear-blind", "tolerance": 0.05}
    content["entries"] = [entry | {"share": 1.0} for entry in entries]
    write_archive(folder / "designs.npz", FORMAT, content, arrays)
    return folder


def test_a_line_is_read_at_the_mean_approach_time_of_the_papers_rule(study):
    _, lines = read(study)
    assert lines["chosen"].mean("approach_time") == pytest.approx([0.27, 0.33])
    found = reduction(lines["chosen"], lines["paper's rule"], Resamples(SCENARIOS))
    assert (found.value, found.low, found.high) == pytest.approx((1.0 - 0.2 / 0.6,) * 3)


def test_the_page_says_what_the_chosen_design_gains_and_lists_every_design(study):
    text = show(study).read_text()
    assert "66.7 % [66.7, 66.7] slower" in text
    assert text.count('<td class="words">tool_mass 0.1 kg</td>') == 5 + 2  # all, and those of the front once more
    assert "10.0 mm against the flange" in text


def test_the_slider_of_the_page_goes_through_the_designs_of_the_front_and_their_films(played):
    path = show(played)
    designs = read(played)[1]["designs"]
    with chromium() as browser:
        page, problems = opened(browser, path, reduced_motion="reduce")
        page.focus("#which")
        for place in range(2):
            time, velocity = (designs.mean(name)[place] for name in ("approach_time", "object_velocity"))
            assert page.inner_text("#time") == page.get_attribute("#which", "aria-valuetext") == f"{time:.3f} s"
            (row,) = (row for row in page.locator("tr.one").all() if row.is_visible())
            assert row.inner_text().split("\t")[:2] == [f"{time:.3f}", f"{velocity:.3f}"]
            assert page.locator(".igw-panel h3").all_inner_texts() == [watch.PAPER, f"designed for {time:.3f} s"]
            page.keyboard.press("ArrowRight")
        page.select_option(".igw-select", "1")  # a scene of the first design
        assert page.input_value("#which") == "0"
        assert page.inner_text("#time") == f"{designs.mean('approach_time')[0]:.3f} s"
        assert page.evaluate("document.documentElement.scrollWidth") <= 1280
        assert problems == []


def test_a_film_shows_what_the_study_says_of_a_design_its_pad_and_its_tolerance(played):
    content, lines = read(played)
    paper, designs = lines["paper's rule"], lines["designs"]
    found = watch.front(paper.told(0), [designs.told(0), designs.told(1)], content["tolerance"])
    assert len(found["scenes"]) == 2 * 3
    for place, scene in enumerate(found["scenes"]):
        rule, design = scene["runs"]
        number, of = scene["number"], divmod(place, 3)[0]
        assert rule["object_velocity"] == paper.played["object_velocity"][0, number]
        assert design["object_velocity"] == designs.played["object_velocity"][of, number]
        assert rule["chain"]["rest"] != design["chain"]["rest"]  # each has its own spring
    designs.played["object_velocity"][0] += 1e-9
    with pytest.raises(RuntimeError, match="the replay of 'designed for"):
        watch.front(paper.told(0), [designs.told(0)], content["tolerance"])


def test_a_typical_scenario_is_watched_and_those_of_most_and_least_gain():
    def episodes(velocity, missed):
        return Episodes(np.array(velocity), *np.ones((3, 5)), np.array(missed), {})

    paper = episodes([0.5, 0.9, 0.5, 0.5, 2.0], [0.0, 0.0, 0.0, 0.0, 0.0])
    design = episodes([0.1, 0.2, 0.3, 0.45, 0.0], [0.0, 0.0, 0.0, 0.0, 1.0])
    assert list(watch.chosen(paper, design).values()) == [2, 1, 3]
    nothing = episodes([0.0] * 5, [1.0] * 5)
    assert set(watch.chosen(paper, nothing).values()) <= {*range(5)}


def test_a_folder_without_a_study_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"designs\.npz"):
        read(tmp_path)


def test_the_papers_point_of_the_map_is_that_of_its_figure_23():
    """V_p 0.45074 m/s with the mechanism and 0.692859 m/s with the spring, by an independent solver."""
    rows = rows_of(sizes.row_of_masses("object", 1.0, [0.25]))
    assert rows[0]["mechanism"] == pytest.approx(0.45074, rel=1e-4)
    assert rows[0]["spring"] == pytest.approx(0.692859, rel=1e-4)
    assert rows[0]["modified"] <= rows[0]["mechanism"]
    assert rows_of(sizes.row_of_masses("both", 1.0, [0.25])) == [rows[0] | {"kind": "both"}]


def test_a_spring_of_the_grid_stays_as_it_is_and_a_free_one_is_found_within_its_range(monkeypatch):
    monkeypatch.setitem(agreement.SEARCH, "scenarios", 10)
    monkeypatch.setattr(agreement, "TEST", ["test", 50])
    (kept,) = rows_of(agreement.found(0.31, 16, [60.0, 0.4], 1))
    assert (kept["stiffness"], kept["damping_ratio"]) == (60.0, 0.4)
    (free,) = rows_of(agreement.found(0.31, 16, [], 1))
    assert agreement.STIFFNESS.low <= free["stiffness"] <= agreement.STIFFNESS.high
    assert free["low"] <= free["velocity"] <= free["high"]


def test_a_policy_judges_a_spring_by_the_episodes_in_which_it_is_drawn(monkeypatch, tmp_path):
    options = load_setup("linear-designs").environment
    policy = made_up_policy(environment=options)
    monkeypatch.setattr(told, "POLICY", str(policy.save(tmp_path / "told.npz")))
    monkeypatch.setattr(told, "TEST", ["test", 30])
    monkeypatch.setattr(told, "WEIGHTS", (1.0,))  # so there is nothing to read between
    (row,) = rows_of(told.judged(90.0, 0.3))
    drawn = {"coupling.stiffness": np.full(30, 90.0), "coupling.damping_ratio": np.full(30, 0.3)}
    alone = Stage.of("test", 30, time_weight=[1.0], **options).play(policy, drawn)
    assert row["velocity"] == pytest.approx(alone.loss(0.0).mean(), rel=1e-12)
    assert row["low"] < row["velocity"] < row["high"]


def test_policy_and_searches_are_compared_spring_by_spring_and_one_that_moves_too_far_is_not_the_best():
    springs = [{"stiffness": stiffness, "damping_ratio": 0.5} for stiffness in (30.0, 60.0, 90.0, 120.0)]
    ours, theirs = (0.20, 0.25, 0.26, 0.30), (0.22, 0.251, 0.262, 0.29)
    deflections = (0.051, 0.04, 0.03, 0.02)
    rows = [one | {"velocity": v, "deflection": d} for one, v, d in zip(springs, ours, deflections, strict=True)]
    tables = {"told": rows, "grid": [{"velocity": v} for v in theirs], "picked": [springs[1]]}
    said = told.said(tables)
    assert said["told_alike"] == 2
    assert said["told_rank"] == pytest.approx(1.0)
    assert said["told_best"]["stiffness"] == 60.0
    assert [row["allowed"] for row in said["told"]] == [False, True, True, True]
