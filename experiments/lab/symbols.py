"""Symbols and powers as plain text has them, V_p and N/m^1.5, set for HTML and for matplotlib."""

import re

SYMBOL = re.compile(r"\b([A-Za-z])_([a-z]{1,2}|[A-Z])\b")
POWER = re.compile(r"\^(?:\(([^()]+)\)|(-?\d+(?:\.\d+)?))")


def html(text: str) -> str:
    """Return escaped text with subscripts and superscripts as elements."""
    return POWER.sub(r"<sup>\1\2</sup>", SYMBOL.sub(r"\1<sub>\2</sub>", text))


def mathtext(text: str) -> str:
    """Return text with subscripts and superscripts between dollars; what stands between dollars stays as it is."""
    pieces = text.split("$")
    pieces[::2] = [POWER.sub(r"$^{\1\2}$", SYMBOL.sub(r"$\1_{\2}$", piece)) for piece in pieces[::2]]
    return "$".join(pieces)
