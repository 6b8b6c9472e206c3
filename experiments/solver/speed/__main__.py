"""`impact-gym speed`: measure what is missing, draw, write reports/speed/index.html."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import polars as pl
import tyro

from experiments.lab import experiment
from experiments.lab.experiment import Shown, Tables
from experiments.lab.tables import Gather
from experiments.solver import figures, solutions, timing
from experiments.solver.approaches import named
from experiments.solver.by_hand import METHODS
from experiments.solver.solutions import ERRORS, Solution, truths_with_doubt
from experiments.solver.timing import RIVALS, Settings, beside_ours, settings


@dataclass(frozen=True)
class Extent:
    """How much is measured."""

    tried: Settings
    rounds: int
    names: tuple[str, ...] = ()  # of scenes; none means all


FULL = Extent(settings(), rounds=3)
QUICK = Extent(settings((1e-3, 1e-6, 1e-9), (1e-6,), (1e-3, 1e-4)), rounds=1)


def tables(extent: Extent, gather: Gather) -> Tables:
    """Return all tables, after measuring what is missing of them."""
    names = [approach.name for approach in named() if not extent.names or approach.name in extent.names]
    rows = truths_with_doubt(gather, names)
    truths = {row["scene"]: Solution.of_row(row) for row in rows}
    return {"truth": rows, "named": timing.in_turns(gather, truths, extent.tried, extent.rounds)}


def shown(tables: Tables) -> Shown:
    """Return figures and what the page says."""
    times, truths = (pl.DataFrame(tables[name], infer_schema_length=None) for name in ("named", "truth"))
    differ = (pl.col("second_contacts") != pl.col("contacts")) | (pl.col("second_passes") != pl.col("passes"))
    return {column: figures.named_scenes(times, truths, column) for column in ERRORS}, {
        "lines": [
            row | {rival: beside_ours(times.filter(scene=row["scene"]), *at) for rival, at in RIVALS.items()}
            for row in truths.select("scene", "description").to_dicts()
        ],
        "timing": timing,
        "errors": ERRORS,
        "doubt": truths["velocity_error_doubt"].max(),
        "disagreements": truths.filter(differ).height,
        "truth": solutions,
        "by_hand": list(METHODS),
        "load": times["load"],
    }


def main(out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Measure speed against error and write a page about it; what is on disk is not measured again.

    Args:
        out: folder for tables, figures and the page: reports/speed, or speed_quick beside it.
        quick: a first look in under a minute: few settings, one round.
        force: measure everything again.
    """
    compute = partial(tables, QUICK if quick else FULL)
    experiment.command("solver.speed", compute, shown, out, quick, again=force)


if __name__ == "__main__":
    tyro.cli(main, prog="impact-gym speed")
