"""Read names and units in the headers of columns."""

import re
from collections.abc import Mapping
from typing import NamedTuple

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
AS_SUFFIX = r"(.+?)(?:[\s_,:-]|\bin\b)+([^\s_]+)"
UNIT_FORMS = (*IN_BRACKETS, r"(.+)()", AS_SUFFIX)
"""Patterns of headers such as Force (N), force/N, force, force_N; in the first two, an unknown unit is an error."""
PRESENT = 5e8, 5e9  # s since 1970, limits of the dates that `unit_hint` assumes
LONGEST_NAME = 80  # characters; a longer header is unknown, so that the patterns above take no time
STATISTICS = re.compile(
    r"(min|max)(imum)?|mean|av(g|erage)|med(ian)?|std|(st|std|m)dev|sd|var(iance)?|rms|sum|count|peak|second"
    r"|[pq]\d+|\d+(th|%|p)?", re.IGNORECASE
)  # fmt: skip
"""Last words of headers, such as latency_min, that say what a column holds; in such a place, min is not minutes."""
OTHER_UNITS = {"s": re.compile("h|hrs?|hours?|m|mins|d|days?", re.IGNORECASE)}
"""Last words of headers, such as time_h, that are units without a factor in SCALES."""


class Column(NamedTuple):
    """A column to look for in a file."""

    unit: str  # SI unit, a key of SCALES
    names: str  # regular expression that matches the column's name in lower case, with a blank between words
    needs_unit: bool = False  # True: the file must state the unit, because several units are common
    may_be_empty: bool = False  # True: none is negative, a missing one becomes nan; False: its line is left out


class Meaning(NamedTuple):
    """What a header says."""

    name: str = ""  # the wanted column; "": none
    unit: str = ""  # as written
    exact: bool = False  # whether the header without its unit is `name`
    statistic: bool = False  # whether `unit` is one of STATISTICS


def meaning_of(head: str, wanted: Mapping[str, Column]) -> Meaning:
    """Return what a header says; a `Meaning` without a name if the header is unknown."""
    for form in UNIT_FORMS if len(head) <= LONGEST_NAME else ():
        if parts := re.fullmatch(form, head):
            plain, unit = _plain(parts[1]), parts[2]
            name = next((name for name in wanted if re.fullmatch(wanted[name].names, plain)), None)
            exact = name is not None and plain == name.replace("_", " ")
            in_words = re.search(r"[\])}>]\s*$|\bin\W+\w+$", head)
            if name and unit and STATISTICS.fullmatch(unit) and not in_words:
                return Meaning(name, unit, statistic=True)
            known = name and (scale_of(of := wanted[name].unit, unit) or re.fullmatch(OTHER_UNITS.get(of, "$"), unit))
            if name and (form in IN_BRACKETS or not unit or known):
                return Meaning(name, unit, exact)
    return Meaning()


def mentions_units(text: str, wanted: Mapping[str, Column]) -> bool:
    """Return whether the beginning of a text names two wanted columns and a unit of one that is no SI unit."""
    text = text[:LONGEST_NAME]
    named = [column for column in wanted.values() if re.search(rf"\b({column.names})\b", _plain(text))]
    scales = {scale_of(column.unit, word) for column in named for word in re.findall(r"[^\W_]+", text)}
    return len(named) > 1 and bool(scales - {None, 1.0})


def _plain(name: str) -> str:
    return re.sub(r"[\W_]+", " ", name).strip().lower()


def scale_of(unit: str, written: str) -> float | None:
    """Return the factor from a `written` unit to the SI `unit`; None if the written unit is unknown."""
    short = re.sub(r"[\s*\u00b7.]", "", written).replace("\u00b2", "2").replace("\u207b", "-").replace("\u00b9", "1")
    short = re.sub(r"(?<=s)\^?(-?\d)$", r"^\1", short)
    return SCALES[unit].get(short if short[:1] == "M" and len(short) < 4 else short.lower())


def unit_hint(step: float, longest: float, shortest: float = 1e-6, begin: float = 0.0) -> str:
    """Ask whether a unit was meant in which `begin` is a present date, else `step` in (`shortest`, `longest`], s."""
    factors = {unit: SCALES["s"][unit] for unit in ("ms", "us", "ns")}
    dated = [unit for unit, factor in factors.items() if PRESENT[0] < begin * factor < PRESENT[1]]
    fitting = dated or [unit for unit, factor in factors.items() if shortest < step * factor <= longest]
    return f": is it in {' or '.join(fitting)}?" if fitting else ""
