"""Write a page as one HTML file, with embedded figures."""

import base64
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from experiments.lab import player
from experiments.lab.parts import HeatMap, Picture, Table
from impact_gym.files import write_file

EXPERIMENTS = Path(__file__).parents[1]
INTERVAL = re.compile(r"\[[^][]*\]")
SYMBOL = re.compile(r"\b([A-Za-z])_([a-z]{1,2}|[A-Z])\b")
POWER = re.compile(r"\^(?:\(([^()]+)\)|(-?\d+(?:\.\d+)?))")


def factor(value: float) -> str:
    """Return a ratio as text with two significant digits; a ratio below 10 has one decimal."""
    return f"{value:.1f}" if value < 10 else f"{float(f'{value:.2g}'):,.0f}"


def typeset(text: str) -> Markup:
    """Return a text as HTML, with subscripts (V_p) and superscripts (N/m^1.5), and without line breaks in intervals."""
    unbroken = INTERVAL.sub(lambda match: match[0].replace(" ", "\N{NO-BREAK SPACE}"), str(escape(text)))
    return Markup(POWER.sub(r"<sup>\1\2</sup>", SYMBOL.sub(r"\1<sub>\2</sub>", unbroken)))


MACROS: Mapping[type, str] = {  # macros of lab/parts.html.jinja, by the type of a section's part
    str: "paragraph", Markup: "markup", Table: "table", HeatMap: "heat_map", Picture: "picture"
}  # fmt: skip


def write(folder: Path, template: str, **content: Any) -> Path:
    """Write `folder`/index.html from a template below experiments/, and return the path of the page.

    The template can use the filter `typeset`, `image(name)` (the content of `folder`/NAME.svg as a URI) and
    `macro_name(part)` (the macro that shows a part of a section). `content` has `runs`, records of `recorded_run`.
    """

    def image(figure: str) -> str:
        return "data:image/svg+xml;base64," + base64.b64encode((folder / f"{figure}.svg").read_bytes()).decode()

    pages = Environment(loader=FileSystemLoader(EXPERIMENTS), autoescape=True, undefined=StrictUndefined)
    pages.filters["typeset"] = typeset
    pages.globals |= {"image": image, "macro_name": lambda part: MACROS[type(part)], "player": player}
    text = pages.get_template(template).render(**content)
    return write_file(folder / "index.html", text.encode(errors="replace"))


def mathtext(text: str) -> str:
    """Return text with subscripts and superscripts for matplotlib; text between dollar signs is not changed."""
    pieces = text.split("$")
    pieces[::2] = [POWER.sub(r"$^{\1\2}$", SYMBOL.sub(r"$\1_{\2}$", piece)) for piece in pieces[::2]]
    return "$".join(pieces)
