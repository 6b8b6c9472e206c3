"""Slow-motion films that show contestants side by side in the same scenario."""

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps

from experiments.lab import colours
from experiments.lab.player.films import choose, films

__all__ = ["choose", "films", "fragment", "script", "style"]
HERE = Path(__file__).parent
SCRIPTS = ("svg.js", "chain.js", "magnifier.js", "strips.js", "player.js")


def fragment(films: dict[str, Any], name: str = "watch") -> str:
    """Return HTML with the id `name` that shows `films`; the page also needs the results of `style` and `script`."""
    pages = Environment(loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined)
    content = htmlsafe_json_dumps(films, separators=(",", ":"), allow_nan=False)
    return pages.get_template("player.html.jinja").render(
        name=name, content=content, late=any("late" in run for scene in films["scenes"] for run in scene["runs"])
    )


def style() -> str:
    """Return the CSS of the player and of the palette."""
    return f"{colours.css()}\n{(HERE / 'player.css').read_text()}"


def script(*more: Path) -> str:
    """Return the JavaScript of the player and of the files `more`, which can call the player's functions."""
    parts = "\n".join(part.read_text() for part in (*(HERE / name for name in SCRIPTS), *more))
    return f'(() => {{\n"use strict";\n{parts}\n}})();'
