"""`impact-gym paper [NAME ...]`: the paper's figures, and a page that compares them with its text."""

import shlex
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tqdm import tqdm

from agents.command_line import command_line
from experiments.lab.charts import save
from experiments.lab.results import REPORTS
from experiments.paper import NAMES, load, page, resolve, tables


@dataclass(frozen=True)
class PaperOptions:
    """Reproduce figures of the paper and compare them with its text."""

    names: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """Which figures: 17, or beyond_speed; none means all there are. The others stay as they are on disk."""
    out: Path = REPORTS / "paper"
    """Folder for tables, figures and the page."""


def main() -> None:
    """Read the options from the command line, compute, draw, write the page."""
    begun = time.perf_counter()
    with command_line("paper", "what is drawn is kept"):
        options = tyro.cli(PaperOptions, prog="impact-gym paper")
        names = sorted({resolve(word) for word in options.names} or NAMES, key=NAMES.index)
        options.out.mkdir(parents=True, exist_ok=True)
        for name in (bar := tqdm(names, desc="figures")):
            bar.set_postfix_str(name)
            module, table_file = load(name), options.out / f"{name}.csv"
            tables.write(table_file, module.compute())
            save(module.plot(tables.read(table_file)), table_file.with_suffix(".svg"))
        command = shlex.join(["impact-gym", "paper", *sys.argv[1:]])
        written = page.write(options.out, {"command": command, "seconds": time.perf_counter() - begun})
    print(f"{len(names)} figures in {time.perf_counter() - begun:.0f} s: {written.resolve().as_uri()}")


if __name__ == "__main__":
    main()
