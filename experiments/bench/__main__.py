"""Measure, print, write; see the package."""

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import polars as pl
import tyro

from agents.command_line import run_command
from agents.provenance import circumstances
from experiments.bench import approaches, environments
from experiments.lab.results import REPORTS, whole_folder

Part = Literal["approaches", "environments", "models", "rates", "cost"]
Measure = Callable[[bool], dict[str, pl.DataFrame]]
"""Measures, quickly or not; returns tables by their titles."""
PARTS: dict[str, Measure] = {
    "approaches": approaches.solvers, "environments": environments.measure, "models": approaches.models,
    "rates": environments.three_rates, "cost": approaches.cost,
}  # fmt: skip


@dataclass(frozen=True)
class BenchOptions:
    """Measure speed: approaches and environments beside others', simpler models, training."""

    parts: tyro.conf.Positional[tuple[Part, ...]] = ("approaches", "environments", "models", "rates")
    """These take two minutes together; cost, of an approach by coupling, robot and tolerance, is to be asked for."""
    quick: bool = False
    """Measure so briefly that the figures mean little."""
    out: Path = REPORTS / "bench"
    """Folder for results.json and tables.md; one that an earlier run wrote is replaced."""


def markdown(table: pl.DataFrame) -> str:
    """Return a table in Markdown, its numbers to three digits."""
    lines = [table.columns, ["---"] * table.width, *(map(text, row) for row in table.iter_rows())]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def text(value: Any) -> str:
    """Return a cell of a table, whatever it holds; nothing for None."""
    if isinstance(value, float):
        return f"{float(f'{value:.3g}'):,.15g}"
    return "" if value is None else f"{value:,}" if isinstance(value, int) else str(value)


def run(options: BenchOptions, measures: Mapping[str, Measure] = PARTS) -> None:
    """Measure, print and write the parts that are asked for."""
    results: dict[str, Any] = {"quick": options.quick, "load_before": os.getloadavg()[0]}
    results |= circumstances("impact-gym", "numpy", "scipy", "gymnasium")
    printed = f"Measured on {results['machine']}, {results['date']}, load {results['load_before']:.1f} before.\n"
    with whole_folder(options.out) as folder:
        for part in options.parts:
            tables = measures[part](options.quick)
            results[part] = {title: table.to_dicts() for title, table in tables.items()}
            printed += "".join(f"\n{title}:\n\n{markdown(table)}\n" for title, table in tables.items())
        (folder / "results.json").write_text(json.dumps(results, indent=2) + "\n")
        (folder / "tables.md").write_text(printed)
    print(f"{printed}\nresults: {(options.out / 'results.json').resolve().as_uri()}")


if __name__ == "__main__":
    run_command("bench", BenchOptions, run, "what was there before is unchanged")
