"""Read columns of numbers from CSV files that various programs write, such as logs of blows and of packet delays.

`read_columns` finds encoding, separator, decimal sign, the first line of numbers, and the columns' names and units.
"""

import codecs
import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from functools import partial
from itertools import compress, islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_gym.support.column_names import SCALES, Column, Meaning, meaning_of, mentions_units, scale_of
from impact_gym.support.files import parsed
from impact_gym.support.validation import shown

SEPARATORS = ("\t", ";", ",", "|", None)  # between fields; None: one or more blanks or tabs
STAMP = r"(\d{4}[-/]\d\d[-/]\d\d[T ])?\d\d?:\d\d:\d\d([.,]\d+)?(Z|[+-]\d\d:?\d\d)?"  # of ISO 8601, or a clock time
NUMBERS = {
    sign: re.compile(rf"[+-]?((\d+([{sign}]\d*)?|[{sign}]\d+)(e[+-]?\d+)?|nan|inf(inity)?)|({STAMP})", re.IGNORECASE)
    for sign in ".,"
}
DATES = r"\d(:|[./-]\d+[./-]|T)\d"  # of any form
GAPS = {
    "", "-", "--", "*", "?", "na", "n/a", "#n/a", "n.a.", "null", "none", "lost", "timeout", "1.#qnan", "-1.#ind",
}  # fmt: skip
"""Fields, in lower case, that stand for a missing value, as nan does."""
COMMENTS = ("#", "%", "//")
MOST_NAMED = 20  # headers in a message
FIRST_LINES, FIRST_CHARACTERS = 500, 100_000  # the beginning of a file, which is read to find its layout


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

    Dates and clock times become seconds since the first of them. A line without a value is left out, see `Column`.

    Raises:
        ValueError: `parsed` refuses the file, a column is missing or ambiguous, a unit is unknown or missing, a value
            is not a number, or the first of `unnamed` does not rise. The message names the file and the line.
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
    values, stamped = _numbers(rows, layout, {name: place for name, (place, _) in sources.items()})
    for name in stamped:
        if name != unnamed[0] or sources[name][1] not in (None, 1.0):
            raise ValueError(f"{name} must be numbers, got dates or clock times, as {unnamed[0]} without a unit may be")
    needed = [n for n, name in enumerate(sources) if not wanted[name].may_be_empty]
    if (gaps := np.asarray(np.isnan(values[:, needed]).any(axis=1))).any():
        values, rows = values[~gaps], dict(compress(rows.items(), (~gaps).tolist()))
        if not rows:
            raise ValueError(f"no line has a value of each of {', '.join(sources)}")
    numbers_of = dict(zip(sources, values.T, strict=True))

    def written(k: int, name: str) -> str:
        return shown(_split([*rows.values()][k], layout.separator)[sources[name][0]])

    for name, column in numbers_of.items():
        lost, unit = wanted[name].may_be_empty, wanted[name].unit  # lost: inf is a loss, too
        for k in np.flatnonzero(column < 0.0 if lost else np.isinf(column)).tolist():
            allowed = f"at least 0 {unit}, or empty if there is none" if lost else f"finite {unit}"
            raise ValueError(f"line {[*rows][k]}: {name} must be {allowed}, got {written(k, name)}")
    for k in np.flatnonzero(np.diff(numbers_of[unnamed[0]]) <= 0.0).tolist():
        at, (before, after) = [*rows][k : k + 2], (written(k + more, unnamed[0]) for more in (0, 1))
        raise ValueError(f"line {at[1]}: {unnamed[0]} must rise, got {after} after {before} in line {at[0]}")
    columns = {name: numbers_of[name] * (scale or 1.0) for name, (_, scale) in sources.items()}
    said = ", ".join(
        f"{name} ({wanted[name].unit}) from {shown(heads[place]) if heads[place] else f'column {place + 1}'}"
        + ("" if scale else " without a unit" if name not in stamped else " as dates or times")
        for name, (place, scale) in sources.items()
    )
    rest = [shown(head) for place, head in enumerate(heads) if place not in dict(sources.values())]
    said += f"; not used: {', '.join(rest[:MOST_NAMED])}" if rest else ""
    return columns, said + (f"; lines left out, as they lack a value: {gaps.sum()}" if gaps.any() else "")


