"""The whole study: measure what is missing, draw, write the page."""

import json
import os
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from agents.provenance import circumstances
from experiments.speed_vs_error import by_hand, heat_map, measure, page, peer, peer_fit, scenes, taylor
from experiments.speed_vs_error.contenders import Grid
from experiments.speed_vs_error.truth import truths
from impact_gym.files import whole_file


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


def run(folder: Path, extent: Extent, again: bool, command: str) -> Path:
    """Measure what the tables in `folder` do not have, or everything `again`; return the path of the page."""
    begun, log = time.perf_counter(), folder / "results.json"
    folder.mkdir(parents=True, exist_ok=True)
    if again:
        for table in (page.NAMED, page.POPULATION, log.name):
            (folder / table).unlink(missing_ok=True)
    runs: list[dict[str, Any]] = json.loads(log.read_text())["runs"] if log.is_file() else []
    missing = {"mujoco": peer.missing(), "heyoka": taylor.missing()}
    for why in filter(None, missing.values()):
        print(f"speed_vs_error: {why}; it takes no part")
    peers = [name for name, why in missing.items() if not why]
    about = {"command": command, "load_before": os.getloadavg()[0]}
    runs.append(about | circumstances("impact-gym", "numpy", "scipy", *peers))

    def keep(seconds: float | None) -> None:
        runs[-1]["seconds"] = seconds
        with whole_file(log) as file:
            file.write((json.dumps({"runs": runs}, indent=2) + "\n").encode())

    keep(None)  # the rows of a run that is interrupted stay
    named = [approach for approach in scenes.named() if not extent.names or approach.name in extent.names]
    population = scenes.population(extent.scenes)
    truth = truths(folder / page.NAMED_TRUTH, named, 1e-11, again)
    truth |= truths(folder / page.POPULATION_TRUTH, population, 1e-10, again)
    fits = peer_fit.fits(folder / page.FITS, named, truth, extent.fit, again)
    heat_map.extend(folder / page.HEAT_MAP, extent.heat_map, again)
    by_hand.compile_now()
    measure.extend(folder / page.NAMED, named, extent.named, truth, fits, extent.rounds)
    measure.extend(folder / page.POPULATION, population, extent.population, truth, {}, 1)
    keep(time.perf_counter() - begun)
    page.draw(folder)
    return page.write(folder, runs)
