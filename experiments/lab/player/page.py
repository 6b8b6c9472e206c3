"""The part of the page in which the films run: HTML, style and script in one string, with all that they need."""

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps

HERE = Path(__file__).parent
SCRIPTS = ("svg.js", "chain.js", "loupe.js", "strips.js", "player.js")


def fragment(films: dict[str, Any], name: str = "watch") -> str:
    """Return a section of a page for what `films` returned; `name` is its id, one of its own for each on a page.

    It needs nothing from outside, defines nothing global, and takes the colours --bg, --fg, --muted, --grid, --paper,
    --learned, --accent of the page where the page has them.
    """
    pages = Environment(loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined)
    return pages.get_template("player.html.jinja").render(
        name=name,
        content=htmlsafe_json_dumps(films, separators=(",", ":"), allow_nan=False),
        style=(HERE / "player.css").read_text(),
        script="\n".join((HERE / script).read_text() for script in SCRIPTS),
    )