def _numbers(
    rows: Mapping[int, str], layout: _Layout, places: Mapping[str, int]
) -> tuple[NDArray[np.float64], set[str]]:
    """Return the numbers (lines, columns), nan for none, and the names of the columns with dates or clock times.

    `rows`: lines by line number; `places`: the field index of each column.
    """
    if layout.decimal == "." and not any('"' in line for line in rows.values()):
        with suppress(ValueError):  # if NumPy refuses a line, such as one with an empty field, use the loop below
            columns = [*places.values()]
            return np.loadtxt(rows.values(), comments=None, delimiter=layout.separator, usecols=columns, ndmin=2), set()
    table, first = [], dict[str, int]()
    for k, line in rows.items():
        row, values = _split(line, layout.separator), list[float]()
        if max(places.values()) >= len(row):
            raise ValueError(f"line {k} must have at least {layout.least} values, got {shown(line)}")
        for name, place in places.items():
            field = row[place]
            if not NUMBERS[layout.decimal].fullmatch(field):
                if field.lower() not in GAPS:
                    raise ValueError(f"line {k}: {name} must be a number, got {shown(field)}")
                field = "nan"
            if ":" in field:
                stamp = _nanoseconds(field.replace(",", "."), k, name)
                values.append((stamp - first.setdefault(name, stamp)) * 1e-9)
            elif name in first and field != "nan":
                raise ValueError(f"line {k}: {name} must be a date or time as before, got {shown(field)}")
            else:
                values.append(float(field.replace(",", ".")))
        table.append(values)
    return np.array(table), {*first}


def _nanoseconds(stamp: str, line: int, name: str) -> int:
    """Return the time of a STAMP in ns, since 1970 or midnight."""
    groups = re.fullmatch(r"([^.]*?)(\.\d+)?(Z|[+-]\d\d:?\d\d)?", stamp.replace("/", "-")).groups()  # type: ignore[union-attr]
    moment, fraction, zone = groups
    try:
        time = datetime.fromisoformat(("" if "-" in moment else "1970-01-01T") + moment.rjust(8, "0") + (zone or "Z"))
    except ValueError:
        raise ValueError(f"line {line}: {name} must be a date and a time that exist, got {shown(stamp)}") from None
    return round(time.timestamp()) * 10**9 + round(float(fraction or 0.0) * 1e9)


def _split(line: str, separator: str | None) -> list[str]:
    if separator is None or '"' not in line:
        return [field.strip() for field in line.split(separator)]
    return [field.strip() for field in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]


def _layout(lines: Sequence[str]) -> _Layout:
    best, most = None, 0.0
    for separator in SEPARATORS:
        rows = [[] if line.lstrip().startswith(COMMENTS) else _split(line, separator) for line in lines]
        rows = [["" if field.lower() in GAPS else field for field in row] for row in rows]
        for decimal, number in NUMBERS.items():
            places = [tuple(k for k, field in enumerate(row) if number.fullmatch(field)) for row in rows]
            shares = [len(found) / sum(map(bool, row)) for row, found in zip(rows, places, strict=True) if found[1:]]
            if sum(shares) > most:
                usual = Counter(found for found in places if found[1:]).most_common(1)[0][0]
                first = next(k for k, row in enumerate(rows) if places[k] and len(row) > usual[-1]
                             and not any(row[place] for place in {*usual}.difference(places[k])))  # fmt: skip
                best = _Layout(separator, decimal, first, usual[-1] + 1, len(rows[first]))
                most = sum(shares)
    if best is None:
        written = next((line for line in reversed(lines) if line.strip()), "")
        reason = f"no line has two numbers (first {len(lines)} lines read); the last line with text is {shown(written)}"
        raise ValueError(reason + _date_hint(written) if written else "it is empty")
    return best


def _date_hint(line: str) -> str:
    return "; dates must be written as 2024-05-01T12:00:00.5 or 12:00:00.5" if re.search(DATES, line) else ""


