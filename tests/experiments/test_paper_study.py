"""The study `paper`: rules for statements, verdicts and their counts; wrong models contradict each statement."""

import re
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

import impact_gym as ig
from experiments.lab import scenes
from experiments.lab.study import frame_of
from experiments.studies.paper import MADE, STUDY
from experiments.studies.paper.statements import AGREEING, SAID, Basis, Said, Verdict, judge, judged

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


@pytest.fixture(scope="module")
def frames():
    return {table.name: frame_of([({}, table.measure())]) for table in STUDY.measurements}


@pytest.fixture(scope="module")
def findings(frames):
    return STUDY.analyse(frames, False)


def test_about_allows_one_unit_of_the_last_digit():
    for ours, text, verdict in (
        (0.9786, "is 0.98", Verdict.DIGITS), (0.9786, "is about 0.98", Verdict.DIGITS),
        (0.972, "is 0.98", Verdict.DISAGREES), (0.972, "is about 0.98", Verdict.AGREES),
        (0.968, "is about 0.98", Verdict.DISAGREES),
    ):  # fmt: skip
        said = Said(text=f"the velocity {text}", section="1", basis="identified", printed="0.98 m/s", value="v")
        statement = judge("figure", said, {"v": ours})
        assert [statement[name] for name in ("verdict", "basis", "unit")] == [verdict, Basis.IDENTIFIED, "m/s"]


def test_all_statements_but_the_listed_agree_or_have_reasons(findings):
    found = {verdict: [] for verdict in Verdict}
    for (name, said), row in zip(SAID.items(), findings.tables["statements"].iter_rows(named=True), strict=True):
        found[row["verdict"]].append(name)
        kinds = [said.printed is not None, bool(said.holds), bool(said.agree), said.rule == "none" and not said.printed]
        assert sum(kinds) == 1, name
        assert row["ours"], name
        assert row["why"] or row["verdict"] in (Verdict.DIGITS, Verdict.AGREES), name
        assert row["otherwise"] or row["verdict"] != Verdict.ONE_READING, name
    for verdict, listed in APART.items():
        assert found[verdict] == [*listed]
    assert {verdict for verdict, names in found.items() if names} <= {*AGREEING, *APART, Verdict.UNDECIDED}


def test_answer_and_documentation_have_the_counts(findings):
    statements = findings.tables["statements"]
    bases, verdicts = Counter(statements["basis"]), Counter(statements.filter(basis=Basis.TEST)["verdict"])
    tests = [sum(verdicts[verdict] for verdict in (Verdict.DIGITS, Verdict.AGREES))]
    tests += [verdicts[verdict] for verdict in (Verdict.ONE_READING, Verdict.DISAGREES, Verdict.UNDECIDED)]
    no_tests = [bases[basis] for basis in (Basis.IDENTIFIED, Basis.GIVEN, Basis.REPEATED)]
    paper = (Path(__file__).parents[2] / "docs/provenance.md").read_text()
    assert f"compares {len(statements)} statements" in paper
    rows = " ".join(re.findall(r"^\| .+ \| \d+ \|$", paper, re.MULTILINE))
    assert [int(number) for number in re.findall(r"\d+", rows)] == [*tests, *no_tests, sum(no_tests)]
    counts = [len(statements), sum(tests), *tests, sum(no_tests), *no_tests]
    assert [int(number) for number in re.findall(r"\d+", findings.answer)] == counts


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
BEYOND = {name for name in MADE if name.startswith("beyond_")}  # made by `sweep`, whose scenes have arrays
LONG = {"figure_06", "figure_07", "figure_16", "figure_18"}


def agreeing(numbers, verdicts=AGREEING):
    """The statements with these verdicts that are tests of computed figures and do not only follow from others."""
    tests = {name: said for name, said in SAID.items() if said.basis == "test" and not said.agree}
    said = {name: each for name, each in tests.items() if name.partition(".")[0] in numbers}
    return {name for name, found in zip(said, judged(numbers, said)["verdict"], strict=True) if found in verdicts}


@pytest.mark.parametrize("left_out", [BEYOND | LONG, pytest.param(BEYOND, marks=pytest.mark.slow)])
def test_a_wrong_model_contradicts_each_statement(frames, monkeypatch, left_out):
    """None agrees only because its tolerance is wide. A figure that a model cannot compute contradicts nothing."""
    tables = {table.name: table for table in STUDY.measurements if table.name not in left_out}
    agree = agreeing({name: MADE[f"_numbers_{name}"](frames[name]) for name in tables})
    simulate, contradicted = ig.simulate, set()
    for change in WRONG_MODELS.values():

        def wrong(scene, motion, *rest, change=change, **options):
            return simulate(*change(scene, motion), *rest, **options)

        monkeypatch.setattr(ig, "simulate", wrong)
        numbers = {}
        for name, table in tables.items():
            with suppress(LookupError, TypeError, ValueError):
                numbers[name] = MADE[f"_numbers_{name}"](frame_of([({}, table.measure())]))
        contradicted |= agreeing(numbers, {*Verdict} - {*AGREEING})
    assert agree - contradicted == {"figure_12.configuration"}  # judged by data of a robot alone
