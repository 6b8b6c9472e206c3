"""The runner of studies: kept rows, tables, the page; then small runs of all studies but `stock`, which trains."""

import json
import re
from dataclasses import replace
from functools import cache, partial
from html import unescape
from itertools import count
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from browser_pages import stands_on_its_own
from matplotlib.figure import Figure
from refusal import refused

from agents import jobs
from experiments import studies
from experiments.lab import results
from experiments.lab import study as lab_study
from experiments.lab.parts import Picture, Section, Table
from experiments.lab.statistics import Resamples
from experiments.lab.study import Cell, Findings, Measurement, Study, StudyOptions, StudyRun, csv_of
from experiments.studies import sensors, stability, teleop
from experiments.studies.solvers import approaches
from experiments.studies.speed import precision, rates, trainings
from impact_gym.support.sources import compiled_from

FIGURES = {"paper": 1, "speed": 3, "stability": 0, "teleop": 0, "sensors": 0, "speed of trainings": 0}
EVERY = [pytest.param(name, marks=pytest.mark.slow) if "training" in name else name for name in FIGURES]


def squares(numbers, log):
    """Rows of squares; each call writes a line to a file."""
    with Path(log).open("a") as file:
        print(*numbers, file=file)
    return [{"number": number, "square": number**2} for number in numbers]


def cubes(squares):
    return pl.DataFrame({"cube": [row["number"] * row["square"] for row in squares]})


def analysed(frames, quick):
    figure = Figure()
    figure.subplots().plot([0, 1], [0, 1])
    squares = Table.of("Squares", frames.get("squares", pl.DataFrame()), {"kind": "{kind}", "V_p": "{square}"},
                       "some-squares")  # fmt: skip
    line = Picture("line", figure, "A line that rises.", "V_p over k_c")
    sections = [Section("Squares of V_p", [squares, Table("Nothing", ("a",), ()), line], key="first")]
    return Findings(f"quick: {quick}", [*sections, Section("More", ["x^2"], True)])


@pytest.fixture
def study(tmp_path):
    log, kinds = str(tmp_path / "log"), {"small": [1, 2], "large": [10]}
    cells = [Cell({"kind": kind}, {"numbers": numbers, "log": log}) for kind, numbers in kinds.items()]
    return Study("squares", "Which squares?", (
        Measurement("squares", lambda quick, _: cells[: 1 if quick else None], squares, (__name__,)),
        Measurement("cubes", lambda _, of: [Cell({}, {"squares": of["squares"].to_dicts()})], cubes, (__name__,)),
    ), analysed)  # fmt: skip


def run(study, folder, **options):
    made = StudyRun(study, StudyOptions(folder, processes=0, **options), "impact-gym study squares")
    made.write()
    return made


def test_results_of_pages_are_read_as_written(study, tmp_path):
    folder = tmp_path / "results"
    refused(partial(StudyOptions, quick=True, results=folder), "results need a whole run")
    made = run(study, tmp_path / "out", results=folder)
    about, table = results.read("some-squares", folder)
    assert (about["command"], about["table"]) == (made.command, "Squares")
    assert [table.head, *table.rows] == [["kind", "V_p"], ["small", "1"], ["small", "4"], ["large", "100"]]
    assert results.cell("some-squares", "large", "V_p", folder) == "100"
    for row, column in (("small", "V_p"), ("none", "V_p"), ("large", "other")):
        refused(partial(results.cell, "some-squares", row, column, folder), repr(row), repr(column), made.command)
    refused(partial(results.read, "other", folder), "other.csv", "make results")
    text = (folder / "some-squares.csv").read_text()
    for damaged in ("", text.replace("# machine", "# engine"), f"{text}small,9,9\n"):
        (folder / "some-squares.csv").write_text(damaged)
        refused(partial(results.read, "some-squares", folder), "some-squares.csv is damaged or of another version")


def test_csv_holds_no_formula_and_leaves_numbers_and_words():
    texts = ["=1+1", "+1", "-2+3", "@SUM(A1)", "\t=1", "\r=1", "a=1", "learned policy minus rule"]
    read = pl.read_csv(csv_of(pl.DataFrame({"text": texts, "number": [-1.5] * 8})).encode())
    assert read.rows() == [(text, -1.5) for text in (*(f"'{each}" for each in texts[:6]), *texts[6:])]


