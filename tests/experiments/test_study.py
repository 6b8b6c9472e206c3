"""The runner of all studies: kept and outdated rows, cells that fail, tables on disk, the page."""

import json
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest
from browser_pages import stands_on_its_own
from matplotlib.figure import Figure

from experiments.lab import charts, page
from experiments.lab import study as lab_study
from experiments.lab.parts import Heat, HeatMap, Picture, Section, Table, percent
from experiments.lab.statistics import Estimate
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


def calls(tmp_path):
    return (tmp_path / "log").read_text().splitlines()


@pytest.mark.parametrize("only", [(), ("cubes",)])
def test_rows_have_labels_and_later_tables_see_earlier_ones(study, tmp_path, only):
    frames = run(study, tmp_path / "out", only=only)
    assert frames["squares"].rows() == [("small", 1, 1), ("small", 2, 4), ("large", 10, 100)]
    assert frames["cubes"]["cube"].to_list() == [1, 8, 1000]


def test_csv_holds_no_formula_and_leaves_numbers_and_words():
    texts = ["=1+1", "+1", "-2+3", "@SUM(A1)", "\t=1", "\r=1", "a=1", "learned policy minus rule"]
    read = pl.read_csv(csv_of(pl.DataFrame({"text": texts, "number": [-1.5] * 8})).encode())
    assert read.rows() == [(text, -1.5) for text in (*(f"'{each}" for each in texts[:6]), *texts[6:])]


@pytest.mark.parametrize("width", [390, 1280])
def test_page_stands_on_its_own(study, browser, tmp_path, width):
    page = stands_on_its_own(browser, run(study, tmp_path / "out").folder / "index.html", width)
    for words in ("Which squares?", "quick: False", "A line", "impact-gym study squares"):
        assert words in page.inner_text("main") or page.get_by_alt_text(words).count() == 1


def test_kept_cells_are_measured_again_if_outdated(study, tmp_path, monkeypatch):
    run(study, tmp_path / "out")
    run(study, tmp_path / "out")
    assert calls(tmp_path) == ["1 2", "10"]
    first, second = study.measurements
    run(
        replace(study, measurements=(replace(first, depends=(__name__, "experiments.lab.parts")), second)),
        tmp_path / "out",
    )
    assert calls(tmp_path) == 2 * ["1 2", "10"]
    run(study, tmp_path / "out", force=True)
    assert calls(tmp_path) == 3 * ["1 2", "10"]
    on_solver = replace(study, measurements=(replace(first, depends=("impact_gym.scene",)), second))
    run(on_solver, tmp_path / "out")
    monkeypatch.setattr(lab_study, "compiled_from", lambda: "another solver")
    run(on_solver, tmp_path / "out")
    run(study, tmp_path / "out")  # does not depend on the solver
    assert calls(tmp_path) == 5 * ["1 2", "10"]


def test_page_and_tables_are_of_the_newest_run(study, tmp_path, monkeypatch):
    run(study, tmp_path / "out")
    more = [Cell({"kind": "small"}, {"numbers": [7], "log": str(tmp_path / "log")})]
    newer = replace(study, measurements=(replace(study.measurements[0], cells=lambda *_: more), study.measurements[1]))
    run(newer, tmp_path / "out")
    assert pl.read_csv(tmp_path / "out" / "squares.csv").rows() == [("small", 7, 49)]
    assert pl.read_csv(tmp_path / "out" / "cubes.csv").rows() == [(343,)]
    text = (tmp_path / "out" / "index.html").read_text()
    assert (">49<" in text, ">100<" in text) == (True, False)
    runs = json.loads((tmp_path / "out" / "results.json").read_text())["runs"]
    assert [each["seconds"] > 0.0 for each in runs] == [True, True]
    monkeypatch.setattr(Run, "measure", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run(newer, tmp_path / "out", force=True)
    (failed,) = json.loads((tmp_path / "out" / "results.json").read_text())["runs"]  # those since the last --force
    assert (failed["seconds"], failed["command"]) == (None, "impact-gym study squares")


def test_numbers_and_symbols_are_set_in_type():
    assert [page.factor(value) for value in (0.25, 9.94, 10.4, 1234.0)] == ["0.2", "9.9", "10", "1,200"]
    assert page.typeset("V_p < 1 N/m^1.5 [1, 2]") == "V<sub>p</sub> &lt; 1 N/m<sup>1.5</sup> [1,\N{NO-BREAK SPACE}2]"
    assert charts.mathtext("V_p in m^(1.5), $k_c$") == "$V_{p}$ in m$^{1.5}$, $k_c$"
    assert percent(Estimate(0.125, 0.1, 0.15)) == "12.5 % [10.0, 15.0]"
    assert f"{-Estimate(1.0, 0.5, 2.0):.1f}" == "-1.0 [-2.0, -0.5]"


def test_quick_run_has_fewer_cells_and_only_names_tables(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(study, None, quick=True, only=("squares",))
    assert {file.name for file in Path("reports/squares-quick").glob("*.csv")} == {"squares.csv"}
    assert pl.read_csv("reports/squares-quick/squares.csv").rows() == [("small", 1, 1), ("small", 2, 4)]
    with pytest.raises(ValueError, match=r"only: no table 'cube' in the study squares; its tables: squares, cubes"):
        run(study, tmp_path / "one", only=("cube",))


def test_cell_that_fails_is_an_error_or_a_row(study, tmp_path):
    cells = [
        Cell({"kind": kind}, {"numbers": [k], "log": str(tmp_path / "log")}) for k, kind in ((1, "one"), (0, "none"))
    ]
    first = replace(study.measurements[0], cells=lambda *_: cells)
    with pytest.raises(RuntimeError, match="1 of 2 jobs failed"):
        run(replace(study, measurements=(first,)), tmp_path / "out")
    allowed = replace(first, failed=lambda labels: {"number": len(labels["kind"])})
    rows = run(replace(study, measurements=(allowed,)), tmp_path / "out")["squares"].to_dicts()
    assert rows[0] == {"kind": "one", "number": 1, "failure": None, "square": 1}
    assert rows[1] == {"kind": "none", "number": 4, "failure": "ValueError: no zero", "square": None}


def test_large_table_is_parquet_and_none_of_another_kind_stays(study, tmp_path):
    large = [{"number": k, "square": 0} for k in range(LARGE + 1)]
    only = (study.measurements[1],)
    for rows, kept, gone in ((large, "cubes.parquet", "cubes.csv"), (large[:3], "cubes.csv", "cubes.parquet")):
        few = replace(only[0], cells=lambda *_, rows=rows: [Cell({}, {"squares": rows})])
        run(replace(study, measurements=(few,)), tmp_path / "out")
        assert (tmp_path / "out" / kept).is_file()
        assert not (tmp_path / "out" / gone).exists()
