"""Refusals: one line that names the field, the value, the unit and what is allowed."""

import math
import re
import warnings
from copy import deepcopy
from decimal import Decimal
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

from impact_gym.support.validation import shown

NO_NUMBERS = None, True, "1", {}, b"1", 1j, object(), np.True_, np.complex128(1.0), Decimal("sNaN")


def refused(call, field, *says):
    """Assert that `call` raises ValueError in one line with the field and these texts; return the error."""
    with pytest.raises(ValueError, match=re.escape(field)) as raised:
        call()
    message = str(raised.value).partition(" was raised from the environment creator")[0]  # the rest is Gymnasium's
    assert "\n" not in message
    assert not [part for part in says if part not in f"{message}\n"], message
    return raised.value


class Allowed(NamedTuple):
    """The numbers that a place takes: `unit` is "whole" for whole numbers, "-" for no unit."""

    unit: str
    above: float = -math.inf
    at_least: float = -math.inf
    at_most: float = math.inf
    none: bool = False

    @classmethod
    def of(cls, text):
        """From the notation of intervals, such as "m (0, 4]", "whole [1, inf) or None"."""
        unit, bracket, low, high, none = re.fullmatch(r"(.+) ([\[(])(\S+), (\S+)[\])]( or None)?", text).groups()
        above, at_least = (-math.inf, float(low)) if bracket == "[" else (float(low), -math.inf)
        return cls(unit, above, at_least, float(high), bool(none))

    def __contains__(self, value):
        return self.above < value <= self.at_most and value >= self.at_least

    @property
    def ends(self):
        """The smallest and the largest number that is allowed, if there is one; in several types."""
        ends = math.nextafter(self.above, math.inf), self.at_least, self.at_most
        ends = [end for end in ends if end in self and abs(end) < 1e300]
        return [*map(int, ends), np.int64(ends[0])] if self.unit == "whole" else ends

    @property
    def beyond(self):
        """The nearest numbers that are not allowed, and others."""
        if self.unit == "whole":
            return [int(self.at_least) - 1, -(10**30), *([int(self.at_most) + 1] if self.at_most < math.inf else [])]
        near = self.above, math.nextafter(self.at_least, -math.inf), math.nextafter(self.at_most, math.inf)
        numbers = [*near, math.nan, math.inf, -math.inf, np.float32("nan"), -1e300, 1e300]
        return [value for value in numbers if not (value in self and math.isfinite(value))]

    def words(self, value=None):
        """The limits in words; for a whole number those that a message says of `value`."""
        limits = {"above": self.above, "at least": self.at_least, "at most": self.at_most}
        if value is not None and self.unit == "whole":
            del limits["at most" if value < self.at_least else "at least"]
        return [f"{word} {limit:g}" for word, limit in limits.items() if math.isfinite(limit)]


def check_number(take, field, allowed, of_file=False, wrong=NO_NUMBERS):
    """`take` accepts both ends of what is allowed; it refuses the nearest beyond, what is not finite, and `wrong`.

    An end may be refused for another reason, such as a relation of two fields. With `of_file`, `take` writes a file.
    """
    whole, unit = allowed.unit == "whole", {"-": "(no unit)", "whole": "whole number"}.get(allowed.unit, allowed.unit)
    names = rf"{re.escape(field)}(\[\d+\])* must (be|hold) "

    def possible(values):
        return [value for value in values if not of_file or type(value) in (bool, int, float, str, dict)]

    for value in possible([*allowed.ends, *[None] * allowed.none]):
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            try:
                take(value)
            except ValueError as error:
                if not [word for word in allowed.words() if word not in str(error)]:
                    raise
    for value in possible(allowed.beyond):
        got = value if whole and value < allowed.at_least else float(value)
        error = refused(partial(take, value), field, *allowed.words(value), unit * (not whole), f"got {got!r}")
        assert re.search(names, str(error)), error
    for value in possible([*wrong[allowed.none :], *[1.5, math.nan] * whole]):
        error = refused(partial(take, value), field, unit, "number", shown(value))
        assert re.search(names, str(error)), error
        assert isinstance(error, TypeError) or of_file or "must be one" in str(error)


def changed(tree, changes):
    """A copy with other values at some dotted paths."""
    tree = deepcopy(tree)
    for path, value in changes.items():
        *outer, last = path.split(".")
        node = tree
        for key in outer:
            node = node[int(key)] if isinstance(node, list) else node.setdefault(key, {})
        node[int(last) if isinstance(node, list) else last] = value
    return tree
