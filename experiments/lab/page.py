"""Write a page as one HTML file, with embedded figures."""

import base64
import re
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from experiments.lab import charts, player
from experiments.lab.charts import POWER, SYMBOL
from experiments.lab.parts import Picture
from impact_gym.support.files import write_file

EXPERIMENTS = Path(__file__).parents[1]
INTERVAL = re.compile(r"\[[^][]*\]")


def factor(value: float) -> str:
    """Return a ratio as text: one decimal below 10, else two significant digits."""
    return f"{value:.1f}" if value < 10 else f"{float(f'{value:.2g}'):,.0f}"


def typeset(text: str) -> Markup:
    """Return a text as HTML, with subscripts (V_p) and superscripts (N/m^1.5), and without line breaks in intervals."""
    unbroken = INTERVAL.sub(lambda match: match[0].replace(" ", "\N{NO-BREAK SPACE}"), str(escape(text)))
    return Markup(POWER.sub(r"<sup>\1\2</sup>", SYMBOL.sub(r"\1<sub>\2</sub>", unbroken)))


def write(folder: Path, **content: Any) -> Path:
    """Write `folder`/index.html, and return the path of the page.

    The template lab/page.html.jinja uses `content` by its names, filter `typeset` and module `player`.
    `image(picture)` writes `folder`/NAME.svg and returns a URI.
    """

    def image(picture: Picture) -> str:
        file = charts.save(picture.figure, folder / f"{picture.name}.svg")
        return "data:image/svg+xml;base64," + base64.b64encode(file.read_bytes()).decode()

    pages = Environment(loader=FileSystemLoader(EXPERIMENTS), autoescape=True, undefined=StrictUndefined)
    pages.filters["typeset"] = typeset
    pages.globals |= {"image": image, "player": player}
    text = pages.get_template("lab/page.html.jinja").render(**content)
    return write_file(folder / "index.html", text.encode(errors="replace"))