def test_page_stands_on_its_own(study, browser, tmp_path):
    page = stands_on_its_own(browser, run(study, tmp_path / "out").folder / "index.html", 390)
    for words in ("Which squares?", "quick: False", "A line", "impact-gym study squares"):
        assert words in page.inner_text("main") or page.get_by_alt_text(words).count() == 1


def test_kept_cells_are_measured_again_if_outdated(study, tmp_path, monkeypatch):
    first, second = study.measurements
    on_more, on_solver = (replace(first, depends=(name,)) for name in ("experiments.lab.parts", "impact_gym.scene"))
    times = 0
    for solver, measurement, force, again in (
        ("one", first, False, True), ("one", first, False, False), ("one", on_more, False, True),
        ("one", on_more, True, True), ("one", on_solver, False, True), ("two", on_solver, False, True),
        ("two", first, False, True), ("one", first, False, False),  # does not depend on the solver
    ):  # fmt: skip
        monkeypatch.setattr(lab_study, "compiled_from", lambda solver=solver: solver)
        run(replace(study, measurements=(measurement, second)), tmp_path / "out", force=force)
        times += again
        assert (tmp_path / "log").read_text().splitlines() == times * ["1 2", "10"]


def test_failed_cell_is_a_row_with_its_own_labels(study, tmp_path, monkeypatch):
    """Of the cells of a table the second fails: its numbers are words."""
    log = str(tmp_path / "log")
    cells = [Cell({"kind": str(kind)}, {"numbers": [kind], "log": log}) for kind in (1, "two", 3)]
    three = replace(study.measurements[0], cells=lambda *_: cells, processes=2)
    table = replace(three, failed=lambda labels: {"of": f"cell {labels['kind']}"})
    monkeypatch.setattr(jobs, "multiprocessing", None)  # of 2 and 0 processes, the smaller number measures
    rows = StudyRun(replace(study, measurements=(table,)), StudyOptions(tmp_path / "out", processes=0))["squares"]
    assert rows["square"].to_list() == [1, None, 9]
    assert rows["of"].to_list() == [None, "cell two", None]
    assert "TypeError" in rows["failure"][1]


def test_page_and_tables_are_of_the_newest_run(study, tmp_path):
    frames = run(study, tmp_path / "out", only=("cubes",))
    assert frames["squares"].rows() == [("small", 1, 1), ("small", 2, 4), ("large", 10, 100)]
    more = [Cell({"kind": "small"}, {"numbers": [7], "log": str(tmp_path / "log")})]
    newer = replace(study, measurements=(replace(study.measurements[0], cells=lambda *_: more), study.measurements[1]))
    (tmp_path / "out" / "squares.parquet").touch()  # of an earlier run with more rows
    run(newer, tmp_path / "out")
    assert not (tmp_path / "out" / "squares.parquet").exists()
    assert pl.read_csv(tmp_path / "out" / "squares.csv").rows() == [("small", 7, 49)]
    assert pl.read_csv(tmp_path / "out" / "cubes.csv").rows() == [(343,)]
    text, log = (tmp_path / "out" / "index.html").read_text(), tmp_path / "out" / "results.json"
    assert (">49<" in text, ">100<" in text) == (True, False)
    assert [each["seconds"] > 0.0 for each in json.loads(log.read_text())["runs"]] == [True, True]
    run(newer, tmp_path / "out", force=True)
    assert len(json.loads(log.read_text())["runs"]) == 1


