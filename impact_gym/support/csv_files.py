"""Read columns of numbers from CSV files that various programs write, such as logs of blows and of packet delays.

`read_columns` finds encoding, separator, decimal sign, the first line of numbers, and the columns' names and units.
"""

import codecs
import csv
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_gym.support.files import parsed
from impact_gym.support.validation import shown

SCALES: Mapping[str, Mapping[str, float]] = {
    unit: {alias: factor for factor, aliases in scales.items() for alias in aliases.split()}
    for unit, scales in {
        "s": {1.0: "s sec secs second seconds", 1e-3: "ms msec msecs millisecond milliseconds", 60.0: "min minutes",
              1e-6: "us \u00b5s \u03bcs usec microsecond microseconds", 1e-9: "ns nsec nanosecond nanoseconds"},
        "N": {1.0: "n newton newtons", 1e-3: "mn", 1e3: "kn", 10.0: "dan", 9.80665: "kgf kp", 4.4482216152605: "lbf"},
        "m/s": {1.0: "m/s ms^-1", 1e-3: "mm/s", 1e-2: "cm/s", 1.0 / 3.6: "km/h", 0.0254: "in/s", 0.3048: "ft/s"},
        "m/s^2": {1.0: "m/s^2 m/s/s ms^-2", 1e-3: "mm/s^2", 1e-2: "cm/s^2", 9.80665: "g gn g0", 9.80665e-3: "mg"},
    }.items()
}  # fmt: skip
"""For each SI unit: accepted units in lower case, with their factors to the SI unit."""
IN_BRACKETS = (r"(.+?)[\s_]*[\[({<]([^\[({<]*)[\])}>]\s*", r"([^/]+?)\s*/\s*\(?(.+?)\)?")
UNIT_FORMS = (*IN_BRACKETS, r"(.+)()", r"(.+?)(?:[\s_,:-]|\bin\b)+([^\s_]+)")
"""Patterns of headers such as Force (N), force/N, force, force_N; in the first two, an unknown unit is an error."""
SEPARATORS = ("\t", ";", ",", "|", None)  # between fields; None: one or more blanks or tabs
NUMBERS = {
    sign: re.compile(rf"[+-]?((\d+[{sign}]?\d*|[{sign}]\d+)(e[+-]?\d+)?|nan|inf(inity)?)", re.IGNORECASE)
    for sign in ".,"
}
COMMENTS = ("#", "%", "//")
FIRST_LINES, FIRST_CHARACTERS = 500, 100_000  # the beginning of a file, which is read to find its layout


class Column(NamedTuple):
    """A column to look for in a file."""

    unit: str  # SI unit, a key of SCALES
    names: str  # regular expression that matches the column's name in lower case, with a blank between words
    needs_unit: bool = False  # True: the file must state the unit, because several units are common
    may_be_empty: bool = False  # True: an empty field becomes nan; False: an empty field is refused


Table = tuple[dict[str, NDArray[np.float64]], str]
"""The columns, each (n,), in SI units; and a text that names the file's used and unused columns."""


class _Layout(NamedTuple):
    separator: str | None
    decimal: str
    first: int  # index of the first line of numbers
    least: int  # number of fields up to the last column of numbers
    most: int  # number of fields in the first line of numbers


_Sources = dict[str, tuple[int, float | None]]
"""For each column found, its index in the file and the factor from its unit to SI (None: no unit is stated)."""


def read_columns(path: Path, wanted: Mapping[str, Column], unnamed: Sequence[str]) -> Table:
    """Return a `Table` with the `wanted` columns that a CSV file contains.

    Args:
        path: a regular file in UTF-8, Latin-1, or UTF-16 with a byte order mark.
        wanted: the columns to look for, by name.
        unnamed: names of the columns, in order, if the file has no names. Every file must have the first of these
            columns and at least one other wanted column.

    Raises:
        ValueError: `parsed` refuses the file, a column is missing or ambiguous, a unit is unknown or missing, or a
            value is not a number. The message names the file, and the line of a wrong value.
    """
    return parsed(path, "CSV", partial(_table, wanted=wanted, unnamed=unnamed), _decoded)


