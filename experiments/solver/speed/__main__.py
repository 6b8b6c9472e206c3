"""`impact-gym speed`: measure what is missing, draw, write reports/speed/index.html."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import polars as pl
import tyro

from experiments.lab import experiment
from experiments.lab.experiment import Shown, Tables
from experiments.lab.tables import Gather
from experiments.solver import figures, in_mujoco, timing
from experiments.solver.approaches import named, population
from experiments.solver.by_hand import METHODS
from experiments.solver.solutions import ERRORS, TRUE_RTOL, Solution, truths_with_doubt
from experiments.solver.timing import MISSING, MUJOCO, RIVALS, TOO_WRONG, Settings, beside_ours, settings


@dataclass(frozen=True)
class Extent:
    """How much is measured."""

    named: Settings
    population: Settings  # without MuJoCo, which has to be fitted to each scene
    rounds: int
    scenes: int  # in the population
    fit: int  # approaches that MuJoCo's fit may take
    names: tuple[str, ...] = ()  # of named scenes; none means all


THREE, FOUR = (1e-3, 1e-6, 1e-9), (1e-3, 1e-4, 1e-5, 1e-6)
FULL = Extent(settings(), settings(scipy_rtols=THREE, steps=FOUR, mujoco_steps=()), rounds=3, scenes=200, fit=90)
QUICK = Extent(
    settings(THREE, (1e-6,), (1e-3, 1e-4), (1e-3, 2e-4)), settings(THREE, (1e-6,), (1e-3, 1e-4), ()),
    rounds=1, scenes=8, fit=25,
)  # fmt: skip


def tables(extent: Extent, gather: Gather) -> Tables:
    """Return all tables, after measuring what is missing of them."""
    names = [approach.name for approach in named() if not extent.names or approach.name in extent.names]
    members = [approach.name for approach in population(extent.scenes)]
    truths = {
        "named_truth": truths_with_doubt(gather, names, second_rtol=1e-11),
        "population_truth": truths_with_doubt(gather, members, second_rtol=1e-10),
    }
    of_named, of_population = ({row["scene"]: Solution.of_row(row) for row in rows} for rows in truths.values())
    fits = in_mujoco.fits(gather, of_named, extent.fit) if MUJOCO not in MISSING else []
    return truths | {
        "mujoco_fits": fits,
        "named": timing.in_turns(gather, "named", of_named, fits, extent.named, extent.rounds),
        "population": timing.in_turns(gather, "population", of_population, [], extent.population, 1),
    }


def shown(tables: Tables) -> Shown:
    """Return figures and what the page says."""
    frames = {name: pl.DataFrame(rows, infer_schema_length=None) for name, rows in tables.items()}
    times, truths, members = (frames[name] for name in ("named", "named_truth", "population"))
    drawn = {column: figures.named_scenes(times, truths, column) for column in ERRORS}
    drawn |= {"population": figures.population(members)}
    doubts = pl.concat([truths, frames["population_truth"]], how="vertical_relaxed")
    differ = (pl.col("second_contacts") != pl.col("contacts")) | (pl.col("second_passes") != pl.col("passes"))
    return drawn, {
        "lines": [
            row | {rival: beside_ours(times.filter(scene=row["scene"]), *at) for rival, at in RIVALS.items()}
            for row in truths.select("scene", "description").to_dicts()
        ],
        "timing": timing,
        "errors": ERRORS,
        "table": timing.over_population(members).to_dicts(),
        "population_size": frames["population_truth"].height,
        "doubt": doubts["velocity_error_doubt"].max(),
        "disagreements": doubts.filter(differ).height,
        "truth_rtol": TRUE_RTOL,
        "too_wrong": TOO_WRONG,
        "by_hand": list(METHODS),
        "fits": bool(tables["mujoco_fits"]),
        "load": times["load"],
    }


def main(out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Measure speed against error and write a page about it; what is on disk is not measured again.

    Args:
        out: folder for tables, figures and the page: reports/speed, or speed_quick beside it.
        quick: a first look in under a minute: few settings, few scenes.
        force: measure everything again.
    """
    for name in MISSING:
        print(f"impact-gym speed: {name} is not installed (extra `peers`); it takes no part")
    compute, packages = partial(tables, QUICK if quick else FULL), [] if MISSING else ["mujoco"]
    experiment.command("solver.speed", compute, shown, out, quick, again=force, packages=packages)


if __name__ == "__main__":
    tyro.cli(main, prog="impact-gym speed")
