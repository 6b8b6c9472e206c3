"""`python -m experiments.speed_vs_error`: measure what is missing, draw, write reports/speed_vs_error/index.html."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import polars as pl
import tyro

from experiments.lab import experiment
from experiments.lab.experiment import Shown, Tables
from experiments.lab.tables import Gather
from experiments.speed_vs_error import figures, heat_map, measure, peer, scenes, summary, truth
from experiments.speed_vs_error.by_hand import METHODS
from experiments.speed_vs_error.contenders import MISSING, MUJOCO, PACKAGES, Grid
from experiments.speed_vs_error.quantities import ERRORS, TOO_WRONG


@dataclass(frozen=True)
class Extent:
    """How much is measured."""

    named: Grid
    population: Grid  # without MuJoCo, which has to be fitted to each scene
    rounds: int
    scenes: int  # in the population
    heat_map: int  # points for two decades
    fit: int  # approaches that MuJoCo's fit may take
    names: tuple[str, ...] = ()  # of named scenes; none means all


FEW = Grid((1e-3, 1e-6, 1e-9), (1e-6,), (1e-3, 1e-4), (1e-3, 2e-4), (1e-6, 1e-12))
COARSER = Grid(scipy_rtols=(1e-3, 1e-6, 1e-9), steps=(1e-3, 1e-4, 1e-5, 1e-6), mujoco_steps=())
FULL = Extent(Grid(), COARSER, rounds=3, scenes=200, heat_map=8, fit=90)
QUICK = Extent(FEW, replace(FEW, mujoco_steps=()), rounds=1, scenes=8, heat_map=1, fit=25)


def tables(extent: Extent, gather: Gather) -> Tables:
    """Return all tables, after measuring what is missing of them."""
    named = [approach for approach in scenes.named() if not extent.names or approach.name in extent.names]
    found = {
        "named_truth": truth.rows(gather, named, 1e-11),
        "population_truth": truth.rows(gather, scenes.population(extent.scenes), 1e-10),
    }
    true, all_true = (truth.solutions(rows) for rows in found.values())
    fits = peer.rows(gather, true, extent.fit) if MUJOCO not in MISSING else []
    return found | {
        "mujoco_fits": fits,
        "heat_map": heat_map.rows(gather, extent.heat_map),
        "named": measure.rows(gather, "named", true, fits, extent.named.settings(), extent.rounds),
        "population": measure.rows(gather, "population", all_true, [], extent.population.settings(), 1),
    }


def shown(tables: Tables) -> Shown:
    """Return figures and what the page says."""
    frames = {name: pl.DataFrame(rows, infer_schema_length=None) for name, rows in tables.items()}
    named, truths, population, heat = (frames[name] for name in ("named", "named_truth", "population", "heat_map"))
    drawn = {column: figures.named_scenes(named, truths, column) for column in ERRORS}
    drawn |= {"population": figures.population(population), "heat_map": figures.heat_map(heat, heat_map.OUR_RTOL)}
    doubts = pl.concat([truths, frames["population_truth"]], how="vertical_relaxed")
    differ = (pl.col("second_contacts") != pl.col("contacts")) | (pl.col("second_passes") != pl.col("passes"))
    return drawn, {
        "lines": summary.lines(named, truths),
        "summary": summary,
        "errors": ERRORS,
        "table": summary.over_population(population).to_dicts(),
        "population_size": frames["population_truth"].height,
        "doubt": doubts["velocity_error_doubt"].max(),
        "disagreements": doubts.filter(differ).height,
        "truth_rtol": truth.RTOL,
        "too_wrong": TOO_WRONG,
        "by_hand": list(METHODS),
        "fits": bool(tables["mujoco_fits"]),
        "heat": heat,
        "load": named["load"],
    }


def main(out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Measure speed against error and write a page about it; what is on disk is not measured again.

    Args:
        out: folder for tables, figures and the page: reports/speed_vs_error, or speed_vs_error_quick beside it.
        quick: a first look in under a minute: few settings, few scenes.
        force: measure everything again.
    """
    for name in MISSING:
        print(f"speed_vs_error: {name} is not installed (extra `peers`); it takes no part")
    compute, packages = partial(tables, QUICK if quick else FULL), set(PACKAGES.values()) - set(MISSING.values())
    experiment.command("speed_vs_error", compute, shown, out, quick, again=force, packages=sorted(packages))


if __name__ == "__main__":
    tyro.cli(main, prog="python -m experiments.speed_vs_error")
