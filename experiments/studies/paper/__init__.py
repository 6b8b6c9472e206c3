"""The study `paper`: the figures of the paper drawn anew, and what its text says about them, judged one by one.

A module for each section of the paper: of a figure it computes the table, draws it, and reads off it the numbers that
statements.toml names.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from itertools import groupby

import polars as pl

from experiments.lab.parts import Picture, Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Study
from experiments.studies.paper import beyond, section_2_1, section_2_2, section_3, section_4_curves, section_4_runs
from experiments.studies.paper import section_5 as bistable
from experiments.studies.paper.layouts import SCALE
from experiments.studies.paper.statements import AGREEING, DATA, Basis, Statement, Verdict, judged

MODULES = (section_2_1, section_2_2, section_3, section_4_curves, section_4_runs, bistable, beyond)
MADE = {name: figure for module in MODULES for name, figure in module.FIGURES.items()}
ABOUT = DATA["figures"]
DEPENDS = (*SOLVER, "impact_gym.sweeps", "experiments.lab.scenes", "experiments.studies.paper.runs")
WIDE = 11 * SCALE  # inches; a wider figure stands alone in its row


def measurement(name: str) -> Measurement:
    """Return the table of a figure: one cell, whose rows are all of it."""
    return Measurement(name, lambda quick, frames: [Cell({}, {})], MADE[name].measure, DEPENDS)


def picture(name: str, frame: pl.DataFrame) -> Picture:
    """Return a figure drawn from its table."""
    about, figure = ABOUT[name], MADE[name].plot(frame)
    heading = f"{about['heading']}: {about['title']}"
    return Picture(name, figure, about["alternative"], about["caption"], heading, figure.get_figwidth() > WIDE)


def _verdict(statement: Statement) -> str:
    """Return the verdict in words, with the digits to which we agree and what it is if no test."""
    digits = "" if statement.digits is None else f", {statement.digits} digit{'s' * (statement.digits != 1)}"
    return f"{statement.verdict}{digits}" + f" ({statement.basis})" * (statement.basis != Basis.TEST)


def table(caption: str, statements: Sequence[Statement]) -> Table:
    """Return a table of statements."""
    rows = []
    for each in statements:
        printed = f"printed {each.printed} {each.unit}, ours " if each.printed else ""
        ours = f"{printed}{each.ours} {each.unit}".rstrip()
        judgement = " ".join(filter(None, (each.otherwise, each.why)))
        rows.append((f"{each.text} (section {each.section})", ours, _verdict(each), f"Rule: {each.rule}. {judgement}"))
    return Table(caption, ("What the text says", "What we find", "Verdict", "By which rule, and why"), rows)


def answer(statements: Sequence[Statement]) -> str:
    """Return the counts in words."""
    bases = Counter(statement.basis for statement in statements)
    tests = Counter(statement.verdict for statement in statements if statement.basis == Basis.TEST)
    return (
        f"Of {len(statements)} statements of the paper's text {bases[Basis.TEST]} are tests: "
        f"{tests[Verdict.DIGITS] + tests[Verdict.AGREES]} agree, {tests[Verdict.ONE_READING]} agree in one of two "
        f"readings, {tests[Verdict.DISAGREES]} disagree, and {tests[Verdict.UNDECIDED]} cannot be decided. The other "
        f"{len(statements) - bases[Basis.TEST]} could not have come out otherwise: {bases[Basis.IDENTIFIED]} were used to "
        f"identify values that the paper does not print, or follow from them, {bases[Basis.GIVEN]} are identities, scale "
        f"laws or inputs, and {bases[Basis.REPEATED]} repeat another one."
    )


def analyse(frames: Frames, quick: bool) -> Findings:
    """Judge the statements about all figures that were made, and show both."""
    statements = judged({name: MADE[name].numbers(frame) for name, frame in frames.items()})
    by_figure = {name: list(group) for name, group in groupby(statements, lambda each: each.figure)}
    apart = [each for each in statements if each.verdict not in AGREEING]
    misprints = [(misprint["place"], misprint["correction"]) for misprint in DATA["misprints"]]
    sections = [
        Section(
            "What disagrees",
            [table("What disagrees, depends on the reading, or cannot be decided.", apart)],
            key="apart",
        ),
        Section("Misprints", [Table("", ("Where", "What is wrong with it"), misprints)], key="misprints"),
    ]
    for about in DATA["sections"]:
        names = [name for name in about["figures"] if name in frames]
        if names:
            sections.append(
                Section(about["heading"], [picture(name, frames[name]) for name in names], key=about["key"])
            )
            tables = [table(f"{ABOUT[name]['heading']}: {ABOUT[name]['title']}", by_figure[name]) for name in names]
            count = sum(len(each.rows) for each in tables)
            sections.append(Section(f"{count} statements about these figures", tables, folded=True))
    rows = pl.DataFrame([asdict(each) for each in statements], infer_schema_length=None)
    return Findings(answer(statements), sections, {"statements": rows})


STUDY = Study(
    name="paper",
    question="Does the model do what the paper says?",
    measurements=[measurement(name) for section in DATA["sections"] for name in section["figures"]],
    analyse=analyse,
    packages=("matplotlib",),
)
