"""The study `paper`: the figures of the paper drawn anew, and what its text says about them, judged one by one.

A module for each section of the paper: of a figure it computes the table, draws it, and reads off it the numbers that
statements.toml names.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict

import polars as pl

from experiments.lab.parts import Picture, Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Study
from experiments.studies.paper import beyond, section_2, section_3, section_4, section_5
from experiments.studies.paper.layouts import WIDE, drawn
from experiments.studies.paper.statements import AGREEING, DATA, Basis, Statement, judged

MODULES = (section_2, section_3, section_4, section_5, beyond)
MADE = {name: figure for module in MODULES for name, figure in module.FIGURES.items()}
ABOUT = DATA["figures"]
DEPENDS = (*SOLVER, "impact_gym.sweeps", "experiments.lab.scenes", "experiments.studies.paper.runs")


def measurement(name: str) -> Measurement:
    """Return the table of a figure: one cell, whose rows are all of it; that fast that a process is not worth while."""
    return Measurement(name, lambda quick, frames: [Cell({}, {})], MADE[name].measure, DEPENDS, processes=0)


def picture(name: str, frame: pl.DataFrame) -> Picture:
    """Return a figure drawn from its table."""
    about = ABOUT[name]
    figure, heading = drawn(about, MADE[name].draw, frame), f"{about['heading']}: {about['title']}"
    return Picture(name, figure, about["alternative"], about["caption"], heading, about["size"][0] > WIDE)


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
        place = f"section {each.section}" + f", {ABOUT[each.figure]['heading']}" * each.figure.startswith("figure")
        source = f"Source: {each.source}." if each.source else ""
        judgement = " ".join(filter(None, (f"Rule: {each.rule}.", each.otherwise, each.why, source)))
        rows.append((f"{each.text} ({place})", _verdict(each), ours, judgement))
    return Table(caption, ("What the text says", "Verdict", "What we find", "By which rule, and why"), rows)


def answer(statements: Sequence[Statement]) -> str:
    """Return the counts in words."""
    bases = Counter(statement.basis.name for statement in statements)
    tests = Counter(statement.verdict.name for statement in statements if statement.basis is Basis.TEST)
    agree, others = sum(tests[verdict.name] for verdict in AGREEING), len(statements) - bases["TEST"]
    return str(DATA["answer"].format(all=len(statements), others=others, agree=agree, bases=bases, tests=tests))


def analyse(frames: Frames, quick: bool) -> Findings:
    """Judge the statements about all figures that were made, and show both."""
    statements = judged({name: MADE[name].numbers(frame) for name, frame in frames.items()})
    apart = [each for each in statements if each.verdict not in AGREEING]
    misprints = [(misprint["place"], misprint["correction"]) for misprint in DATA["misprints"]]
    sections = [
        Section("What disagrees", [table("Or depends on the reading, or cannot be decided.", apart)], key="apart"),
        Section("Misprints", [Table("", ("Where", "What is wrong with it"), misprints)], key="misprints"),
    ]
    for about in DATA["sections"]:
        if names := [name for name in about["figures"] if name in frames]:
            pictures = [picture(name, frames[name]) for name in names]
            here = [each for each in statements if each.figure in names]
            sections.append(Section(about["heading"], pictures, key=about["key"]))
            sections.append(Section(f"{len(here)} statements about these figures", [table("", here)], folded=True))
    rows = pl.DataFrame([asdict(each) for each in statements], infer_schema_length=None)
    return Findings(answer(statements), sections, {"statements": rows})


STUDY = Study(
    name="paper",
    question="Does the model do what the paper says?",
    measurements=[measurement(name) for section in DATA["sections"] for name in section["figures"]],
    analyse=analyse,
    packages=("matplotlib",),
)
