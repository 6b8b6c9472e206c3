"""The study `paper`: figures, rules for statements, verdicts, and the page; wrong models contradict each statement."""

import html
import re
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from browser_pages import text_of_a_page_that_stands_on_its_own

import impact_gym as ig
from experiments.lab import scenes
from experiments.lab.study import Run as StudyRun
from experiments.lab.study import StudyOptions, frame_of
from experiments.studies.paper import MADE, STUDY, section_4
from experiments.studies.paper.runs import WIDTH
from experiments.studies.paper.statements import AGREEING, SAID, Basis, Said, Verdict, agreeing_digits, judge, judged

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


def with_part(name, change, kind=object):
    """Change the part of this name in every scene where it is of this kind."""

    def changed(scene, motion):
        part = getattr(scene, name)
        return (replace(scene, **{name: change(part)}) if isinstance(part, kind) else scene), motion

    return changed


WRONG_MODELS = {
    "restitution of 0.5": with_part("contact", lambda contact: replace(contact, restitution=0.5)),
    "contact stiffness of 1e4": with_part("contact", lambda contact: replace(contact, stiffness=1e4)),
    "contact ten times as stiff": with_part("contact", lambda law: replace(law, stiffness=10.0 * law.stiffness)),
    "a tenth as stiff": with_part("contact", lambda law: replace(law, stiffness=0.1 * law.stiffness)),
    "no brake": lambda scene, motion: (scene, replace(motion, brake=None)),
    "brake even where the study has none": lambda scene, motion: (scene, replace(motion, brake=scenes.BRAKE)),
    "soft robot": with_part("robot", lambda robot: replace(robot, stiffness=0.1 * robot.stiffness), ig.Robot),
    "half the speed": lambda scene, motion: (scene, replace(motion, speed=0.5 * motion.speed)),
    "heavy tool": with_part("tool", lambda tool: ig.Tool(4.0 * tool.mass)),
    "spring without damper": with_part("coupling", lambda spring: replace(spring, damping_ratio=0.02), ig.SpringDamper),
    "mechanism for a spring": with_part("coupling", lambda _: ig.Bistable(), ig.SpringDamper),
    "spring for a mechanism": with_part("coupling", lambda _: ig.SpringDamper(50.0), ig.Bistable),
}
NO_SIMULATION = {"beyond_contact.equation_7", "figure_12.configuration"}  # judged by laws and data of a robot alone


def judged_names(numbers):
    """The statements about computed figures that are tests and do not only follow from others."""
    tests = {name for name, said in SAID.items() if said.basis == "test" and not said.agree}
    return {name for name in tests if name.partition(".")[0] in numbers}


def agreeing(numbers):
    said = {name: SAID[name] for name in judged_names(numbers)}
    return {name for name, found in zip(said, judged(numbers, said)["verdict"], strict=True) if found in AGREEING}


def test_each_statement_that_agrees_is_contradicted_by_a_wrong_model(frames, monkeypatch):
    """None agrees only because its tolerance is wide. A figure that a model cannot compute contradicts nothing."""
    right, contradicted = {"simulate": ig.simulate, "sweep": ig.sweep}, set()

    def wrong_simulate(change, scene, motion, *rest, **options):
        return right["simulate"](*change(scene, motion), *rest, **options)

    def wrong_sweep(change, scene, motion, varied, *rest, **options):
        varied = dict(varied)
        for name in ("contact.stiffness", "contact.restitution"):
            field = name.removeprefix("contact.")
            values = np.asarray(varied.get(name, np.nan), float)
            cases = [replace(scene, contact=replace(scene.contact, **{field: value})) for value in values.flat]
            wrong = [getattr(change(case, motion)[0].contact, field) for case in cases]
            varied |= {name: np.reshape(wrong, values.shape)} if name in varied else {}
        scene, motion = change(scene, motion)
        if motion.brake is None and "motion.brake.delay" in varied:
            varied["tool.mass"] = np.broadcast_to(scene.tool.mass, np.shape(varied.pop("motion.brake.delay")))
        return right["sweep"](scene, motion, varied, *rest, **options)

    agree = agreeing({name: MADE[f"_numbers_{name}"](frame) for name, frame in frames.items()})
    for change in WRONG_MODELS.values():
        monkeypatch.setattr(ig, "simulate", partial(wrong_simulate, change))
        monkeypatch.setattr(ig, "sweep", partial(wrong_sweep, change))
        numbers = {}
        for table in STUDY.measurements:
            with suppress(LookupError, TypeError, ValueError):
                numbers[table.name] = MADE[f"_numbers_{table.name}"](frame_of([({}, table.measure())]))
        contradicted |= judged_names(numbers) - agreeing(numbers)
    assert agree - contradicted == NO_SIMULATION
