"""Measure, print, write; see the package."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import polars as pl
import tyro
from polars import selectors

from agents.command_line import command_line
from agents.provenance import circumstances
from experiments.bench import approaches, environments, jobs, models, rates
from experiments.lab.results import REPORTS, whole_folder

PARTS = {
    "approaches": approaches.measure,
    "environments": environments.measure,
    "models": models.measure,
    "rates": rates.measure,
    "jobs": jobs.measure,
    "ten-million": jobs.ten_million,
}


@dataclass(frozen=True)
class BenchOptions:
    """Measure speed: approaches and environments beside others', simpler models, training, grids of jobs."""

    parts: tyro.conf.Positional[tuple[Literal[*PARTS], ...]] = ("approaches", "environments", "models", "rates")
    """The first four take two minutes together. The others are to be asked for: jobs plays grids on this machine and on
    Ray (five minutes), ten-million plays the whole grid (as long again, with 0.7 GB of results for a while)."""
    quick: bool = False
    """Measure so briefly that the figures mean little."""
    out: Path = REPORTS / "bench"
    """Folder for results.json and tables.md; one that an earlier run wrote is replaced."""


def markdown(table: pl.DataFrame) -> str:
    """Return a table to print, its numbers to three digits."""
    whole = {"tbl_rows": -1, "tbl_cols": -1, "tbl_width_chars": -1, "fmt_str_lengths": 1000}
    plain = {"fmt_float": "full", "thousands_separator": True, "tbl_formatting": "MARKDOWN"}
    with pl.Config(**whole, **plain, tbl_hide_dataframe_shape=True, tbl_hide_column_data_types=True):
        return str(table.with_columns(selectors.float().round_sig_figs(3)))


def main() -> None:
    """Read the options from the command line, measure, print, write."""
    with command_line("experiments.bench", "what was there before is unchanged"):
        options = tyro.cli(BenchOptions, prog="python -m experiments.bench")
        results = {"quick": options.quick, "load_before": os.getloadavg()[0]}
        results |= circumstances("impact-gym", "numpy", "scipy", "gymnasium")
        text = f"Measured on {results['machine']}, {results['date']}, load {results['load_before']:.1f} before.\n"
        with whole_folder(options.out) as folder:
            for part in options.parts:
                tables = PARTS[part](options.quick)
                results[part] = {title: table.to_dicts() for title, table in tables.items()}
                text += "".join(f"\n{title}:\n\n{markdown(table)}\n" for title, table in tables.items())
            (folder / "results.json").write_text(json.dumps(results, indent=2) + "\n")
            (folder / "tables.md").write_text(text)
    print(f"{text}\nresults: {(options.out / 'results.json').resolve().as_uri()}")


if __name__ == "__main__":
    main()
