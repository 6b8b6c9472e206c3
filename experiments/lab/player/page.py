"""The part of a page in which films run: HTML with their data, and the style and the script of all films of a page."""

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps

HERE = Path(__file__).parent
SCRIPTS = ("svg.js", "chain.js", "loupe.js", "strips.js", "player.js")


def fragment(films: dict[str, Any], name: str = "watch") -> str:
    """Return a section of a page for what `films` returned; `name` is its id, one of its own for each on a page.

    The page needs `style` before the first of them and `script` behind the last. Nothing comes from outside.
    """
    pages = Environment(loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined)
    content = htmlsafe_json_dumps(films, separators=(",", ":"), allow_nan=False)
    return pages.get_template("player.html.jinja").render(
        name=name, content=content, late=any("late" in run for scene in films["scenes"] for run in scene["runs"])
    )


def style() -> str:
    """Return the CSS; it takes the colours --bg, --fg, --muted, --grid, --paper, --learned, --accent of the page."""
    return (HERE / "player.css").read_text()


def script(*more: Path) -> str:
    """Return the program; it defines nothing global but the element <slow-motion>.

    Files with `more` of it draw with the same functions.
    """
    parts = "\n".join(part.read_text() for part in (*(HERE / name for name in SCRIPTS), *more))
    return f'(() => {{\n"use strict";\n{parts}\n}})();'