def _decoded(content: bytes) -> str:
    marked = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = content.decode("utf-16" if marked else "utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if strange := re.search(r"[\x00-\x08\x0e-\x1f]", text):
        raise ValueError(f"line {text.count(chr(10), 0, strange.start()) + 1} must be text, got {strange[0]!r}")
    return text


def _table(text: str, wanted: Mapping[str, Column], unnamed: Sequence[str]) -> Table:
    lines = text[:FIRST_CHARACTERS].split("\n")[:FIRST_LINES]
    layout = _layout(lines)
    sources, heads = _sources(lines, layout, wanted, unnamed)
    rows = {
        k: line for k, line in enumerate(text.split("\n")[layout.first :], layout.first + 1)
        if line.strip() and not line.lstrip().startswith(COMMENTS)
    }  # fmt: skip
    values = _numbers(rows, layout, {name: place for name, (place, _) in sources.items()}, wanted)
    columns = {name: values[:, n] * (scale or 1.0) for n, (name, (_, scale)) in enumerate(sources.items())}
    said = ", ".join(
        f"{name} ({wanted[name].unit}) from {shown(heads[place]) if heads[place] else f'column {place + 1}'}"
        + ("" if scale else " without a unit")
        for name, (place, scale) in sources.items()
    )
    rest = [shown(head) for place, head in enumerate(heads) if place not in dict(sources.values())]
    return columns, f"{said}; not used: {', '.join(rest)}" if rest else said


def _numbers(
    rows: Mapping[int, str], layout: _Layout, places: Mapping[str, int], wanted: Mapping[str, Column]
) -> NDArray[np.float64]:
    """Return the numbers (lines, columns). `rows`: lines by line number; `places`: the field index of each column."""
    if layout.decimal == "." and not any('"' in line for line in rows.values()):
        with suppress(ValueError):  # if NumPy refuses a line, such as one with an empty field, use the loop below
            return np.loadtxt(
                rows.values(), comments=None, delimiter=layout.separator, usecols=[*places.values()], ndmin=2
            )
    table = []
    for k, line in rows.items():
        row = _split(line, layout.separator)
        if max(places.values()) >= len(row):
            raise ValueError(f"line {k} must have at least {layout.least} values, got {shown(line)}")
        for name, place in places.items():
            if not NUMBERS[layout.decimal].fullmatch(row[place]) and (row[place] or not wanted[name].may_be_empty):
                raise ValueError(f"line {k}: {name} must be a number, got {shown(row[place])}")
        table.append([float(row[place].replace(",", ".") or "nan") for place in places.values()])
    return np.array(table)


def _split(line: str, separator: str | None) -> list[str]:
    if separator is None or '"' not in line:
        return [field.strip() for field in line.split(separator)]
    return [field.strip() for field in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]


def _layout(lines: Sequence[str]) -> _Layout:
    best, most = None, 0.0
    for separator in SEPARATORS:
        rows = [[] if line.lstrip().startswith(COMMENTS) else _split(line, separator) for line in lines]
        for decimal, number in NUMBERS.items():
            places = [tuple(k for k, field in enumerate(row) if number.fullmatch(field)) for row in rows]
            shares = [len(found) / sum(map(bool, row)) for row, found in zip(rows, places, strict=True) if found[1:]]
            if sum(shares) > most:
                usual = Counter(found for found in places if found[1:]).most_common(1)[0][0]
                first = next(k for k, row in enumerate(rows) if places[k] and len(row) > usual[-1]
                             and all(place in places[k] or not row[place] for place in usual))  # fmt: skip
                best = _Layout(separator, decimal, first, usual[-1] + 1, len(rows[first]))
                most = sum(shares)
    if best is None:
        written = next((line for line in reversed(lines) if line.strip()), "")
        reason = f"no line has two numbers (first {len(lines)} lines read); the last line with text is {shown(written)}"
        raise ValueError(reason if written else "it is empty")
    return best


def _sources(
    lines: Sequence[str], layout: _Layout, wanted: Mapping[str, Column], unnamed: Sequence[str]
) -> tuple[_Sources, list[str]]:
    """Return index and unit factor of each wanted column found, and the names of all columns ("" if unnamed)."""
    allowed = ", ".join(f"{name} ({column.unit})" for name, column in wanted.items())
    heads, units, between = _names(lines, layout, wanted)
    if heads and between:
        raise ValueError(f"line {between[0] + 1} must have units or numbers, got {shown(lines[between[0]])}")
    words = _split(lines[between[0]], layout.separator) if between and not heads else []
    if len(words) > 1 and (layout.separator or len(words) == layout.least or any(_meaning(w, wanted) for w in words)):
        raise ValueError(f"line {between[0] + 1} must name the {layout.least} or more columns below it, "
                         f"with known names ({allowed}), got {shown(lines[between[0]])}"
                         + ": are commas also decimal signs?" * (layout.separator == ","))  # fmt: skip
    if not heads and layout.least != len(unnamed):
        raise ValueError(f"{layout.least} columns must have names (known: {allowed}), got none")
    meanings = [_meaning(head, wanted) or ("", "") for head in heads] or [(name, "") for name in unnamed]
    sources: _Sources = {}
    for name, column in wanted.items():
        meant = [(place, meaning[1]) for place, meaning in enumerate(meanings) if meaning[0] == name]
        same = [each for each in meant if heads and _plain(heads[each[0]]) == name.replace("_", " ")]
        if len(meant) > 1 and len(same) != 1:
            raise ValueError(f"{name} must be one column, got {', '.join(shown(heads[place]) for place, _ in meant)}")
        for place, unit in (same or meant)[:1]:
            head = heads[place] if heads else ""
            unit = unit or ("".join(units[place : place + 1])).strip("-[](){}<> ")
            scale = _scale(column.unit, unit) if unit else None
            if (unit and scale is None) or (column.needs_unit and not unit):
                units_allowed = ", ".join(SCALES[column.unit])
                raise ValueError(f"{name}, {shown(head)}: unit must be one of {units_allowed}, got {shown(unit)}")
            sources[name] = place, scale
    if unnamed[0] not in sources or len(sources) < 2:
        raise ValueError(f"it must have {unnamed[0]} and one more of {allowed}, got {', '.join(map(shown, heads))}")
    return sources, heads or [""] * layout.least


def _names(
    lines: Sequence[str], layout: _Layout, wanted: Mapping[str, Column]
) -> tuple[list[str], list[str], list[int]]:
    """Return the columns' names and units, and the indices of the text lines between names and numbers."""
    units: list[str] = []
    between: list[int] = []
    for k in reversed(range(layout.first)):
        line = re.sub(rf"^(\s|{'|'.join(COMMENTS)})+", "", lines[k])
        for heads in _heads(line, layout):
            if any(_meaning(head, wanted) for head in heads):
                return heads, units, between
            bare = [head.strip("-[](){}<> ") for head in heads]
            are_units = all(any(_scale(unit, head) for unit in SCALES) for head in bare if head)
            if not between and not units and any(heads) and are_units:
                units = heads
                break
        else:
            between += [k] if line and not lines[k].lstrip().startswith(COMMENTS) else []
    return [], units, between


def _heads(line: str, layout: _Layout) -> Iterator[list[str]]:
    rows = [_split(line, separator) for separator in (layout.separator, *SEPARATORS) if separator]
    rows += [re.split(pattern, line.strip()) for pattern in (r"\s{2,}", r"\s+(?![\[({</])")]
    for row in rows:
        while row and not row[-1]:
            row.pop()
        if layout.least <= len(row) <= layout.most:
            yield row


def _plain(name: str) -> str:
    return re.sub(r"[\W_]+", " ", name).strip().lower()


def _meaning(head: str, wanted: Mapping[str, Column]) -> tuple[str, str] | None:
    """Return the wanted column that a header names, and the header's unit or ""; None: the header is unknown."""
    for form in UNIT_FORMS:
        if parts := re.fullmatch(form, head):
            name = next((name for name in wanted if re.fullmatch(wanted[name].names, _plain(parts[1]))), None)
            if name and (form in IN_BRACKETS or not parts[2] or _scale(wanted[name].unit, parts[2])):
                return name, parts[2]
    return None


def _scale(unit: str, written: str) -> float | None:
    """Return the factor from a `written` unit to the SI `unit`; None if the written unit is unknown."""
    short = re.sub(r"[\s*\u00b7.]", "", written).replace("\u00b2", "2").replace("\u207b", "-").replace("\u00b9", "1")
    short = re.sub(r"(?<=s)\^?(-?\d)$", r"^\1", short)
    return SCALES[unit].get(short if short[:1] == "M" and len(short) < 4 else short.lower())
