"""`impact-gym paper [NAME ...]`: the paper's figures, and a page that compares them with its text."""

import shlex
import sys
import time
from pathlib import Path

import tyro
from tqdm import tqdm

from agents.command_line import command_line
from experiments.lab.charts import save
from experiments.lab.results import REPORTS
from experiments.paper import NAMES, load, page, resolve, tables


def main(names: tyro.conf.Positional[tuple[str, ...]] = (), out: Path = REPORTS / "paper") -> None:
    """Reproduce figures of the paper and compare them with its text.

    Args:
        names: Which figures: 17, or beyond_speed; none means all there are. The others stay as they are on disk.
        out: Folder for tables, figures and the page.
    """
    begun = time.perf_counter()
    with command_line("paper", "what is drawn is kept"):
        figures = sorted({resolve(word) for word in names} or NAMES, key=NAMES.index)
        for name in (bar := tqdm(figures, desc="figures")):
            bar.set_postfix_str(name)
            module, table_file = load(name), out / f"{name}.csv"
            tables.write(table_file, module.compute())
            save(module.plot(tables.read(table_file)), table_file.with_suffix(".svg"))
        command = shlex.join(["impact-gym", "paper", *sys.argv[1:]])
        index = page.write(out, {"command": command, "seconds": time.perf_counter() - begun})
    print(f"{len(figures)} figures in {time.perf_counter() - begun:.0f} s: {index.resolve().as_uri()}")


if __name__ == "__main__":
    tyro.cli(main, prog="impact-gym paper")
