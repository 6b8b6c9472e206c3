"""Verdicts on statements of the paper, by comparison with our results. The file statements.toml has the statements.

Our number agrees with a printed number to n digits if the difference is at most half a unit of the n-th significant
digit. If the text says 'about', a difference of one unit of the last printed digit is allowed.
"""

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from enum import StrEnum
from pathlib import Path
from string import Formatter
from typing import Any

import numpy as np
import polars as pl

from experiments.studies.paper.runs import Numbers

DATA: dict[str, Any] = tomllib.loads(Path(__file__).with_name("statements.toml").read_text())
SIGNS = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal, "==": np.equal}


class Verdict(StrEnum):
    """Result of a comparison."""

    DIGITS = "agrees to the printed digits"
    AGREES = "agrees"
    ONE_READING = "agrees in one of two readings"
    DISAGREES = "disagrees"
    UNDECIDED = "cannot be decided"


AGREEING = (Verdict.DIGITS, Verdict.AGREES)


class Basis(StrEnum):
    """Basis of a verdict. Only a TEST compares the paper with an independent result."""

    TEST = "test"
    IDENTIFIED = "used to identify"  # we chose a value that the paper does not print, so that the statement is true
    GIVEN = "identity, scale law or input"  # follows from equations and the paper's masses, or is an input of the model
    REPEATED = "repeats another statement"  # the statement follows from another one


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """A statement of the paper about a figure, as in statements.toml."""

    text: str  # quotation or summary of the passage
    section: str
    basis: str = "test"  # name of a Basis
    printed: str | None = None  # a number with its unit, "0.98 m/s"; None for a trend
    value: str = ""  # name of our number, which is compared with `printed`
    holds: tuple[str, ...] = ()  # conditions of a trend
    agree: tuple[str, ...] = ()  # FIGURE.KEY of statements that must agree; used instead of `holds`
    rule: str = "none"  # conditions of a trend, in words
    ours: str = ""  # format string of our result
    why: str = ""  # format string: the reason for a disagreement, or a remark
    source: str = ""  # source of numbers that this study does not compute
    reading: Mapping[str, Any] = field(default_factory=dict)  # a second reading: `text`, `holds` and `ours`


SAID = {  # statements by FIGURE.KEY
    f"{figure}.{key}": Said(**said)
    for figure, about in DATA["figures"].items()
    for key, said in about["statements"].items()
}


def agreeing_digits(printed: str, ours: float) -> tuple[int, int]:
    """Return to how many significant digits `ours` agrees with `printed`, and how many `printed` has."""
    value = Decimal(printed)  # "5e1" is 50 with one significant digit
    count = len(value.as_tuple().digits)
    error = abs(Decimal(ours) - value)
    half_units = [Decimal(5).scaleb(value.adjusted() - n) for n in range(1, count + 1)]
    return sum(error <= half_unit for half_unit in half_units), count


def number(name: str, numbers: Numbers) -> Any:
    """Return the number with a name as in a format string, such as "a.impulse" or "ends[0]"."""
    return Formatter().get_field(name, (), numbers)[0]


def holding(conditions: Iterable[str], numbers: Numbers) -> Verdict:
    """Return AGREES if all conditions such as "ratio >= 1.8" hold (of an array: all elements), else DISAGREES."""
    outcomes = []
    for name, sign, bound in map(str.split, conditions):
        limit = float(bound) if re.match(r"-?\d|inf$", bound) else number(bound, numbers)
        outcomes.append(np.all(SIGNS[sign](number(name, numbers), limit)))
    return Verdict.AGREES if all(outcomes) else Verdict.DISAGREES


def compared(said: Said, ours: float) -> tuple[Verdict, str, int]:
    """Return the verdict on a printed number, the rule in words, and the number of agreeing digits."""
    value = str(said.printed).partition(" ")[0]
    digits, count = agreeing_digits(value, ours)
    last_unit = Decimal(1).scaleb(int(Decimal(value).as_tuple().exponent))
    if digits == count or "about" not in said.text:
        verdict = Verdict.DIGITS if digits == count else Verdict.DISAGREES
        return verdict, f"within half a unit of the last printed digit ({last_unit / 2})", digits
    verdict = Verdict.AGREES if abs(Decimal(ours) - Decimal(value)) <= last_unit else Verdict.DISAGREES
    return verdict, f"printed as approximate: within one unit of the last printed digit ({last_unit})", digits


def judge(figure: str, said: Said, numbers: Numbers, others_agree: bool = True) -> dict[str, Any]:
    """Return the row of a statement about a figure; `others_agree`: whether all statements in `said.agree` agree."""
    printed, unit, digits, rule, ours = None, "", None, said.rule, said.ours.format(**numbers)
    verdict = holding(said.holds, numbers) if others_agree else Verdict.DISAGREES
    if said.printed:
        text, _, unit = said.printed.partition(" ")
        value = number(said.value, numbers)
        printed, ours = f"{Decimal(text):f}", f"{value:.5g}"
        verdict, rule, digits = compared(said, value)
    elif not (said.holds or said.agree):
        verdict = Verdict.UNDECIDED
    otherwise = ""
    if reading := said.reading:
        second = holding(reading["holds"], numbers)
        otherwise = f"Another reading, {reading['text']}: {reading['ours'].format(**numbers)} ({second})."
        if (second is Verdict.DISAGREES) != (verdict is Verdict.DISAGREES):
            verdict = Verdict.ONE_READING
    return {
        "figure": figure, "section": said.section, "text": said.text, "printed": printed, "ours": ours, "unit": unit,
        "verdict": verdict, "rule": rule, "digits": digits, "why": said.why.format(**numbers),
        "basis": Basis[said.basis.upper()], "otherwise": otherwise, "source": said.source,
    }  # fmt: skip


def judged(numbers: Mapping[str, Numbers], statements: Mapping[str, Said] = SAID) -> pl.DataFrame:
    """Return the row of `judge` for each statement that refers only to figures in `numbers`."""
    found = dict[str, dict[str, Any]]()
    for name, said in sorted(statements.items(), key=lambda item: bool(item[1].agree)):  # statements with `agree` last
        figure = name.partition(".")[0]
        if figure in numbers and all(other in found for other in said.agree):
            others_agree = all(found[other]["verdict"] in AGREEING for other in said.agree)
            found[name] = judge(figure, said, numbers[figure], others_agree)
    return pl.DataFrame([found[name] for name in statements if name in found], infer_schema_length=None)
