"""The whole study: measure what is missing, draw, write the page."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import polars as pl

from experiments.lab import experiment
from experiments.lab.experiment import Shown, Tables
from experiments.speed_vs_error import figures, heat_map, measure, peer, peer_fit, scenes, summary, taylor, truth
from experiments.speed_vs_error.by_hand import METHODS
from experiments.speed_vs_error.contenders import Grid, settings
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


def tables(folder: Path, extent: Extent, processes: int | None = None) -> Tables:
    """Return all tables, after measuring what `folder` does not have of them."""
    named = [approach for approach in scenes.named() if not extent.names or approach.name in extent.names]
    found = {
        "named_truth": truth.rows(folder, named, 1e-11, processes),
        "population_truth": truth.rows(folder, scenes.population(extent.scenes), 1e-10, processes),
    }
    true, all_true = (truth.answers(rows) for rows in found.values())
    found["mujoco_fits"] = peer_fit.rows(folder, true, extent.fit, processes)
    fits = {row["scene"]: {name: row[name] for name in ("stiffness", "damping")} for row in found["mujoco_fits"]}
    found["heat_map"] = heat_map.rows(folder, extent.heat_map, processes)
    tried = settings(extent.named), settings(extent.population)
    found["named"] = measure.rows(folder, "named", true, fits, tried[0], extent.rounds, processes)
    found["population"] = measure.rows(folder, "population", all_true, {}, tried[1], 1, processes)
    return found


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


def run(folder: Path, line: str, *, extent: Extent, again: bool = False, processes: int | None = None) -> Path:
    """Measure what `folder` does not have, or everything `again`; return the path of the page."""
    absent = {"mujoco": peer.missing(), "heyoka": taylor.missing()}
    for why in filter(None, absent.values()):
        print(f"speed_vs_error: {why}; it takes no part")
    peers = [name for name, why in absent.items() if not why]
    compute = partial(tables, folder, extent, processes)
    return experiment.run("speed_vs_error", folder, line, compute, shown, again=again, packages=peers)
