"""The paper's figures, one module each: `compute` makes a table, which goes to disk, and `plot` draws it from there.

A module has, too, a TITLE; ALT, which says what the picture shows to those who cannot see it; and `statements`, which
compares the table with the text of the paper.
"""

import importlib
from pathlib import Path
from types import ModuleType

HERE = Path(__file__).parent
NAMES = tuple(path.stem for kind in ("figure", "beyond", "hidden") for path in sorted(HERE.glob(f"{kind}_*.py")))


def load(name: str) -> ModuleType:
    """Return the module of a figure."""
    return importlib.import_module(f"experiments.paper.{name}")


def resolve(word: str) -> str:
    """Return the name that a word on the command line means: "5", "05", "figure_05", "hidden_values".

    Raises:
        ValueError: there is no such figure; says which there are.
    """
    name = f"figure_{int(word):02}" if word.isdecimal() else word
    if name not in NAMES:
        words = ", ".join(figure.removeprefix("figure_").lstrip("0") for figure in NAMES)
        raise ValueError(f"no figure {word!r}: there are {words}")
    return name


def heading(name: str) -> str:
    """Return the heading of a figure on the page."""
    kind, _, number = name.partition("_")
    return {"figure": f"Fig. {number.lstrip('0')}", "beyond": "Beyond the paper", "hidden": "Not printed"}[kind]
