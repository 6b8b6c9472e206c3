"""The study `paper`: the paper's figures, computed with our model, and verdicts on the paper's statements.

There is a module for the sections 2 and 3 of the paper, one for 4 and 5, and one for claims that no figure shows. For
each figure a module has a function that computes its table, one that judges the statements about it, and one that draws
it if it is in the paper. statements.toml has the texts of the statements. The functions that compute take a model;
`runs.WRONG` has wrong models, which contradict the statements.
"""

from collections.abc import Sequence

import polars as pl

from experiments.lab.parts import Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Study
from experiments.studies.paper import beyond, compliant_tool, fixed_tool, values
from experiments.studies.paper.statements import Verdict

FIGURES = {figure.name: figure for module in (fixed_tool, compliant_tool, beyond) for figure in module.FIGURES}
DEPENDS = (*SOLVER, "experiments.lab.scenes", "experiments.studies.paper.runs", "experiments.studies.paper.statements")


def analyse(frames: Frames, quick: bool) -> Findings:
    """Judge the statements about all figures that were computed; show figures and statements."""
    here = [figure for name, figure in FIGURES.items() if name in frames]
    statements = [statement for figure in here for statement in figure.statements(frames[figure.name])]
    pictures = [figure.picture(frames[figure.name], figure.name) for figure in here if figure.picture]
    whole = len(frames) == len(STUDY.measurements)  # the documentation shows only tables of all statements

    def table(caption: str, head: str, rows: Sequence[Sequence[str]], results: str) -> Table:
        return Table(caption, head.split("|"), rows, results if whole else "")

    apart = [[each for each in statements if each.verdict == verdict] for verdict in Verdict]
    agree, one_reading, disagree = map(len, apart)
    counts = [(name, str(len(those))) for name, those in (("all", statements), *zip(Verdict, apart, strict=True))]
    disagreements = [(each.where, each.text, each.finding.ours) for each in apart[-1]]
    every = [(each.text, each.where, each.verdict, each.finding.ours, each.wrong or "-", each.judgement)
             for each in statements]  # fmt: skip
    sections = [
        Section("Verdicts", [
            table("Number of statements.", "Verdict|Statements", counts, "paper-verdicts"),
            table("Statements that disagree. The last table has the reasons.", "Where|The paper says|Our model",
                  disagreements, "paper-disagreements"),
        ], key="verdicts"),
        Section("Figures", pictures, key="figures"),
        Section("Identified values", [
            table("Values that the paper does not print.", "Quantity|Value|Determined by|Ours",
                  frames.get("identified", pl.DataFrame()).rows(), "paper-identified"),
        ], key="identified"),
        Section("Corrections", [
            table("Corrections of the print.", "Where|Correction", values.corrections(), "paper-corrections"),
        ], key="corrections"),
        Section("All statements, and wrong models with the opposite verdict", [
            table("All statements.", "Statement|Where|Verdict|Our result|Wrong model|Rule and reason", every,
                  "paper-statements"),
        ], key="statements", folded=True),
    ]  # fmt: skip
    answer = (
        f"Of {len(statements)} statements of the paper's text that our model can contradict, {agree} agree, "
        f"{one_reading} agree in one of two readings, and {disagree} disagree."
    )
    return Findings(answer, sections)


STUDY = Study(
    name="paper",
    question="Does the model agree with the paper?",
    measurements=[  # each figure takes so little time that no other process is started
        Measurement(measure.__name__, lambda quick, frames: [Cell({}, {})], measure, DEPENDS, processes=0)
        for measure in [*(figure.measure for figure in FIGURES.values()), values.identified]
    ],
    analyse=analyse,
    packages=("matplotlib", "mujoco"),
)