PLAYED = {"weights": [sensors.WEIGHT], "scenarios": {"set": "test", "count": 40}}
TRAINED = Cell(SEEDED := {"inputs": "recurrent", "seed": 0, "steps": 1 << 15}, SEEDED | PLAYED)
FEW = {
    "paper": {figure: [Cell({}, {})] for figure in ("figure_02", "figure_23")},
    "speed": {"times": [next(precision.cells(True, {}))], "cost": None},
    "stability": {"scenes": [Cell({"scene": number}, {"number": number}) for number in range(9)],
                  "truth": [Cell({"scene": number}, {"number": seed}) for number, seed in ((2, -1), (5, 5))]},
    "teleop": {"episodes": [cell for cell in teleop.assisted(True, {})
                            if cell.labels["coupling"] == "rigid" and cell.labels["seed"] < 2]},
    "sensors": {"episodes": None, "rivals": None, "networks": [[*sensors.networks(True, {})][-1], TRAINED]},
    "speed of trainings": {
        "environments": None, "rates": [Cell({"set-up": "linear-blind"}, {"name": "linear-blind", "quick": True})],
        "trainings": [*trainings.cells(True, {})][:2]},
}  # fmt: skip
"""The few cells of each table; None: the cells of a quick run. The first truth fails."""


def small_run(name, folder):
    """A run of a study, in this process, of the few cells alone."""
    whole, cells = studies.load(name.partition(" ")[0]), FEW[name]
    few = [
        replace(each, cells=(lambda *_, made=made: made) if (made := cells[each.name]) else each.cells, processes=0)
        for each in whole.measurements if each.name in cells
    ]  # fmt: skip
    return StudyRun(replace(whole, measurements=few), StudyOptions(folder, quick=True, processes=0), "the command")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A function that returns the small run of a study; each study runs once."""

    @cache
    def run_of(name):
        (run := small_run(name, tmp_path_factory.mktemp(name))).write()
        return run

    return run_of


@pytest.mark.parametrize("name", EVERY)
def test_page_and_tables_have_what_was_measured_once(name, small, monkeypatch):
    run = small(name)
    written = (run.folder / "index.html").read_text()
    assert written.count("data:image/svg") == FIGURES[name]
    assert not re.search(r"""(src|href)=["'](https?:|//)""", written)
    assert all((run.folder / file).is_file() for file in re.findall('href="([^"#]+)"', written))
    text = re.sub(r"<sup>([^<]+)</sup>", r"^\1", re.sub(r"<sub>(\w+)</sub>", r"_\1", written))  # V_p and m^1.5
    text = unescape(text).replace("\N{NO-BREAK SPACE}", " ")
    findings = run.study.analyse(run, True)
    for words in (run.study.question, findings.answer, *(section.heading for section in findings.sections)):
        assert words.replace("^(1.5)", "^1.5") in text
    for table in (part for section in findings.sections for part in section.parts if isinstance(part, Table)):
        assert all(cell in text for row in (table.head, *table.rows) for cell in row) or not table.rows
    for table, frame in {**run, **findings.tables}.items():
        assert (run.folder / f"{table}.csv").read_text() == csv_of(frame)
    monkeypatch.setattr(jobs, "perform", None)  # nothing is measured again
    again = small_run(name, run.folder)
    assert all(again[table].equals(frame) for table, frame in run.items())


@pytest.mark.parametrize("name", studies.QUESTIONS)
def test_kept_cells_depend_on_measure_and_solver(name, monkeypatch):
    assert (studies.load(name).name, studies.load(name).question) == (name, studies.QUESTIONS[name])
    monkeypatch.setattr(lab_study, "digest_of", lambda *modules: " ".join(modules))
    for measurement in studies.load(name).measurements:
        solver, *modules = measurement.digest.split(" ")
        assert {*modules} == {measurement.measure.__module__, *measurement.depends}
        independent = measurement.measure == stability.checks.truth_row
        assert solver == ("" if independent else compiled_from())


def test_assistances_are_compared_in_the_same_scenarios(small):
    episodes = small("teleop")["episodes"]
    rows = {who: each for (who,), each in episodes.group_by("contestant")}
    assert {*rows} == {*teleop.ASSISTANCE}
    (_, *cells), _ = teleop.slides(teleop.means_of(episodes)).rows
    *slides, less = (float(cell.partition(" [")[0]) for cell in cells)
    assert slides == pytest.approx([100.0 * rows[who]["slide"].mean() for who in teleop.ASSISTANCE], abs=0.051)
    assert slides[2] < slides[0]  # the brake stops before the operator sees the touch
    brake, policy = (
        each["object_velocity"].mean() + 0.5 * each["done_time"].mean() + 2.0 * each["missed"].mean()
        for each in (rows[teleop.BRAKE], rows[teleop.POLICY])
    )
    assert less == pytest.approx(100.0 * (1.0 - policy / brake), abs=0.051)
    for who in teleop.ASSISTANCE[:3]:  # they do not change the command before the touch
        assert rows[who]["withheld_share"].max() == 0.0


