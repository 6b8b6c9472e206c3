"""The study `paper`: computes the paper's figures by our model, and judges what the paper's text says of them.

Each section of the paper has a module. For each figure the module computes a table (figure_02), draws it
(_draw_figure_02), and computes the numbers that statements.toml names (_numbers_figure_02).
"""

from collections import Counter
from typing import Any

import polars as pl

from experiments.lab.parts import Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Study
from experiments.studies.paper import beyond, section_2, section_3, section_4, section_5
from experiments.studies.paper.layouts import picture
from experiments.studies.paper.statements import AGREEING, DATA, Basis, Verdict, judged

ABOUT = DATA["figures"]
MODULES = (section_2, section_3, section_4, section_5, beyond)
MADE: dict[str, Any] = {name: made for module in MODULES for name, made in vars(module).items()}
DEPENDS = (*SOLVER, "experiments.lab.scenes", "experiments.studies.paper.runs")


def _words(row: dict[str, Any]) -> tuple[str, str, str, str]:
    """Return a row of a page's table: statement, verdict with the agreeing digits, our result, rule and reason."""
    place = f"section {row['section']}" + f", {ABOUT[row['figure']]['heading']}" * row["figure"].startswith("figure")
    digits = "" if row["digits"] is None else f", {row['digits']} digit{'s' * (row['digits'] != 1)}"
    basis = f" ({row['basis']})" * (row["basis"] != Basis.TEST)
    printed = f"printed {row['printed']} {row['unit']}, ours " if row["printed"] else ""
    source = f"Source: {row['source']}." if row["source"] else ""
    judgement = " ".join(filter(None, (f"Rule: {row['rule']}.", row["otherwise"], row["why"], source)))
    ours = f"{printed}{row['ours']} {row['unit']}".rstrip()
    return f"{row['text']} ({place})", f"{row['verdict']}{digits}{basis}", ours, judgement


def table(caption: str, statements: pl.DataFrame) -> Table:
    """Return a table of statements."""
    head = ("What the text says", "Verdict", "Our result", "Rule and reason")
    return Table(caption, head, [_words(row) for row in statements.iter_rows(named=True)])


def answer(statements: pl.DataFrame) -> str:
    """Return the number of statements with each verdict, in words."""
    bases = Counter(Basis(basis).name for basis in statements["basis"])
    tests = Counter(Verdict(verdict).name for verdict in statements.filter(basis=Basis.TEST)["verdict"])
    agree, others = sum(tests[verdict.name] for verdict in AGREEING), len(statements) - bases["TEST"]
    return str(DATA["answer"].format(all=len(statements), others=others, agree=agree, bases=bases, tests=tests))


def analyse(frames: Frames, quick: bool) -> Findings:
    """Judge the statements about all figures that were computed; show figures and statements."""
    statements = judged({name: MADE[f"_numbers_{name}"](frame) for name, frame in frames.items()})
    apart = statements.filter(~pl.col("verdict").is_in(AGREEING))
    misprints = Table.of("", DATA["misprints"], {"Where": "{place}", "What is wrong with it": "{correction}"})
    sections = [
        Section("What disagrees", [table("Or depends on the reading, or cannot be decided.", apart)], key="apart"),
        Section("Misprints", [misprints], key="misprints"),
    ]
    for about in DATA["sections"]:
        if names := [name for name in about["figures"] if name in frames]:
            pictures = [picture(name, MADE[f"_draw_{name}"], frames[name]) for name in names]
            sections.append(Section(about["heading"], pictures, key=about["key"]))
            here = statements.filter(pl.col("figure").is_in(names))
            sections.append(Section(f"{len(here)} statements about these figures", [table("", here)], folded=True))
    return Findings(answer(statements), sections, {"statements": statements})


STUDY = Study(
    name="paper",
    question="Does the model agree with the paper?",
    measurements=[  # a table of one cell for each figure, so fast that it runs in this process
        Measurement(name, lambda quick, frames: [Cell({}, {})], MADE[name], DEPENDS, processes=0)
        for section in DATA["sections"]
        for name in section["figures"]
    ],
    analyse=analyse,
    packages=("matplotlib",),
)
