"""Train every preset with ten seeds and ship the median: `python -m agents.many`, or `make train-all`.

Finished seeds are kept, a run that was killed goes on from its checkpoint: run the command again. Every seed's policy
goes to agents/policies/PRESET/seed-K.npz, what became of it to seeds.json beside it, and the median to PRESET.npz.
"""

import json
import multiprocessing
import shutil
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import tyro

from agents.policy import SHIPPED, load_policy
from agents.settings import Preset, Settings, as_json, default_settings
from agents.train import resume, train, write_json
from impact_gym.validation import whole

PRESETS: tuple[Preset, ...] = get_args(Preset)


@dataclass(frozen=True)
class Many:
    """Train presets with several seeds each and ship the median seed of each by its score on the validation set."""

    presets: tyro.conf.Positional[tuple[Preset, ...]] = PRESETS
    """Which ones, one after the other; all of them unless some are named."""
    seeds: int = 10
    """How many, from 0 on."""
    processes: int = 2
    """Trainings at a time; each uses one core."""
    runs: Path = Path("runs/all")
    """Folder of the run folders, one below PRESET for each seed."""
    policies: Path = SHIPPED
    """Folder for what is shipped."""

    def __post_init__(self) -> None:
        for name in ("seeds", "processes"):
            whole(name, getattr(self, name), at_least=1)


def train_all(preset: Preset, wanted: Many, settings: Settings) -> Path:
    """Train the seeds that are missing, and return the path of the median's policy.

    Raises:
        ValueError: a run that is there has other settings.
    """
    asked_for = [
        replace(settings, seed=seed, simulation_threads=1, out=wanted.runs / preset / f"seed-{seed}")
        for seed in range(wanted.seeds)
    ]
    with ProcessPoolExecutor(wanted.processes, multiprocessing.get_context("spawn")) as pool:
        for done in as_completed([pool.submit(_train_one, one) for one in asked_for]):
            print(f"{preset}: {done.result()}", flush=True)
    rows = [_ship(run.out, wanted.policies / preset / f"seed-{run.seed}.npz") for run in asked_for if run.out]
    chosen = median(rows)
    write_json(wanted.policies / preset / "seeds.json", {"median": chosen["seed"], "seeds": rows})
    shipped = wanted.policies / f"{preset}.npz"
    return load_policy(wanted.policies / preset / f"seed-{chosen['seed']}.npz").save(shipped)


def median(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the row in the middle by score; of two in the middle, the worse one."""
    return sorted(rows, key=lambda row: (row["score"], row["seed"]))[len(rows) // 2]


def _train_one(settings: Settings) -> str:
    """Train, or go on, or find it done; says which seed it was and how it did."""
    folder = settings.out
    assert folder is not None  # train_all says where
    if (folder / "config.json").is_file():
        there = json.loads((folder / "config.json").read_text())["settings"]
        if there != json.loads(json.dumps(as_json(settings))):
            raise ValueError(f"{folder} was trained with other settings: remove it, or name another folder with --runs")
        resume(folder)
    else:
        shutil.rmtree(folder, ignore_errors=True)  # killed before it had begun
        train(settings)
    metrics = json.loads((folder / "metrics.json").read_text())
    return f"seed {settings.seed} scored {metrics['validation']['best']['score']:.4f} m/s"


def _ship(folder: Path, path: Path) -> dict[str, Any]:
    """Copy the best policy of a run to `path`; return what became of the run."""
    policy = load_policy(folder)
    policy.save(path)
    metrics = json.loads((folder / "metrics.json").read_text())
    return {
        "seed": policy.provenance["settings"]["seed"],
        "score": metrics["validation"]["best"]["score"],
        "steps": policy.provenance["steps"],
        **metrics,
    }


def main() -> None:
    """Read from the command line what to train, and train it."""
    try:
        wanted = tyro.cli(Many, prog="python -m agents.many")
        for preset in wanted.presets:
            print(train_all(preset, wanted, default_settings(preset)))
    except ValueError as error:
        sys.exit(f"agents.many: {error}")
    except KeyboardInterrupt:
        sys.exit("agents.many: interrupted; the same command goes on")


if __name__ == "__main__":
    main()
