"""The whole study: measure what is missing, draw, write the page."""

import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.results import circumstances
from experiments.speed_vs_error import by_hand, compile_times, heat_map, measure, page, peer, peer_fit, scenes
from experiments.speed_vs_error.contenders import Grid, contenders
from experiments.speed_vs_error.truth import truths
from impact_gym.files import whole_file


@dataclass(frozen=True)
class Extent:
    """How much is measured."""

    names: tuple[str, ...]  # of named scenes; none means all
    named: Grid
    population: Grid
    rounds: int
    scenes: int  # in the population
    heat_map: int  # points for two decades
    fit: int  # approaches that MuJoCo's fit may take
    compile_times: bool


FULL = Extent(
    (),
    Grid(),
    Grid(scipy_rtols=(1e-3, 1e-6, 1e-9), steps=(1e-3, 1e-4, 1e-5, 1e-6)),
    rounds=3,
    scenes=200,
    heat_map=8,
    fit=90,
    compile_times=True,
)
FEW = Grid(rtols=(1e-3, 1e-6, 1e-9), scipy_rtols=(1e-6,), steps=(1e-3, 1e-4), mujoco_steps=(1e-3, 2e-4))
QUICK = Extent((), FEW, FEW, rounds=1, scenes=8, heat_map=1, fit=25, compile_times=False)


def _results(folder: Path) -> dict[str, Any]:
    """Return what earlier runs left to say about themselves."""
    file = folder / "results.json"
    found: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else {"runs": [], "compile_seconds": {}}
    return found


def _keep(folder: Path, results: dict[str, Any]) -> None:
    with whole_file(folder / "results.json") as file:
        file.write((json.dumps(results, indent=2) + "\n").encode())


def run(folder: Path, extent: Extent, again: bool, command: str) -> Path:
    """Measure what the tables in `folder` do not have, or everything `again`; return the path of the page."""
    begun = time.perf_counter()
    folder.mkdir(parents=True, exist_ok=True)
    results = _results(folder)
    if again:
        results["runs"] = []
        for table in (page.NAMED, page.POPULATION):
            (folder / table).unlink(missing_ok=True)
    this: dict[str, Any] = {
        "command": command,
        "load_before": os.getloadavg()[0],
        "seconds": None,  # until it is done: the rows of a run that was interrupted stay
        **circumstances("impact-gym", "numpy", "scipy", *([] if peer.missing() else ["mujoco"])),
    }
    results["runs"].append(this)
    _keep(folder, results)

    named = [approach for approach in scenes.named() if not extent.names or approach.name in extent.names]
    population = scenes.population(extent.scenes)
    truth = truths(folder / page.NAMED_TRUTH, named, 1e-11, again)
    truth |= truths(folder / page.POPULATION_TRUTH, population, 1e-10, again)
    fitted = peer_fit.fits(folder / page.FITS, named, truth, extent.fit, again)
    heat_map.extend(folder / page.HEAT_MAP, extent.heat_map, again)

    by_hand.compile_now()
    for approach in named:
        found = contenders(approach, extent.named, fitted.get(approach.name))
        measure.extend(folder / page.NAMED, approach, found, truth[approach.name], extent.rounds)
    measure.extend_all(folder / page.POPULATION, population, extent.population, truth)
    if extent.compile_times and (again or not results["compile_seconds"]):
        results["compile_seconds"] = compile_times.measured()

    this["seconds"] = time.perf_counter() - begun
    _keep(folder, results)
    page.draw(folder)
    return page.write(folder, results)
