"""Statements of the paper, and the verdicts on them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import polars as pl

from experiments.lab.parts import Picture
from experiments.lab.study import Rows


class Verdict(StrEnum):
    """Result of a comparison."""

    AGREES = "agrees"
    ONE_READING = "agrees in one of two readings"
    DISAGREES = "disagrees"


class Reading(NamedTuple):
    """A second reading of a statement: the text read so, whether it holds, and our result."""

    text: str
    holds: bool
    ours: str


@dataclass(frozen=True)
class Statement:
    """A statement of the paper, judged by our numbers."""

    name: str
    place: str  # section and figure
    text: str  # quotation or summary of the passage
    rule: str  # `holds`, in words
    holds: bool
    ours: str  # our result
    wrong: str = ""  # a wrong model (`models.WRONG`) that contradicts it or, if our model does, agrees; "": none agrees
    why: str = ""  # why the statement disagrees, or a remark
    reading: Reading | None = None

    @property
    def verdict(self) -> Verdict:
        """Verdict on the statement."""
        if self.reading and self.reading.holds != self.holds:
            return Verdict.ONE_READING
        return Verdict.AGREES if self.holds else Verdict.DISAGREES


@dataclass(frozen=True)
class Figure:
    """A figure: the function that computes its table for a model, statements about it, and its picture."""

    measure: Callable[..., Rows]  # its only argument is a `models.Model`, by default the paper's
    statements: Callable[[pl.DataFrame], Iterator[Statement]]
    picture: Callable[[pl.DataFrame, str], Picture] | None = None  # from the table and its name

    @property
    def name(self) -> str:
        """Name of the figure's table."""
        return self.measure.__name__
