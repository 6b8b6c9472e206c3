"""Measure, print, write; see the package."""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from timeit import timeit
from typing import Any

import rich
import tyro
from tqdm import tqdm

from agents.provenance import circumstances
from experiments.bench import approaches, environments
from experiments.lab.results import REPORTS, whole_folder
from experiments.speed_vs_error.contenders import OURS


def seconds(function: Callable[[], Any], calls: int) -> float:
    """Mean time of a call, s."""
    return timeit(function, "import gc; gc.enable()", number=calls) / calls  # with garbage collection, as programs run


def measure(rounds: int) -> dict[str, Any]:
    """Return all figures."""
    results = {"load_before": os.getloadavg()[0], **circumstances("impact-gym", "numpy", "scipy", "gymnasium")}
    compared = approaches.contenders()
    approaching = [(scene, one) for scene, contenders in compared.items() for one, _ in contenders]
    rtol, error = environments.cheapest_tolerance()
    environment = environments.contenders(rtol)
    batches = {size: environments.stepper(size, rtol) for size in environments.SIZES}
    for call, _ in environment.values():
        seconds(call, 50)  # mix the phases of the episodes

    def turn() -> dict[Any, float]:
        """Return what each takes now, s."""
        times = {(scene, one.name): one.seconds(2000 if one.name == OURS else 5) for scene, one in approaching}
        times |= {name: seconds(call, 200 if n > 1 else 5000) / n for name, (call, n) in environment.items()}
        return times | {size: seconds(call, max(50, 2**19 // size)) / size for size, call in batches.items()}

    turns = [turn() for _ in tqdm(range(rounds), desc="rounds")]
    best = {name: min(times[name] for times in turns) for name in turns[0]}
    rows, ratios = [], {}
    for scene, contenders in compared.items():
        for contender, off in contenders:
            row = {"scene": scene, "solver": contender.name, "rtol or step (s)": contender.setting}
            rows.append(row | {"microseconds": 1e6 * best[scene, contender.name], "error_m_per_s": off})
        mine, *others = (contender.name for contender, _ in contenders)
        fastest = min(others, key=lambda name: best[scene, name])
        ratios[f"{scene}: ours is faster than {fastest}, by"] = best[scene, fastest] / best[scene, mine]
    native, cart_pole, single, pendulum = environment
    ratios["our batch's step rate over CartPole's"] = best[cart_pole] / best[native]
    ratios["our single step rate over Pendulum's"] = best[pendulum] / best[single]
    return results | {
        "approach": rows,
        "environment_steps_per_second": {name: 1.0 / best[name] for name in environment},
        "largest_error_of_the_batch_m_per_s": error,
        "microseconds_of_a_step_per_environment": {str(size): 1e6 * best[size] for size in batches},
        "memory": environments.memory(),
        "ratios": ratios,
    }


def main(out: Path = REPORTS / "bench", rounds: int = 5) -> None:
    """Measure speed against SciPy, MuJoCo and Gymnasium's own environments.

    Args:
        out: folder for results.json.
        rounds: each figure is the best of so many rounds, the contenders taking turns.
    """
    try:
        with whole_folder(out) as folder:
            results = measure(rounds)
            (folder / "results.json").write_text(json.dumps(results, indent=2) + "\n")
    except ValueError as error:
        sys.exit(f"experiments.bench: {error}")
    rich.print_json(data=results)
    print(f"results: {(out / 'results.json').resolve().as_uri()}")


if __name__ == "__main__":
    tyro.cli(main)
