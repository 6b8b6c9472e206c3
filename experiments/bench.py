"""Speed, as ratios measured in one run, each beside its error: `python -m experiments.bench`."""

import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

import impact_gym as ig
from agents.baselines import PaperTrapezoid
from experiments import reference
from experiments.paper.scenes import DURATION, MOTION, decoupled
from experiments.results import REPORTS, circumstances, whole_folder

ERROR = 1e-6  # m/s in V_p, at which the solvers are compared
SCENE = decoupled(stiffness=1e4, restitution=1.0, coupling_stiffness=150.0)  # Fig. 17b: one contact
RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
METHODS = ("RK45", "DOP853", "LSODA", "Radau")
BATCH = 1024
FLIGHT = "flight of the reference"


@dataclass(frozen=True)
class Settings:
    """Measure speed against SciPy and against Gymnasium's own environments."""

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


def approach_contenders() -> dict[str, tuple[Callable[[], Any], int, float]]:
    """Return, per solver, the cheapest tolerance that keeps ERROR: a call, how often to make it, its error in m/s.

    SciPy's solvers are driven by the reference; the time of its flights is measured apart and taken off.
    """
    exact = reference.simulate(SCENE, MOTION, DURATION, rtol=1e-13).object_velocity
    chosen: dict[str, tuple[Callable[[], Any], int, float]] = {}
    untouched = replace(SCENE, object=ig.Object(mass=1.0, distance=100.0))
    chosen[FLIGHT] = (lambda: reference.simulate(untouched, MOTION, DURATION), 5, 0.0)

    def consider(name: str, run: Callable[[float], Any], calls: int) -> None:
        for rtol in RTOLS:
            error = abs(run(rtol).object_velocity - exact)
            if error <= ERROR:
                chosen[f"{name}, rtol {rtol:.0e}"] = (partial(run, rtol), calls, error)
                return

    consider("impact_gym.simulate", lambda rtol: ig.simulate(SCENE, MOTION, DURATION, rtol=rtol), 2000)
    for method in METHODS:
        consider(
            f"SciPy {method}, contact alone",
            lambda rtol, method=method: reference.simulate(SCENE, MOTION, DURATION, rtol=rtol, method=method),
            5,
        )
    return chosen


def environment_contenders() -> dict[str, tuple[Callable[[], Any], int]]:
    """Return, per environment, a call that steps it once with everything included, and how many steps that makes."""
    contenders: dict[str, tuple[Callable[[], Any], int]] = {}
    paper = PaperTrapezoid()

    native = gym.make_vec("ImpactApproach-v0", num_envs=BATCH)
    held = {"observation": native.reset(seed=0)[0]}

    def step_native() -> None:
        held["observation"] = native.step(paper.predict(held["observation"])[0])[0]

    contenders[f"ImpactApproach-v0, batch of {BATCH}, paper's rule"] = (step_native, BATCH)

    cart_pole = gym.make_vec("CartPole-v1", num_envs=BATCH, vectorization_mode="vector_entry_point")
    cart_pole.reset(seed=0)
    cart_actions = np.random.default_rng(0).integers(0, 2, (64, BATCH))
    turn = iter(range(10**9))
    contenders[f"CartPole-v1, batch of {BATCH}"] = (lambda: cart_pole.step(cart_actions[next(turn) % 64]), BATCH)

    for name in ("ImpactApproach-v0", "Pendulum-v1"):
        env: Any = gym.make(name)
        env.reset(seed=0)
        action = np.zeros(env.action_space.shape, np.float32) + 0.3

        def step_single(env: Any = env, action: Any = action) -> None:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

        contenders[f"{name}, single"] = (step_single, 1)
    return contenders


def measure(settings: Settings) -> dict[str, Any]:
    """Return all figures."""
    load = os.getloadavg()[0]
    approaches = approach_contenders()
    environments = environment_contenders()
    for call, _ in environments.values():
        seconds(call, 50)  # compile, and mix the phases of the episodes
    best: dict[str, float] = {}
    for _ in tqdm(range(settings.rounds), desc="rounds"):
        for name, (call, calls, _) in approaches.items():
            best[name] = min(best.get(name, np.inf), seconds(call, calls))
        for name, (call, steps) in environments.items():
            best[name] = min(best.get(name, np.inf), seconds(call, 200 if steps > 1 else 5000) / steps)

    for name in approaches:  # the reference flies by matrix exponentials, which is no solver of SciPy's
        if name.startswith("SciPy"):
            best[name] -= best[FLIGHT]
    ours = next(name for name in approaches if name.startswith("impact_gym"))
    fastest = min((name for name in approaches if name.startswith("SciPy")), key=best.__getitem__)
    native, cart_pole, single, pendulum = environments
    return {
        "approach": {
            name: {"microseconds": 1e6 * best[name], "error_m_per_s": error}
            for name, (_, _, error) in approaches.items()
            if name != FLIGHT
        },
        "environment_steps_per_second": {name: 1.0 / best[name] for name in environments},
        "ratios": {
            f"our whole approach is faster than {fastest}, by": best[fastest] / best[ours],
            "our batch's step rate over CartPole's": best[cart_pole] / best[native],
            "our single step rate over Pendulum's": best[pendulum] / best[single],
        },
        "load_before": load,
        **circumstances("impact-gym", "numpy", "scipy", "numba", "gymnasium"),
    }


def show(results: dict[str, Any]) -> None:
    """Print the figures."""
    console = Console()
    table = Table(title=f"One approach with one contact (Fig. 17b), error in V_p at most {ERROR:.0e} m/s")
    table.add_column("solver")
    table.add_column("µs", justify="right")
    table.add_column("error (m/s)", justify="right")
    for name, row in results["approach"].items():
        table.add_row(name, f"{row['microseconds']:.1f}", f"{row['error_m_per_s']:.1e}")
    console.print(table)
    table = Table(title="Environment steps")
    table.add_column("environment")
    table.add_column("steps/s", justify="right")
    for name, rate in results["environment_steps_per_second"].items():
        table.add_row(name, f"{rate:,.0f}")
    console.print(table)
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
