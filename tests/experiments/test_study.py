"""The runner of all studies: kept and outdated rows, cells that fail, tables on disk, the page."""

import json
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest
from browser_pages import stands_on_its_own
from matplotlib.figure import Figure

from experiments.lab import study as lab_study
from experiments.lab.parts import Heat, HeatMap, Picture, Section, Table
from experiments.lab.study import LARGE, Cell, Findings, Measurement, Run, Study, StudyOptions, csv_of


def squares(numbers, log):
    """Rows of squares; each call writes a line to a file."""
    with Path(log).open("a") as file:
        print(*numbers, file=file)
    if 0 in numbers:
        raise ValueError("no\nzero")
    return [{"number": number, "square": number**2} for number in numbers]


def cubes(squares):
    return pl.DataFrame({"cube": [row["number"] * row["square"] for row in squares]})


def findings(frames, quick):
    figure = Figure()
    figure.subplots().plot([0, 1], [0, 1])
    squares = Table.of("Squares", frames.get("squares", pl.DataFrame()), {"kind": "{kind}", "V_p": "{square}"})
    heat = HeatMap("Warm is worse", ("what", "cost"), [("noise", "1 tried", [Heat("1.2", "at most", 1.2)])])
    line = Picture("line", figure, "A line that rises.", "V_p over k_c")
    sections = [Section("Squares of V_p", [squares, Table("Nothing", ("a",), ()), heat, line], key="first")]
    return Findings(f"quick: {quick}", [*sections, Section("More", ["x^2"], True)])


@pytest.fixture
def study(tmp_path):
    log, kinds = str(tmp_path / "log"), {"small": [1, 2], "large": [10]}
    cells = [Cell({"kind": kind}, {"numbers": numbers, "log": log}) for kind, numbers in kinds.items()]
    return Study("squares", "Which squares?", (
        Measurement("squares", lambda quick, _: cells[: 1 if quick else None], squares, (__name__,)),
        Measurement("cubes", lambda _, of: [Cell({}, {"squares": of["squares"].to_dicts()})], cubes, (__name__,)),
    ), findings)  # fmt: skip


def run(study, folder, **options):
    made = Run(study, StudyOptions(folder, processes=0, **options), "impact-gym study squares")
    made.write()
    return made


def test_rows_have_labels_and_later_tables_see_earlier_ones(study, tmp_path):
    frames = run(study, tmp_path / "out", only=("cubes",))
    assert frames["squares"].rows() == [("small", 1, 1), ("small", 2, 4), ("large", 10, 100)]
    assert frames["cubes"]["cube"].to_list() == [1, 8, 1000]


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


def test_page_and_tables_are_of_the_newest_run(study, tmp_path, monkeypatch):
    run(study, tmp_path / "out")
    more = [Cell({"kind": "small"}, {"numbers": [7], "log": str(tmp_path / "log")})]
    newer = replace(study, measurements=(replace(study.measurements[0], cells=lambda *_: more), study.measurements[1]))
    run(newer, tmp_path / "out")
    assert pl.read_csv(tmp_path / "out" / "squares.csv").rows() == [("small", 7, 49)]
    assert pl.read_csv(tmp_path / "out" / "cubes.csv").rows() == [(343,)]
    text, log = (tmp_path / "out" / "index.html").read_text(), tmp_path / "out" / "results.json"
    assert (">49<" in text, ">100<" in text) == (True, False)
    assert [each["seconds"] > 0.0 for each in json.loads(log.read_text())["runs"]] == [True, True]
    monkeypatch.setattr(Run, "measure", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run(newer, tmp_path / "out", force=True)
    (failed,) = json.loads(log.read_text())["runs"]  # those since the last --force
    assert (failed["seconds"], failed["command"]) == (None, "impact-gym study squares")


def test_quick_run_has_fewer_cells_and_only_names_tables(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(study, None, quick=True, only=("squares",))
    assert {file.name for file in Path("reports/squares-quick").glob("*.csv")} == {"squares.csv"}
    assert pl.read_csv("reports/squares-quick/squares.csv").rows() == [("small", 1, 1), ("small", 2, 4)]
    with pytest.raises(ValueError, match=r"only: no table 'cube' in the study squares; its tables: squares, cubes"):
        run(study, tmp_path / "one", only=("cube",))


def test_cell_that_fails_is_an_error_or_a_row(study, tmp_path):
    log, kinds = str(tmp_path / "log"), {"one": [1], "none": [0]}
    cells = [Cell({"kind": kind}, {"numbers": numbers, "log": log}) for kind, numbers in kinds.items()]
    first = replace(study.measurements[0], cells=lambda *_: cells)
    with pytest.raises(RuntimeError, match="1 of 2 jobs failed"):
        run(replace(study, measurements=(first,)), tmp_path / "out")
    allowed = replace(first, failed=lambda labels: {"number": len(labels["kind"])})
    rows = run(replace(study, measurements=(allowed,)), tmp_path / "out")["squares"].rows()
    assert rows == [("one", 1, 1, None), ("none", 4, None, "ValueError: no zero")]


def test_large_table_is_parquet_and_none_of_another_kind_stays(study, tmp_path):
    large, out = [{"number": k, "square": 0} for k in range(LARGE + 1)], tmp_path / "out"
    for rows, kept, gone in ((large, "cubes.parquet", "cubes.csv"), (large[:3], "cubes.csv", "cubes.parquet")):
        few = replace(study.measurements[1], cells=lambda *_, rows=rows: [Cell({}, {"squares": rows})])
        run(replace(study, measurements=(few,)), out)
        assert ((out / kept).is_file(), (out / gone).exists()) == (True, False)
