"""What the paper says, what we find, and a verdict computed from the two by a stated rule.

A printed number is agreed with to n digits if ours is within half a unit of its n-th significant digit. Where the text
says 'about', one unit of the last printed digit is allowed. A trend or a comparison comes with a rule of its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from decimal import Decimal
from enum import StrEnum

import numpy as np


class Verdict(StrEnum):
    """Result of a comparison."""

    DIGITS = "agrees to the printed digits"
    AGREES = "agrees"
    ONE_READING = "agrees in one of two readings"
    DISAGREES = "disagrees"
    UNDECIDED = "cannot be decided"


class Basis(StrEnum):
    """What stands behind a verdict: only a TEST could have come out otherwise."""

    TEST = "test"
    IDENTIFIED = "used to identify"  # a value that the paper does not print was chosen such that this comes true
    GIVEN = "identity, scale law or input"  # an equation evaluated, an input read back, true of any numbers
    REPEATED = "repeats another statement"  # follows from another statement of the list


@dataclass(frozen=True, slots=True)
class Statement:
    """One thing that the paper says about a figure."""

    section: str
    text: str  # a short quotation, or what the passage says
    printed: str | None  # as printed; None for a trend
    ours: str
    unit: str  # of a printed number
    verdict: Verdict
    rule: str  # by which the verdict was computed
    digits: int | None = None  # significant digits to which we agree; None for a trend
    why: str = ""  # where we disagree, or where there is something to know
    basis: Basis = Basis.TEST
    otherwise: str = ""  # outcome under another reading of the text

    def read_as(self, reading: str, holds: bool | np.bool_, ours: str) -> "Statement":
        """Judge the same statement by another `reading` of the text too; it stays one statement."""
        second = Verdict.AGREES if holds else Verdict.DISAGREES
        differ = holds == (self.verdict == Verdict.DISAGREES)
        verdict = Verdict.ONE_READING if differ else self.verdict
        return replace(self, verdict=verdict, otherwise=f"Another reading, {reading}: {ours} ({second}).")


Statements = Iterator[Statement]


def agreeing_digits(printed: str, ours: float) -> tuple[int, int]:
    """Return to how many significant digits `ours` agrees with `printed`, and how many are printed."""
    value = Decimal(printed)  # "5e1" is 50 with one significant digit
    count = len(value.as_tuple().digits)
    error = abs(Decimal(ours) - value)
    half_units = [Decimal(5).scaleb(value.adjusted() - n) for n in range(1, count + 1)]
    return sum(error <= half_unit for half_unit in half_units), count


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the paper, and the ways to judge what it says: `section.claim(...)`, `section.given.claim(...)`."""

    name: str
    basis: Basis = Basis.TEST

    @property
    def identified(self) -> "Section":
        """The section, for statements used to identify a value that the paper does not print."""
        return replace(self, basis=Basis.IDENTIFIED)

    @property
    def given(self) -> "Section":
        """The section, for statements that are true by construction."""
        return replace(self, basis=Basis.GIVEN)

    @property
    def repeated(self) -> "Section":
        """The section, for statements that follow from others."""
        return replace(self, basis=Basis.REPEATED)

    def number(self, text: str, printed: str, ours: float, why: str = "") -> Statement:
        """Judge a number that is `printed` with its unit ("0.98 m/s"), approximate if the text says 'about'."""
        value, _, unit = printed.partition(" ")
        digits, count = agreeing_digits(value, ours)
        last_unit = Decimal(1).scaleb(int(Decimal(value).as_tuple().exponent))
        rule = f"within half a unit of the last printed digit ({last_unit / 2})"
        verdict = Verdict.DIGITS if digits == count else Verdict.DISAGREES
        if "about" in text and verdict is Verdict.DISAGREES:
            rule = f"printed as approximate: within one unit of the last printed digit ({last_unit})"
            verdict = Verdict.AGREES if abs(Decimal(ours) - Decimal(value)) <= last_unit else Verdict.DISAGREES
        plain = f"{Decimal(value):f}"
        return Statement(self.name, text, plain, f"{ours:.5g}", unit, verdict, rule, digits, why, self.basis)

    def claim(self, text: str, holds: bool | np.bool_, ours: str, rule: str, why: str = "") -> Statement:
        """Judge a trend or a comparison: `holds` is the outcome of `rule`."""
        verdict = Verdict.AGREES if holds else Verdict.DISAGREES
        return Statement(self.name, text, None, ours, "", verdict, rule, why=why, basis=self.basis)

    def undecided(self, text: str, ours: str, why: str) -> Statement:
        """Note what the text alone does not suffice to judge, and why."""
        return Statement(self.name, text, None, ours, "", Verdict.UNDECIDED, "none", why=why, basis=self.basis)


section_1, section_2_1, section_2_2, section_3 = map(Section, ("1", "2.1", "2.2", "3.1-3.2"))
section_3_1, section_3_2, section_4_1, section_4_2 = map(Section, ("3.1", "3.2", "4.1", "4.2"))
section_5, section_6 = map(Section, ("5", "6"))
