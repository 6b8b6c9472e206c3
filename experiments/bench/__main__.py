"""Measure, print, write; see the package."""

import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from experiments.bench import approaches, environments
from experiments.results import REPORTS, circumstances, whole_folder
from experiments.speed_vs_error.contenders import OURS


@dataclass(frozen=True)
class Settings:
    """Measure speed against SciPy, MuJoCo and Gymnasium's own environments."""

    out: Path = REPORTS / "bench"
    """Folder for results.json."""
    rounds: int = 5
    """Each figure is the best of so many rounds, the contenders taking turns."""


def seconds(function: Callable[[], Any], calls: int) -> float:
    """Mean time of a call, s."""
    begun = time.perf_counter()
    for _ in range(calls):
        function()
    return (time.perf_counter() - begun) / calls


def measure(settings: Settings) -> dict[str, Any]:
    """Return all figures."""
    load = os.getloadavg()[0]
    compared = approaches.contenders()
    rtol, error = environments.cheapest_tolerance()
    environment = environments.contenders(rtol)
    batches = {size: environments.stepper(size, rtol) for size in environments.SIZES}
    for call, _ in environment.values():
        seconds(call, 50)  # compile, and mix the phases of the episodes
    best: dict[Any, float] = {}

    def note(name: Any, duration: float) -> None:
        best[name] = min(best.get(name, np.inf), duration)

    for _ in tqdm(range(settings.rounds), desc="rounds"):
        for scene, contenders in compared.items():
            for contender, _ in contenders:
                note((scene, contender.name), contender.seconds(2000 if contender.name == OURS else 5))
        for name, (call, steps) in environment.items():
            note(name, seconds(call, 200 if steps > 1 else 5000) / steps)
        for size, call in batches.items():
            note(size, seconds(call, max(50, 2**19 // size)) / size)

    rows, ratios = [], {}
    for scene, contenders in compared.items():
        for contender, off in contenders:
            microseconds = 1e6 * best[scene, contender.name]
            rows.append(
                {
                    "scene": scene,
                    "solver": contender.name,
                    "rtol or step (s)": contender.setting,
                    "microseconds": microseconds,
                    "error_m_per_s": off,
                }
            )
        (mine, _), *others = contenders
        fastest = min((other.name for other, _ in others), key=lambda name: best[scene, name])
        ratios[f"{scene}: ours is faster than {fastest}, by"] = best[scene, fastest] / best[scene, mine.name]
    native, cart_pole, single, pendulum = environment
    ratios["our batch's step rate over CartPole's"] = best[cart_pole] / best[native]
    ratios["our single step rate over Pendulum's"] = best[pendulum] / best[single]
    return {
        "approach": rows,
        "environment_steps_per_second": {name: 1.0 / best[name] for name in environment},
        "largest_error_of_the_batch_m_per_s": error,
        "microseconds_of_a_step_per_environment": {str(size): 1e6 * best[size] for size in batches},
        "memory": environments.memory(),
        "ratios": ratios,
        "load_before": load,
        **circumstances("impact-gym", "numpy", "scipy", "gymnasium"),
    }


def show(results: dict[str, Any]) -> None:
    """Print the figures."""
    console = Console()
    table = Table(title="One approach with one contact; of SciPy's solvers the contact alone")
    for column in ("scene", "solver"):
        table.add_column(column)
    for column in ("rtol or step (s)", "µs", "error in V_p (m/s)"):
        table.add_column(column, justify="right")
    for row in results["approach"]:
        microseconds, error = f"{row['microseconds']:.1f}", f"{row['error_m_per_s']:.1e}"
        table.add_row(row["scene"], row["solver"], f"{row['rtol or step (s)']:.0e}", microseconds, error)
    console.print(table)
    table = Table(title="Environment steps")
    table.add_column("environment")
    table.add_column("steps/s", justify="right")
    for name, rate in results["environment_steps_per_second"].items():
        table.add_row(name, f"{rate:,.0f}")
    console.print(table)
    sizes = results["microseconds_of_a_step_per_environment"].items()
    console.print("µs a step and environment, by size of the batch: ", ", ".join(f"{n}: {t:.2f}" for n, t in sizes))
    console.print(f"largest error in V_p of the batch: {results['largest_error_of_the_batch_m_per_s']:.1e} m/s")
    held, allocated = results["memory"].values()
    console.print(
        f"memory: {held:.0f} bytes an environment; a step of the batch allocates {allocated:.0f} bytes in all"
    )
    for name, ratio in results["ratios"].items():
        console.print(f"{name} {ratio:.3g}")


def main() -> None:
    """Read the settings from the command line, measure, print, write."""
    settings = tyro.cli(Settings)
    try:
        with whole_folder(settings.out) as folder:
            results = measure(settings)
            (folder / "results.json").write_text(json.dumps(results, indent=2) + "\n")
    except ValueError as error:
        sys.exit(f"experiments.bench: {error}")
    show(results)
    print(f"results: {(settings.out / 'results.json').resolve().as_uri()}")


if __name__ == "__main__":
    main()
