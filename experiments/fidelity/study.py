"""The whole study: rows, constants, tables, page."""

import json
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from rich.console import Console
from rich.table import Table

from experiments.fidelity import costs, tables
from experiments.fidelity.calibration import QUANTILE, calibrate
from experiments.fidelity.population import Kind
from experiments.fidelity.truth import Row, advised, collect, rows
from experiments.results import circumstances
from impact_gym import fidelity
from impact_gym.fidelity import prediction
from impact_gym.files import whole_file

CALIBRATION, TEST = 1, 8  # purposes of populations; 2 to 7 were looked at while the groups were chosen, or by tests
HERE = Path(__file__).parent
DECIDING = [*Path(fidelity.__file__).parent.glob("*.py"), HERE / "population.py", HERE / "truth.py"]
"""The sources on which rows depend; results of other sources are left aside."""


@dataclass(frozen=True)
class Extent:
    """How many scenes, and searches."""

    plausible: int  # to calibrate on
    limits: int  # towards the limits, to calibrate on
    test: int  # plausible, to test on; half as many towards the limits
    starts: int  # of the search for constants


FULL, QUICK = Extent(20_000, 10_000, 5_000, 8), Extent(1_000, 500, 500, 2)


def run(folder: Path, extent: Extent, ship: bool = False) -> Path:
    """Calibrate, test, write tables and the page into `folder`, and the constants into the package if they `ship`."""
    kept = folder / f"rows-{zlib.crc32(b''.join(path.read_bytes() for path in sorted(DECIDING))):08x}"
    found = _constants(kept, extent)
    text = json.dumps(found, indent=1) + "\n"
    for path in (folder / "constants.json", *([prediction.CONSTANTS] if ship else [])):
        with whole_file(path) as file:
            file.write(text.encode())
    prediction.constants.cache_clear()
    sections = []
    tests: tuple[tuple[str, Kind, int], ...]
    tests = ("test", "plausible", extent.test), ("test-limits", "limits", extent.test // 2)
    for name, kind, count in tests:
        part = collect(kept, name, kind, TEST, count, rows)
        sections.append((f"Reductions, {kind} scenes", tables.by_reduction(part, found)))
    shipped = f"{zlib.crc32(prediction.CONSTANTS.read_bytes()):08x}"  # `advise` knows no other constants
    told = collect(kept, f"advice-{shipped}", "plausible", TEST, extent.test, advised)
    sections.append(("Advice as shipped, plausible scenes", tables.by_tolerance(told)))
    for title, table in sections:
        tables.write(folder / f"{title.replace(', ', '-').replace(' ', '-').lower()}.csv", table)
        _show(title, table)
    return _write_page(folder / "index.html", extent, sections)


def _constants(kept: Path, extent: Extent) -> dict[str, Any]:
    """Return what is to stand in constants.json."""
    plausible = collect(kept, "calibration", "plausible", CALIBRATION, extent.plausible, rows)
    found: list[Row] = plausible + collect(kept, "calibration-limits", "limits", CALIBRATION, extent.limits, rows)
    source = {
        "command": "python -m experiments.fidelity --ship",
        "scenes": f"{extent.plausible} plausible, {extent.limits} towards the limits",
        "reductions": len(found),
        "quantile": QUANTILE,
        "date": circumstances()["date"][:10],
    }
    measured = {"cost": costs.relative(plausible), "saved by stops ten times softer": costs.saved(plausible)}
    return {"provenance": source, **measured, **calibrate(found, extent.starts)}


def _show(title: str, table: tables.Table) -> None:
    """Print the columns of a table that fit on a screen."""
    columns = [name for name in table[0] if not name.startswith(("truly", "largest"))]
    printed = Table(*(name.replace("_", " ") for name in columns), title=title)
    for row in table:
        values = [row[name] for name in columns]
        printed.add_row(*(f"{value:.3g}" if isinstance(value, float) else str(value) for value in values))
    Console(width=200).print(printed)


def _write_page(path: Path, extent: Extent, sections: list[tuple[str, tables.Table]]) -> Path:
    """Write the page; the first section is the one its head speaks of."""
    every = sections[0][1][-1]
    pages = Environment(loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined)
    text = pages.get_template("page.html.jinja").render(
        sections=sections,
        extent=extent,
        every=every,
        circumstances=circumstances("impact-gym", "numpy", "scipy"),
    )
    with whole_file(path) as file:
        file.write(text.encode())
    return path
