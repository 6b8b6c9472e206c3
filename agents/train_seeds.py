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
        for name in ("processes", "seeds", "steps"):
            if getattr(self, name) is not None or name == "processes":
                whole(name, getattr(self, name), at_least=1)


def train_all(name: str, options: Seeds, settings: Settings) -> Path:
    """Train the seeds that are missing, and return the path of the median's policy.

    Raises:
        ValueError: a run that is there has other settings.
        JobsFailedError: trainings failed; the others are done.
    """
    runs = options.runs.resolve() / name
    setup = load_setup(settings.setup)
    folders = [runs / f"seed-{seed}" for seed in range(setup.seeds if options.seeds is None else options.seeds)]
    jobs = []
    for seed, folder in enumerate(folders):
        record = _record(replace(settings, seed=seed, simulation_threads=1))
        _refuse_another(folder, record)
        jobs.append(Job("agents.train_seeds:train_one", {"folder": str(folder), **record}))
    processes = None if options.cluster else options.processes
    for seed, result in gather(jobs, runs / "results", processes=processes, cluster=options.cluster, title=name):
        _fill(folders[seed], result)
        score = json.loads(result["metrics"].tobytes())["validation"]["best"]["score"]
        print(f"{name}: seed {seed} scored {score:.4f} m/s", flush=True)
    policies = setup.folder / "policies" if options.policies is None else options.policies
    rows = [_ship(folder, policies / name / f"{folder.name}.npz") for folder in folders]
    chosen = median(rows)["seed"]
    write_json(policies / name / "seeds.json", {"median": chosen, "seeds": rows})
    return load_policy(policies / name / f"seed-{chosen}.npz").save(policies / f"{name}.npz")


def median(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the row in the middle by score; of two in the middle, the worse one."""
    return sorted(rows, key=lambda row: (row["score"], row["seed"]))[len(rows) // 2]


def train_one(settings: Mapping[str, Any], folder: str, **set_up: Any) -> Result:
    """Train in a run folder, or go on there, or find it done; return the bytes of the files in KEPT.

    What the set-up says beside the settings, `set_up`, makes it another job where that has changed.

    Where the folder cannot be made, as on a node of a cluster without a common one, a temporary one takes its place.
    """
    run = Path(folder)
    with tempfile.TemporaryDirectory(prefix="impact-gym-run-") as elsewhere:
        try:
            run.parent.mkdir(parents=True, exist_ok=True)
        except OSError:
            run = Path(elsewhere) / run.name
        if (run / "config.json").is_file():
            _refuse_another(run, _record(from_json(settings)))
            resume(run)
        else:
            shutil.rmtree(run, ignore_errors=True)  # killed before it had begun
            train(replace(from_json(settings), out=run))
        return {name: np.frombuffer((run / file).read_bytes(), np.uint8) for name, file in KEPT.items()}


def _record(settings: Settings) -> dict[str, Any]:
    """Return what a run is made with, as JSON gives it back."""
    return json.loads(json.dumps({"settings": as_json(settings), **made_for(settings)}))


def _refuse_another(folder: Path, record: Mapping[str, Any]) -> None:
    """Raise ValueError if the folder holds a run that was made with something else."""
    with suppress(FileNotFoundError):
        found = json.loads((folder / "config.json").read_text())
        if any(found.get(name) != value for name, value in record.items()):
            other = f"{folder} was trained with other settings or for another environment"
            raise ValueError(f"{other}: remove it, or name another folder with --runs")


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
    """Train what the command line asks for."""
    with command_line("agents.train_seeds"):
        options = tyro.cli(Seeds, prog="python -m agents.train_seeds")
        for setup in options.setups:
            settings = default_settings(setup)
            if options.steps is not None:
                steps = min(settings.steps, options.steps)
                settings = replace(settings, steps=steps, validate_every=min(settings.validate_every, steps))
            print(train_all(load_setup(setup).name, options, settings))


if __name__ == "__main__":
    main()
