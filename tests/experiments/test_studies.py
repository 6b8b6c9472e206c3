"""All studies: pages, kept cells and what they depend on. Then gain, teleop, stock, bench, stability and paper."""

from functools import cache
from html import unescape
from importlib.util import find_spec

import numpy as np
import polars as pl
import pytest
from browser_pages import text_of_a_page_that_stands_on_its_own
from small_studies import ROOT, small_run, watched_run

from agents import jobs, load_policy
from agents.baselines import PaperTrapezoid
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.provenance import origin_of
from experiments import studies
from experiments.lab import study
from experiments.lab.parts import Picture, Table
from experiments.studies import bench, gain, stability, stock, teleop
from experiments.studies.paper.statements import SAID
from experiments.studies.solvers import approaches
from experiments.studies.stability import promises
from impact_gym.sources import compiled_from

FIGURES = {"paper": 2, "speed": 1, "stability": 0, "gain": 0, "teleop": 2, "bench": 0, "stock": 1}
EVERY = [pytest.param(name, marks=pytest.mark.slow) if name == "bench" else name for name in studies.NAMES]
CHECKS = "beside", "files", "motion", "parameters", "quantities", "scene", "validation"
STORES = {"agents/archive.py", "agents/jobs.py", *(f"impact_gym/{name}.py" for name in CHECKS)}
"""Code that reads, checks or stores what it is given; no result depends on it alone."""


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A function that returns the small run of a study and the files that it used; each study runs once."""

    @cache
    def run_of(name):
        if name == "stock":
            find_spec("rl_zoo3") or pytest.skip("rl_zoo3 is not installed")
        return watched_run(name, tmp_path_factory.mktemp(name))

    return run_of


def parts_of(findings, kind):
    return [part for section in findings.sections for part in section.parts if isinstance(part, kind)]


def found_by(run):
    return run.study.analyse(run, True)


@pytest.mark.parametrize("name", EVERY)
def test_page_and_tables_have_what_was_measured_once(name, small, monkeypatch):
    run, _ = small(name)
    monkeypatch.setattr(jobs, "perform", None)  # nothing is measured again
    again = small_run(name, run.folder)
    again.write()
    text = unescape(text_of_a_page_that_stands_on_its_own(run.folder, FIGURES[name])).replace("\N{NO-BREAK SPACE}", " ")
    findings = found_by(run)
    for words in (run.study.question, findings.answer, *(section.heading for section in findings.sections)):
        assert words.replace("^(1.5)", "^1.5") in text
    for table in parts_of(findings, Table):
        assert all(cell in text for row in (table.head, *table.rows) for cell in row) or not table.rows
    for table, frame in {**run, **findings.tables}.items():
        assert (run.folder / f"{table}.csv").read_text() == study.csv_of(frame)
    assert all(again[table].equals(frame) for table, frame in run.items())


@pytest.mark.parametrize("name", EVERY)
def test_kept_cells_depend_on_all_code_that_ran(name, small, monkeypatch):
    run, used = small(name)
    assert run.study.name == name
    assert all(measurement.digest for measurement in studies.load(name).measurements)
    monkeypatch.setattr(study, "digest_of", lambda *modules: " ".join(modules))
    for measurement in run.study.measurements:
        solver, *modules = measurement.digest.split(" ")
        files = used[f"{measurement.measure.__module__}:{measurement.measure.__name__}"]
        assert files
        covered = [origin_of(module) for module in modules]
        loose = {file for file in files if not any(file.is_relative_to(place) for place in covered)}
        assert {str(file.relative_to(ROOT)) for file in loose} <= STORES, measurement.name
        ours = {str(file.relative_to(ROOT)) for file in files} & {
            "impact_gym/simulation.py",
            "impact_gym/envs/batch.py",
        }
        assert solver == compiled_from() or not ours


def test_distances_have_the_distribution_of_the_prior():
    uniform, memoryless = gain.Prior(0.15, 0.35), gain.Prior(0.001, 0.6, memoryless=True)
    assert np.sort(uniform.distances(1, 400)) == pytest.approx(0.15 + 0.2 * (np.arange(400) + 0.5) / 400)
    away = memoryless.distances(1, 100_000) - 0.001
    assert away.mean() == pytest.approx(memoryless.mean, rel=1e-3)
    for gone in (0.1, 0.3):  # the remaining distance has the same distribution everywhere
        assert (away[away > gone] - gone).mean() == pytest.approx(memoryless.mean, rel=1e-2)
    assert (away < 0.599).mean() == pytest.approx(0.95, abs=1e-3)


def test_steady_rule_keeps_its_speed_wherever_it_is():
    numbers = [0.4, 15.0, *(parameter.start for parameter in gain.REACTION)]
    played = ScenarioBatch.of("test", 20).play(gain.Steady(numbers))
    ramp = 0.4 / 15.0  # s, in which it travels half as far as at full speed
    assert played.approach_time == pytest.approx(played.scenario["distance"] / 0.4 + ramp / 2, abs=2e-2)


def test_search_prefers_a_gentle_touch_to_none():
    assert not gain.searched((0.15, 0.35), "steady", 0.05, 20, 12, 50)["missed"].any()


def test_shares_of_the_gain_add_up(small):
    run, _ = small("gain")
    rows = run["priors"].filter(rule="rule")
    (line,) = gain.by_prior(run["priors"])
    assert line["limits"].value + line["place"].value == pytest.approx(line["all"].value, rel=1e-12)
    rule, steady, profile = (each.value for each in line["velocity"])
    assert (rule, line["time"]) == pytest.approx((rows["object_velocity"].mean(), rows["approach_time"].mean()))
    shares = (rule - steady) / rule, (steady - profile) / rule, 1.0 - profile / steady
    assert [line[name].value for name in ("limits", "place", "profile")] == pytest.approx(shares)
    (cells,) = parts_of(found_by(run), Table)[0].rows
    shown = [float(cell.split()[0]) for cell in cells[1:]]
    assert shown[:4] == pytest.approx([line["time"], rule, steady, profile], abs=6e-4)
    assert shown[4:] == pytest.approx([100.0 * share for share in shares], abs=0.6)


def test_assistances_are_compared_in_the_same_scenarios(small):
    run, _ = small("teleop")
    found = found_by(run)
    by_name = {(row["operator"], row["contestant"]): row for row in found.tables["cells"].to_dicts()}
    assert {who for _, who in by_name} == {*teleop.ASSISTANCE}
    for ((operator, who), row), cells in zip(by_name.items(), parts_of(found, Table)[0].rows, strict=True):
        rows, brake = run["episodes"].filter(operator=operator, contestant=who), by_name[operator, teleop.BRAKE]
        assert row["slide_low"] <= row["slide"] <= row["slide_high"]
        assert row["cost"] == pytest.approx(row["object_velocity"] + 0.5 * row["done_time"] + 2.0 * row["missed"])
        lower = brake["slide"] - row["slide"], brake["cost"] - row["cost"]
        shown = 100.0 * rows["slide"].mean(), rows["done_time"].mean(), 100.0 * lower[0], lower[1]
        assert [float(cells[k].split()[0]) for k in (2, 3, 6, 7)] == pytest.approx(shown, abs=6e-3)
        assert who == teleop.POLICY or row["taken"] == 0.0  # they do not change the command before the touch
    held_out = {who: by_name["steady", who] for who in teleop.ASSISTANCE}
    panels = [axes for axes in parts_of(found, Picture)[0].figure.axes if np.isfinite(axes.lines[0].get_ydata()).any()]
    for axes, (name, factor) in zip(panels, (("slide", 100.0), ("done_time", 1.0)), strict=True):
        shown = {line.get_label(): (*line.get_xdata(), *line.get_ydata()) for line in axes.lines}
        assert shown == {who: pytest.approx((200.0, factor * held_out[who][name])) for who in teleop.COLOURS}
    policy = [row for (_, who), row in by_name.items() if who == teleop.POLICY]
    lower, higher = (
        sum(row["brake_cost_low"] > 0.0 for row in policy),
        sum(row["brake_cost_high"] < 0.0 for row in policy),
    )
    share = 100.0 * sum(row["brake_cost"] for row in policy) / sum(row["brake_cost"] + row["cost"] for row in policy)
    assert f"in {lower} of 2 cells and clearly more in {higher}; over all {share:.1f} % less" in teleop.duel(policy)
    slides = {who: held_out[who]["slide"] for who in (teleop.ALONE, teleop.BRAKE, teleop.POLICY)}
    assert slides[teleop.BRAKE] < slides[teleop.ALONE]  # the brake stops before the operator sees the touch
    planted = [row | {"slide": 0.01 * (1 + k)} for k, who in enumerate(slides) for row in [held_out[who]]]
    assert "rigid 1.0 cm alone, 2.0 with the brake, 3.0 with the policy" in teleop.answer(planted)


def test_stock_agents_end_after_their_steps_beside_others(small):
    run, _ = small("stock")
    assert {run[name]["steps"][-1] for name in stock.ALGORITHMS} == {64}
    scenarios = ScenarioBatch(41_000_000, 500, time_weight=[2.0])
    for name, controller in (("rule", PaperTrapezoid()), ("policy", load_policy(stock.FIRST))):
        assert run["others"][name][0] == scenarios.play(controller).loss(2.0).mean()


def test_page_of_stock_agents_has_medians_at_each_mark():
    frames = {"others": pl.DataFrame({"setup": [*stock.SETUPS], "rule": 1.5, "profile": 1.1, "policy": 0.9})}
    for place, name in enumerate(stock.ALGORITHMS):
        rows = [
            {"algorithm": name, "setup": setup, "mark": mark, "seconds": seconds + seed, "cost": cost + 0.1 * seed**2}
            for mark, seconds, cost in (("10 s", 10.0, 1.0 + place), ("end", 90.0, 2.0 - 0.1 * place))
            for setup in stock.SETUPS for seed in range(3)
        ]  # fmt: skip
        frames[name] = pl.DataFrame(rows)
    found = stock.analyse(frames, False)
    here, elsewhere = (table.rows for table in parts_of(found, Table))
    assert here[:2] == [
        ["ppo", "10 s", "11", "1.100 [1.000, 1.400]", "3"],
        ["ppo", "end", "91", "2.100 [2.000, 2.400]", "3"],
    ]
    assert elsewhere[0][1:] == [*here[1][:1], *here[1][2:], "1.500", "1.100", "0.900"]
    costs = "paper's rule: 1.500 m/s, tuned profile: 1.100 m/s, shipped policy: 0.900 m/s"
    assert found.answer == f"CROSSQ has the lowest median cost at the end of the training, 1.700 m/s; {costs}."
    axes = parts_of(found, Picture)[0].figure.axes[0]
    assert [*axes.lines[0].get_xdata(), *axes.lines[0].get_ydata()] == pytest.approx([11.0, 91.0, 1.1, 2.1])
    assert ("(s)" in axes.get_xlabel(), "(m/s)" in axes.get_ylabel()) == (True, True)


def test_bench_has_rates_beside_gymnasiums(monkeypatch):
    monkeypatch.setattr(bench, "SIZES", (2, 4, 8))
    monkeypatch.setattr(bench, "BATCH", 8)
    steps = bench.stepped(quick=True)
    rates = {(name, envs): (rate, ratio) for name, envs, rate, ratio in steps.rows()}
    assert {envs for name, envs in rates if name == bench.ID} == {1, 2, 8}
    assert min(rate for rate, _ in rates.values()) > 0.0
    for scale, size in ((bench.SCALE, 1), (bench.BATCH_SCALE, 8)):
        ours = next(rate for name, envs, rate, _ in steps.rows() if envs == size)
        assert rates[scale, size][1] == ours / rates[scale, size][0]
    planted = [
        [bench.ID, 1, 2e5, 1.0],
        [bench.SCALE, 1, 5e4, 4.0],
        [bench.ID, 64, 2.5e6, 1.0],
        [bench.ID, 256, 1e6, 1.0],
    ]
    answer = bench.analyse({"environments": pl.DataFrame(planted, steps.columns, orient="row")}, False).answer
    assert answer.startswith("2.5 million steps per second in a batch of 64 ")
    assert f"4 times as fast as {bench.SCALE}" in answer


@pytest.mark.parametrize(("takes", "steps", "expected"), [(0.25, 5, 20.0), (8.0, 4, 0.5)])
def test_rate_counts_every_step_of_the_calls_made(takes, steps, expected):
    now = [0.0]

    def wait():
        now[0] += takes

    assert bench.rate(wait, steps, 3.0, lambda: now[0]) == expected


def test_page_of_stability_lists_every_failure(small):
    run, _ = small("stability")
    late, _ = run["truth"].to_dicts()
    assert (late["speed"], late["velocity"]) == (approaches.storm(2).motion.speed, None)
    assert "TimeoutError" in late["failure"]
    changes = (
        {"scene": 3, "milliseconds": 77.0}, {"scene": 5, "failure": "RuntimeError: the run stopped"},
        {"scene": 8, "energy_created": 1e-3, "energy_doubt": 1e-9, "traced": True},
    )  # fmt: skip
    wrong = run["storm"]
    for change in changes:
        wrong = wrong.update(pl.DataFrame(change), on="scene")
    findings = stability.STUDY.analyse(run | {"storm": wrong}, False)
    listed = {row[:2] for row in findings.tables["failures"].iter_rows()}
    assert listed >= {(3, promises.FAST.text), (5, promises.ENDED.text), (8, promises.PASSIVE.text)}
    verdicts = {text: (found, met) for text, found, met in findings.sections[0].parts[0].rows}
    assert [verdicts[promise.text][1] for promise in (promises.PASSIVE, promises.FINITE)] == ["missed", "met"]
    found = verdicts[promises.FAST.text][0]
    assert (found.startswith("1 of 27 scenes do not, median "), found.endswith(", largest 77")) == (True, True)
    missed, broken = sum(met == "missed" for _, met in verdicts.values()), len({scene for scene, _ in listed})
    assert findings.answer.startswith(f"{missed} of 8 promises are missed on 27 random scenes")
    assert findings.answer.endswith(f": {broken}.")


def test_page_of_some_figures_has_only_their_statements(small):
    run, _ = small("paper")
    text = unescape(text_of_a_page_that_stands_on_its_own(run.folder, 2))
    shown = [name for name, said in SAID.items() if said.text in text]
    assert shown == [name for name in SAID if name.startswith(("figure_02.", "figure_23."))]
    assert found_by(run).tables["statements"].height == len(shown)
