"""The study `paper`: the paper's figures, computed with our model, and verdicts on the paper's statements.

There is a module for each of the sections 2 to 5 of the paper. Each module has two functions for each figure:
`figure_05` returns the table of Fig. 5; `_numbers_figure_05` returns the numbers that statements.toml names.
"""

from collections import Counter
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from experiments.lab.charts import SERIES
from experiments.lab.parts import Picture, Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Study
from experiments.studies.paper import beyond, section_2, section_3, section_4, section_5
from experiments.studies.paper.runs import impulses
from experiments.studies.paper.statements import AGREEING, DATA, Basis, Verdict, judged
from impact_gym.render.palette import LIGHT

ABOUT = DATA["figures"]
SCALE = 0.8  # factor on the size of all figures, so that the text is legible in two figures side by side
WIDE = 11.0  # inches, before the factor SCALE; a wider figure is alone in its row of the page
MADE: dict[str, Any] = {
    name: made for module in (section_2, section_3, section_4, section_5, beyond) for name, made in vars(module).items()
}
DEPENDS = (*SOLVER, "experiments.lab.scenes", "experiments.studies.paper.runs")


def _words(row: dict[str, Any]) -> tuple[str, str, str, str]:
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


def draw_curves(frame: pl.DataFrame, axes: Any, curves: str | list[dict[str, Any]], where: dict[str, Any]) -> None:
    """Draw the curves that statements.toml describes, from the rows whose columns have the values in `where`."""
    for curve in DATA["curves"][curves] if isinstance(curves, str) else curves:
        style = {"scale": 1.0, "color": "rule"} | curve
        x, y, scale, colour = (style.pop(name) for name in ("x", "y", "scale", "color"))
        rows = frame.filter(**where, **style.pop("where", {})).sort(x, maintain_order=True)
        shown = [(LIGHT[colour], style.pop("label", None), rows)]
        if by := style.pop("by", None):
            (_, label, _), values = *shown, style.pop("values")
            shown = [
                (each, label and label.format(value), rows.filter(**{by: value}))
                for each, value in zip(SERIES, values, strict=False)
            ]
        for each, label, points in shown:
            axes.plot(scale * points[x], points[y], color=each, label=label, **style)


def picture(name: str, frame: pl.DataFrame) -> Picture:
    """Return the figure `name`, drawn from the table `frame`; statements.toml has its curves, texts and layout."""
    about = DATA["figures"][name]
    figure = Figure(figsize=tuple(SCALE * length for length in about["size"]))
    grid: Any = figure.subplots(**about.get("panels", {}))
    if cases := about.get("impulses"):
        impulses(frame, grid, cases)
    for axes, given in zip(np.ravel(grid), about["axes"], strict=True):
        texts = dict(given)
        draw_curves(frame, axes, texts.pop("curves", []), texts.pop("where", {}))
        for position in texts.pop("marked", []):
            axes.axvline(position, color=LIGHT["flange"], linewidth=0.8, linestyle=":")
        legend = texts.pop("legend", None)
        axes.set(**texts)
        if legend is not None:
            axes.legend(**legend)
    heading = f"{about['heading']}: {about['title']}"
    return Picture(name, figure, about["alternative"], about["caption"], heading, about["size"][0] > WIDE)


def answer(statements: pl.DataFrame) -> str:
    """Return in words how many statements have each verdict."""
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
        Section("What disagrees", [table("Also what depends on the reading or is undecided.", apart)], key="apart"),
        Section("Misprints", [misprints], key="misprints"),
    ]
    for about in DATA["sections"]:
        if names := [name for name in about["figures"] if name in frames]:
            sections.append(
                Section(about["heading"], [picture(name, frames[name]) for name in names], key=about["key"])
            )
            here = statements.filter(pl.col("figure").is_in(names))
            sections.append(Section(f"{len(here)} statements about these figures", [table("", here)], folded=True))
    return Findings(answer(statements), sections, {"statements": statements})


STUDY = Study(
    name="paper",
    question="Does the model agree with the paper?",
    measurements=[  # each figure takes so little time that no other process is started
        Measurement(name, lambda quick, frames: [Cell({}, {})], MADE[name], DEPENDS, processes=0)
        for section in DATA["sections"]
        for name in section["figures"]
    ],
    analyse=analyse,
    packages=("matplotlib",),
)
