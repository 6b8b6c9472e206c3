"""Which figures there are. Each is a module with TITLE, ALT, `compute`, `plot` and `statements`, found by its name."""

import importlib
from pathlib import Path
from typing import Protocol, cast

from matplotlib.figure import Figure

from experiments.paper.statements import Statement
from experiments.paper.tables import Table

HERE = Path(__file__).parent
NAMES = tuple(path.stem for kind in ("figure", "beyond") for path in sorted(HERE.glob(f"{kind}_*.py")))


class Module(Protocol):
    """What a figure's module has."""

    TITLE: str
    ALT: str  # what the picture shows, for those who cannot see it
    __doc__: str | None

    def compute(self) -> Table:
        """Simulate; the table goes to disk."""
        ...

    def plot(self, table: Table) -> Figure:
        """Draw the table read back from disk."""
        ...

    def statements(self, table: Table) -> tuple[Statement, ...]:
        """Compare the table with what the paper says."""
        ...


def load(name: str) -> Module:
    """Return the module of a figure."""
    return cast(Module, importlib.import_module(f"experiments.paper.{name}"))


def resolve(word: str) -> str:
    """Return the name that a word on the command line means: "5", "05", "figure_05", "beyond_speed".

    Raises:
        ValueError: there is no such figure; says which there are.
    """
    name = f"figure_{int(word):02}" if word.isdecimal() else word
    if name not in NAMES:
        words = ", ".join(known.removeprefix("figure_").lstrip("0") for known in NAMES)
        raise ValueError(f"no figure {word!r}: there are {words}")
    return name


def heading(name: str) -> str:
    """Return what a figure is called on the page."""
    kind, _, rest = name.partition("_")
    return f"Fig. {int(rest)}" if kind == "figure" else "Beyond the paper"