def _sources(
    lines: Sequence[str], layout: _Layout, wanted: Mapping[str, Column], unnamed: Sequence[str]
) -> tuple[_Sources, list[str]]:
    """Return index and unit factor of each wanted column found, and the names of all columns ("" if unnamed)."""
    allowed = ", ".join(f"{name} ({column.unit})" for name, column in wanted.items())
    heads, units, between = _names(lines, layout, wanted)
    if heads and between:
        raise ValueError(f"line {between[0] + 1} must have units or numbers, got {shown(lines[between[0]])}")
    above = lines[between[0]] if between and not heads else ""
    words, dates = _split(above, layout.separator), "" if layout.separator else _date_hint(lines[layout.first])
    known = layout.separator or len(words) == layout.least or any(meaning_of(w, wanted).name for w in words)
    if (len(words) > 1 and known) or mentions_units(above, wanted):
        raise ValueError(f"line {between[0] + 1} must name the {layout.least} or more columns below it, "
                         f"with known names ({allowed}), got {shown(above)}"
                         + (dates or ": are commas also decimal signs?" * (layout.separator == ",")))  # fmt: skip
    if not heads and layout.least != len(unnamed):
        raise ValueError(f"{layout.least} columns must have names (known: {allowed}), got none" + dates)
    meanings = [meaning_of(head, wanted) for head in heads] or [Meaning(name) for name in unnamed]
    sources: _Sources = {}
    for name, column in wanted.items():
        meant = {place: meaning for place, meaning in enumerate(meanings) if meaning.name == name}
        plain = [place for place, meaning in meant.items() if not meaning.statistic]
        exact = [place for place in plain if meant[place].exact]
        chosen = exact if len(exact) == 1 else plain
        if meant and len(chosen) != 1:
            note = "" if plain else ": a unit such as min must be in brackets, and a statistic is not read"
            raise ValueError(f"{name} must be one column, got {_listed(heads[place] for place in meant)}{note}")
        for place in chosen:
            head = heads[place] if heads else ""
            unit = meant[place].unit or ("".join(units[place : place + 1])).strip("-[](){}<> ")
            scale = scale_of(column.unit, unit) if unit else None
            if (unit and scale is None) or (column.needs_unit and not unit):
                units_allowed = ", ".join(SCALES[column.unit])
                raise ValueError(f"{name}, {shown(head)}: unit must be one of {units_allowed}, got {shown(unit)}")
            sources[name] = place, scale
    if unnamed[0] not in sources or len(sources) < 2:
        raise ValueError(f"it must have {unnamed[0]} and one more of {allowed}, got {_listed(heads)}")
    return sources, heads or [""] * layout.least


def _listed(names: Iterable[str]) -> str:
    return ", ".join(shown(name) for name in islice(names, MOST_NAMED))


def _names(
    lines: Sequence[str], layout: _Layout, wanted: Mapping[str, Column]
) -> tuple[list[str], list[str], list[int]]:
    """Return the columns' names and units, and the indices of the text lines between names and numbers."""
    units: list[str] = []
    between: list[int] = []
    for k in reversed(range(layout.first)):
        line = re.sub(rf"^(\s|{'|'.join(COMMENTS)})+", "", lines[k])
        for heads in _heads(line, layout):
            named = [bool(meaning_of(head, wanted).name) for head in heads]
            if len(heads) > layout.most and (sum(named) < 2 or any(named[layout.most :])):
                continue  # more names than values, as in LabVIEW's files, but not of these values
            if any(named):
                return heads, units, between
            bare = [head.strip("-[](){}<> ") for head in heads]
            are_units = all(any(scale_of(unit, head) for unit in SCALES) for head in bare if head)
            if not between and not units and any(heads) and are_units:
                units = heads
                break
        else:
            between += [k] if line and not lines[k].lstrip().startswith(COMMENTS) else []
    return [], units, between


def _heads(line: str, layout: _Layout) -> Iterator[list[str]]:
    rows = [_split(line, separator) for separator in (layout.separator, *SEPARATORS) if separator]
    rows += [re.split(pattern, line.strip()) for pattern in (r"\s{2,}", r"\s+(?![\[({</])")]
    for place, row in enumerate(rows):
        while row and not row[-1]:
            row.pop()
        if layout.least <= len(row) and (len(row) <= layout.most or place == 0 or layout.separator is None):
            yield row