def test_sensors_are_compared_at_the_rules_time(small):
    run = small("sensors")
    (table,) = (part for part in run.study.analyse(run, True).sections[0].parts if isinstance(part, Table))
    for sensor, lower, _ in table.rows:
        rows = run["episodes"].filter(pl.col("sensor") == sensor, ~pl.col("missed"))
        means = rows.group_by("contestant", "weight").agg(pl.col("approach_time", "object_velocity").mean())
        of = {who: each.sort("approach_time") for (who,), each in means.group_by("contestant")}
        (time,), (velocity,) = of[sensors.RULE]["approach_time"], of[sensors.RULE]["object_velocity"]
        ours = np.interp(time, of[sensors.PROFILE]["approach_time"], of[sensors.PROFILE]["object_velocity"])
        assert float(lower.partition(" [")[0]) == pytest.approx(100.0 * (1.0 - ours / velocity), abs=0.051)


def test_learning_is_compared_with_filter_and_profile(small):
    run = small("sensors")
    table, answer = sensors.compared(run, Resamples(40))
    costs = {name: float(cost.partition(" [")[0]) for name, cost, *_ in table.rows}
    ours = costs[sensors.OURS]
    for name, less in ((row[0], row[2].partition(" [")[0]) for row in table.rows if row[2]):
        assert float(less) == pytest.approx(100.0 * (1.0 - costs[name] / ours), abs=0.2)
    played = run["networks"].filter(inputs="profile", weight=sensors.WEIGHT)["cost"].mean()
    assert played == pytest.approx(ours, rel=0.02)  # before a training, the network adds nearly nothing
    best = min((row for row in table.rows if "PPO" in row[0]), key=lambda row: costs[row[0]])
    low = float(best[2].partition("[")[2].partition(",")[0])  # of the interval of how much less it costs, %
    assert ("does not gain" in answer) == (low <= 0.0)


def test_rate_counts_every_step_of_the_calls_made():
    for takes, steps, expected in ((0.25, 5, 20.0), (8.0, 4, 0.5)):
        now = count(0.0, takes)  # each reading of the clock is one call later
        assert rates.rate(lambda: None, steps, 3.0, partial(next, now)) == expected


def test_shorter_trainings_are_compared_with_the_whole_one():
    measured = {
        trainings.OWN: (10.0, 0.7, 0.71, 0.72),
        "half": (5.0, 0.8, 0.9, 0.81),
        "most of it": (7.0, 0.5, 0.6, 0.5),
    }
    rows = [
        {"idea": idea, "seconds": seconds, "score": score} for idea, (seconds, *of) in measured.items() for score in of
    ]
    answer, (section,) = trainings.about(pl.DataFrame(rows))
    assert section.parts[0].rows[1:] == [["half", "0.50", "0.8100 [0.8000, 0.9000]", "3"],
                                         ["most of it", "0.70", "0.5000 [0.5000, 0.6000]", "3"]]  # fmt: skip
    assert "a median cost of 0.5000 m/s" in answer


def test_page_of_stability_lists_every_failure(small):
    run = small("stability")
    late, _ = run["truth"].to_dicts()
    assert (late["speed"], late["velocity"]) == (approaches.random_approach(2).motion.speed, None)
    assert late["failure"].startswith("ValueError")
    change = pl.DataFrame({"scene": [3, 5], "milliseconds": [77.0, 0.1], "failure": ["", "RuntimeError: it stopped"]})
    findings = stability.STUDY.analyse(run | {"scenes": run["scenes"].update(change, on="scene")}, False)
    listed = {row[:2] for row in findings.tables["failures"].iter_rows()}
    assert listed >= {(3, stability.FAST.text), (5, stability.ENDED.text)}
    verdicts = {text: numbers for text, *numbers in findings.sections[0].parts[0].rows}
    assert verdicts[stability.FAST.text][0] == "no"
    assert verdicts[stability.FINITE.text][:3] == ["yes", "8", "0"]
