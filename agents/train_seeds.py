"""Train set-ups with ten seeds each and ship the medians: `python -m agents.train_seeds`, or `make train-all`.

Each training is a job of `agents.jobs`: on this machine's cores, or with `--cluster ray` on an existing Ray cluster.
Finished seeds are kept, a run that was killed goes on from its checkpoint: run the command again. On a cluster that
holds where the nodes see the folder --runs at the same place; where they do not, a training whose node is lost starts
over. Every seed's policy goes to agents/policies/SETUP/seed-K.npz, what became of it to seeds.json beside it, and the
median to SETUP.npz.
"""

import json
import shutil
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from agents.command_line import command_line
from agents.jobs import Job, Result, gather
from agents.policies.policy import load_policy
from agents.setups import README, load_setup
from agents.train.run import made_for, resume, train, write_json
from agents.train.settings import Settings, as_json, default_settings, from_json
from impact_gym.files import whole_file
from impact_gym.validation import whole

KEPT = {"config": "config.json", "best": "best.npz", "final": "final.npz", "metrics": "metrics.json"}
"""What is gathered of a run folder; the last one says that the run is finished."""


@dataclass(frozen=True)
class Seeds:
    """Train set-ups with several seeds each and ship the median seed of each by its score on the validation set."""

    setups: tyro.conf.Positional[tuple[str, ...]] = README
    """Names or files, one after the other; those of the README unless some are named."""
    seeds: int | None = None
    """How many, from 0 on; what the set-up says, or 10, unless given."""
    steps: int | None = None
    """Environment steps of each training at the most; what the set-up says unless given."""
    processes: int = 2
    """Trainings at a time on this machine; each uses one core."""
    cluster: str | None = None
    """Train on this Ray cluster instead, one core each: "ray" for the one that runs here, or its address. Its nodes
    must see the files of set-ups that are not shipped."""
    runs: Path = Path("runs/all")
    """Folder of the run folders, one below SETUP for each seed."""
    policies: Path | None = None
    """Folder for what comes of it; that of the shipped ones unless given, for a set-up from a file
    runs/NAME/policies."""

    def __post_init__(self) -> None:
        whole("processes", self.processes, at_least=1)
        if self.seeds is not None:
            whole("seeds", self.seeds, at_least=1)
        if self.steps is not None:
            whole("steps", self.steps, at_least=1)


def train_all(name: str, wanted: Seeds, settings: Settings) -> Path:
    """Train the seeds that are missing, and return the path of the median's policy.

    Raises:
        ValueError: a run that is there has other settings.
        JobsFailedError: trainings failed; the others are done.
    """
    runs = wanted.runs.resolve() / name
    setup = load_setup(settings.setup)
    seeds = range(setup.seeds if wanted.seeds is None else wanted.seeds)
    asked_for = [replace(settings, seed=seed, simulation_threads=1) for seed in seeds]
    folders = [runs / f"seed-{seed}" for seed in seeds]
    for folder, one in zip(folders, asked_for, strict=True):
        _refuse_other_settings(folder, one)
    jobs = [
        Job("agents.train_seeds:train_one", {"settings": _plain(one), "folder": str(folder), **made_for(one)})
        for folder, one in zip(folders, asked_for, strict=True)
    ]
    processes = None if wanted.cluster else wanted.processes
    for seed, result in gather(jobs, runs / "results", processes=processes, cluster=wanted.cluster, title=name):
        _fill(folders[seed], result)
        score = json.loads(result["metrics"].tobytes())["validation"]["best"]["score"]
        print(f"{name}: seed {seed} scored {score:.4f} m/s", flush=True)
    policies = setup.folder / "policies" if wanted.policies is None else wanted.policies
    rows = [_ship(folder, policies / name / f"{folder.name}.npz") for folder in folders]
    chosen = median(rows)
    write_json(policies / name / "seeds.json", {"median": chosen["seed"], "seeds": rows})
    shipped = policies / f"{name}.npz"
    return load_policy(policies / name / f"seed-{chosen['seed']}.npz").save(shipped)


def median(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the row in the middle by score; of two in the middle, the worse one."""
    return sorted(rows, key=lambda row: (row["score"], row["seed"]))[len(rows) // 2]


def train_one(settings: Mapping[str, Any], folder: str, **set_up: Any) -> Result:
    """Train in a run folder, or go on there, or find it done; return the bytes of the files in KEPT.

    What the set-up says beside the settings makes it another job where that has changed.

    Where the folder cannot be made, as on a node of a cluster without a common one, a temporary one takes its place.
    """
    out, wanted = Path(folder), from_json(settings)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError:
        with tempfile.TemporaryDirectory(prefix="impact-gym-run-") as elsewhere:
            return _bytes(_train_one(replace(wanted, out=Path(elsewhere) / out.name)))
    return _bytes(_train_one(replace(wanted, out=out)))


def _train_one(settings: Settings) -> Path:
    """Train, or go on, or find it done; return the run folder."""
    folder = settings.out
    assert folder is not None  # train_one says where
    if (folder / "config.json").is_file():
        _refuse_other_settings(folder, settings)
        return resume(folder)
    shutil.rmtree(folder, ignore_errors=True)  # killed before it had begun
    return train(settings)


def _bytes(folder: Path) -> Result:
    return {name: np.frombuffer((folder / file).read_bytes(), np.uint8) for name, file in KEPT.items()}


def _refuse_other_settings(folder: Path, settings: Settings) -> None:
    with suppress(FileNotFoundError):
        record = json.loads((folder / "config.json").read_text())
        wanted = {"settings": _plain(settings), **made_for(settings)}
        if any(record.get(name) != value for name, value in wanted.items()):
            other = f"{folder} was trained with other settings or for another environment"
            raise ValueError(f"{other}: remove it, or name another folder with --runs")


def _plain(settings: Settings) -> dict[str, Any]:
    """Return the settings as JSON gives them back."""
    plain: dict[str, Any] = json.loads(json.dumps(as_json(settings)))
    return plain


def _fill(folder: Path, result: Result) -> None:
    """Write the files of a run that was made on another machine, or whose folder is gone."""
    if not (folder / KEPT["metrics"]).is_file():
        for name, file in KEPT.items():
            with whole_file(folder / file) as opened:
                opened.write(result[name].tobytes())


def _ship(folder: Path, path: Path) -> dict[str, Any]:
    """Copy the best policy of a run to `path`; return its row of seeds.json."""
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
    with command_line("agents.train_seeds"):
        wanted = tyro.cli(Seeds, prog="python -m agents.train_seeds")
        for setup in wanted.setups:
            settings = default_settings(setup)
            if wanted.steps is not None:
                steps = min(settings.steps, wanted.steps)
                settings = replace(settings, steps=steps, validate_every=min(settings.validate_every, steps))
            print(train_all(load_setup(setup).name, wanted, settings))


if __name__ == "__main__":
    main()
