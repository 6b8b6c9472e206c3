"""The study `paper`: figures, rules for statements, verdicts, and the page."""

import html
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from pages import text_of_a_page_that_stands_on_its_own

from experiments.lab.study import Run as StudyRun
from experiments.lab.study import StudyOptions, frame_of
from experiments.studies.paper import STUDY, section_4
from experiments.studies.paper.runs import WIDTH
from experiments.studies.paper.statements import SAID, Basis, Said, Verdict, agreeing_digits, judge

APART = {  # the statements that do not agree; the page has the reason of each
    Verdict.DISAGREES: (  # a correct model contradicts the text
        "figure_06.restitution", "figure_13.brakes_after", "figure_14.share",
        "figure_17.relative_velocity", "figure_18.contact_stiffness", "figure_19.slower", "beyond_delay.operator",
    ),
    Verdict.ONE_READING: (  # the page has both readings
        "figure_14.deceleration", "figure_16.stiffness", "figure_17.compression", "figure_19.synchronous",
        "figure_19.pushes", "figure_19.compressed", "figure_20.equation_22", "figure_23.deceleration",
        "figure_23.complete", "beyond_objects.small_modifications", "beyond_speed.small_increase",
    ),
}  # fmt: skip


@pytest.fixture(scope="session")
def frames():
    return {table.name: frame_of([({}, table.measure())]) for table in STUDY.measurements}


@pytest.fixture(scope="session")
def findings(frames):
    return STUDY.analyse(frames, False)


@pytest.fixture(scope="session")
def statements(findings):
    return findings.tables["statements"]


@pytest.mark.parametrize(("printed", "ours", "digits"), [
    ("0.98", 0.9786, (2, 2)), ("0.95", 0.9786, (1, 2)), ("5e1", 51.04, (1, 1)), ("0.321", 0.4, (0, 3)),
])  # fmt: skip
def test_agreeing_digits(printed, ours, digits):
    assert agreeing_digits(printed, ours) == digits


@pytest.mark.parametrize(("ours", "text", "verdict"), [
    (0.9786, "is 0.98", Verdict.DIGITS), (0.9786, "is about 0.98", Verdict.DIGITS),
    (0.972, "is 0.98", Verdict.DISAGREES), (0.972, "is about 0.98", Verdict.AGREES),
    (0.968, "is about 0.98", Verdict.DISAGREES),
])  # fmt: skip
def test_number_allows_one_unit_of_the_last_digit_after_about(ours, text, verdict):
    said = Said(text=f"the velocity {text}", section="1", basis="identified", printed="0.98 m/s", value="v")
    statement = judge("figure", said, {"v": ours})
    assert [statement[name] for name in ("verdict", "basis", "unit")] == [verdict, Basis.IDENTIFIED, "m/s"]


def test_each_statement_is_judged_by_one_rule_and_has_a_reason(statements):
    for (name, said), row in zip(SAID.items(), statements.iter_rows(named=True), strict=True):
        kinds = [said.printed is not None, bool(said.holds), bool(said.agree), said.rule == "none" and not said.printed]
        assert sum(kinds) == 1, name
        assert row["ours"], name
        assert row["why"] or row["verdict"] in (Verdict.DIGITS, Verdict.AGREES), name
        assert row["otherwise"] or row["verdict"] != Verdict.ONE_READING, name


@pytest.mark.parametrize("verdict", APART)
def test_all_statements_but_the_listed_ones_agree(statements, verdict):
    listed = [name for name, found in zip(SAID, statements["verdict"], strict=True) if found == verdict]
    assert listed == [*APART[verdict]]


def test_answer_and_documentation_have_the_counts(findings, statements):
    bases = Counter(statements["basis"])
    verdicts = Counter(statements.filter(basis=Basis.TEST)["verdict"])
    agree = verdicts[Verdict.DIGITS] + verdicts[Verdict.AGREES]
    tests = [agree, *(verdicts[verdict] for verdict in (Verdict.ONE_READING, Verdict.DISAGREES, Verdict.UNDECIDED))]
    no_tests = [bases[basis] for basis in (Basis.IDENTIFIED, Basis.GIVEN, Basis.REPEATED)]
    paper = (Path(__file__).parents[2] / "docs/provenance.md").read_text()
    assert f"compares {len(statements)} statements" in paper
    *rows, last = re.findall(r"^\| (.+) \| (\d+) \|$", paper, re.MULTILINE)
    assert [int(count) for _, count in rows] == tests
    assert [int(number) for number in (*re.findall(r"\d+", last[0]), last[1])] == [*no_tests, sum(no_tests)]
    counts = [len(statements), sum(tests), *tests, sum(no_tests), *no_tests]
    assert [int(number) for number in re.findall(r"\d+", findings.answer)] == counts


def test_page_of_some_figures_stands_on_its_own_with_their_statements(statements, tmp_path):
    StudyRun(STUDY, StudyOptions(out=tmp_path, only=("figure_22", "figure_02"))).write()
    text = html.unescape(text_of_a_page_that_stands_on_its_own(tmp_path, 2))
    for figure, said in statements.select("figure", "text").iter_rows():
        assert (said in text) == (figure in ("figure_02", "figure_22")), said
    assert (tmp_path / "statements.csv").read_text().count("\n") == 1 + 5 + 4


@pytest.mark.parametrize("name", ["figure_16", "figure_18"])
def test_enclose_changes_brackets_the_number_of_contacts(frames, name):
    for rows in section_4.curves(frames[name]):
        assert (np.diff(rows["coupling_stiffness"]) > 0.0).all()
        assert (np.diff(rows["coupling_stiffness"])[np.diff(rows["contacts"]) != 0] <= WIDTH).all()
