"""Statements of the paper, and the verdicts on them."""

import tomllib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl

from experiments.lab.parts import Picture
from experiments.lab.study import Rows

TEXTS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))


class Verdict(StrEnum):
    """Result of a comparison."""

    AGREES = "agrees"
    ONE_READING = "agrees in one of two readings"
    DISAGREES = "disagrees"


class Finding(NamedTuple):
    """What our numbers say about a statement of statements.toml."""

    name: str
    holds: Any  # whether the rule holds
    ours: str  # our result
    reading: tuple[Any, str] | None = None  # of a second reading: whether it holds, and our result
    why: Iterable[float] = ()  # numbers in the text `why`


@dataclass(frozen=True)
class Statement:
    """A statement of the paper, judged by our numbers; the texts are those of statements.toml."""

    finding: Finding
    where: str
    text: str
    rule: str
    another: str = ""
    wrong: str = ""
    why: str = ""

    @property
    def verdict(self) -> Verdict:
        """Verdict on the statement."""
        _, holds, _, reading, _ = self.finding
        if reading and reading[0] != holds:
            return Verdict.ONE_READING
        return Verdict.AGREES if holds else Verdict.DISAGREES

    @property
    def judgement(self) -> str:
        """Rule and reason, and what is found in the second reading."""
        text = f"Rule: {self.rule}. {self.why.format(*self.finding.why)}"
        if self.finding.reading is None:
            return text
        holds, ours = self.finding.reading
        return f"{text} Another reading, {self.another}: {'holds' if holds else 'does not hold'}; {ours}."


@dataclass(frozen=True)
class Figure:
    """A figure: the function that computes its table for a model, findings about it, and its picture."""

    measure: Callable[..., Rows]  # its only argument is a `runs.Model`, by default the paper's
    findings: Callable[[pl.DataFrame], Iterator[Finding]]
    picture: Callable[[pl.DataFrame, str], Picture] | None = None  # from the table and its name

    @property
    def name(self) -> str:
        """Name of the figure's table."""
        return self.measure.__name__

    def statements(self, frame: pl.DataFrame) -> Iterator[Statement]:
        """Judge the figure's statements by its table."""
        for finding in self.findings(frame):
            yield Statement(finding, **TEXTS[self.name][finding.name])
