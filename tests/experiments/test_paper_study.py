"""The study `paper`: its verdicts, and wrong models that have the opposite verdict on each statement."""

from contextlib import suppress
from functools import cache

import pytest

from experiments.lab.parts import Table
from experiments.lab.results import read
from experiments.lab.study import frame_of
from experiments.studies.paper import FIGURES, STUDY
from experiments.studies.paper.runs import WRONG
from experiments.studies.paper.statements import Verdict

APART = {  # the statements that do not agree; the page has the reason of each
    "figure_06": {"force": Verdict.DISAGREES},
    "figure_13": {"brakes_after": Verdict.DISAGREES},
    "figure_14": {"impact_velocity": Verdict.DISAGREES, "deceleration": Verdict.ONE_READING},
    "figure_16": {"stiffness": Verdict.ONE_READING},
    "figure_17": {"relative_velocity": Verdict.DISAGREES, "compression": Verdict.ONE_READING},
    "figure_18": {"contact_stiffness": Verdict.DISAGREES},
    "figure_19": dict.fromkeys(("synchronous", "pushes", "compressed", "slower", "equation_22"), Verdict.DISAGREES),
    "figure_23": {"complete": Verdict.DISAGREES, "deceleration": Verdict.ONE_READING},
    "beyond_delay": {"operator": Verdict.DISAGREES},
    "beyond_objects": {"small_modifications": Verdict.ONE_READING},
    "beyond_speed": {"small_increase": Verdict.ONE_READING},
}
NO_MODEL_AGREES = {("figure_06", "force"), ("figure_19", "pushes"), ("figure_23", "complete")}


@cache
def frame(measure):
    return frame_of([({}, measure())])


def judged_by(model, figure):
    found = {}
    with suppress(LookupError, TypeError, ValueError):  # without a contact, later statements are missing
        for statement in FIGURES[figure].statements(frame_of([({}, FIGURES[figure].measure(WRONG[model]))])):
            found[statement.finding.name] = statement.verdict
    return found


@pytest.mark.parametrize("figure", FIGURES)
def test_a_wrong_model_has_the_opposite_verdict(figure):
    statements = {each.finding.name: each for each in FIGURES[figure].statements(frame(FIGURES[figure].measure))}
    wrong = {model: judged_by(model, figure) for model in {each.wrong for each in statements.values()} - {""}}
    for name, statement in statements.items():
        expected = APART.get(figure, {}).get(name, Verdict.AGREES)
        assert statement.verdict == expected, name
        assert statement.why or expected == Verdict.AGREES, name
        if (figure, name) in NO_MODEL_AGREES:
            assert (statement.wrong, expected) == ("", Verdict.DISAGREES)
        else:
            opposite = Verdict.AGREES if expected == Verdict.DISAGREES else Verdict.DISAGREES
            assert wrong[statement.wrong][name] == opposite, name


def test_documented_verdicts_are_those_of_the_study():
    findings = STUDY.analyse({table.name: frame(table.measure) for table in STUDY.measurements}, False)
    parts = [part for section in findings.sections for part in section.parts if isinstance(part, Table)]
    tables = {part.results: part.rows for part in parts if part.results}
    for name, columns in {"paper-verdicts": 2, "paper-statements": 3, "paper-corrections": 2}.items():
        shown = read(name)[1].rows
        assert [list(row[:columns]) for row in tables[name]] == [row[:columns] for row in shown]
    assert all(count in findings.answer for _, count in tables["paper-verdicts"])
