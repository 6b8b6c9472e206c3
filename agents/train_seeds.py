"""Train set-ups with ten seeds each and ship the medians: `impact-gym train-seeds`, or `make train-all`.

Each training is a job of `agents.jobs`: on this machine's cores, or with `--cluster ray` on an existing Ray cluster.
Finished seeds are kept, a run that was killed goes on from its checkpoint: run the command again. On a cluster that
holds where the nodes see the folder --runs at the same place; where they do not, a training whose node is lost starts
over. All seeds' policies go to agents/policies/SETUP.npz, in which the median stands for all.
"""

import json
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from agents.command_line import run_command
from agents.jobs import Job, Result, gather
from agents.policies import Ensemble, Policy, load_policy
from agents.setups import README, Setup, load_setup
from agents.train.ppo import Run, resume, train
from impact_gym.files import write_file
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
    """Trainings at a time on this machine, each on one core; 0: none but this process."""
    cluster: str | None = None
    """Train on this Ray cluster instead, one core each: "ray" for the one that runs here, or its address. Its nodes
    must see the files of set-ups that are not shipped."""
    runs: Path = Path("runs/all")
    """Folder of the run folders, one below SETUP for each seed."""
    policies: Path | None = None
    """Output folder for policies; that of the shipped ones unless given, for a set-up from a file
    runs/NAME/policies."""

    def __post_init__(self) -> None:
        for name, least in (("processes", 0), ("seeds", 1), ("steps", 1)):
            if getattr(self, name) is not None:
                whole(name, getattr(self, name), at_least=least)


def train_all(setup: Setup, options: Seeds) -> Path:
    """Train the seeds that are missing, and return the path of the policies.

    Raises:
        ValueError: a run that is there has other settings.
        JobsFailedError: trainings failed; the others are done.
    """
    training, runs = replace(setup.training, simulation_threads=1), options.runs.resolve() / setup.name
    if options.steps is not None:
        steps = min(training.steps, options.steps)
        training = replace(training, steps=steps, validate_every=min(training.validate_every, steps))
    seeds = range(training.seeds if options.seeds is None else options.seeds)
    folders = [runs / f"seed-{seed}" for seed in seeds]
    jobs = []
    for seed, folder in zip(seeds, folders, strict=True):
        record = Run(setup, training, seed).made_for()
        _refuse_another(folder, record)
        jobs.append(Job("agents.train_seeds:train_one", {"folder": str(folder), "made_for": record}))
    processes = None if options.cluster else options.processes
    for seed, result in gather(jobs, runs / "results", processes=processes, cluster=options.cluster, title=setup.name):
        _fill(folders[seed], result)
        print(f"{setup.name}: seed {seed} scored {score(load_policy(folders[seed])):.4f} m/s", flush=True)
    policies = [load_policy(folder) for folder in folders]
    folder = setup.folder / "policies" if options.policies is None else options.policies
    return Ensemble(policies, median(policies).seed).save(folder / f"{setup.name}.npz")


def score(policy: Policy) -> float:
    """Return a policy's mean cost on the validation set, m/s."""
    return float(policy.provenance["validation"]["score"])


def median(policies: list[Policy]) -> Policy:
    """Return the policy in the middle by score; of two in the middle, the worse one."""
    return sorted(policies, key=lambda policy: (score(policy), policy.seed))[len(policies) // 2]


def train_one(folder: str, made_for: Mapping[str, Any]) -> Result:
    """Train in a run folder what a run is `made_for`, or go on there, or find it done; return the files in KEPT.

    Where the folder cannot be made, as on a node of a cluster without a common one, a temporary one takes its place.
    """
    run = Path(folder)
    with tempfile.TemporaryDirectory(prefix="impact-gym-run-") as elsewhere:
        try:
            run.parent.mkdir(parents=True, exist_ok=True)
        except OSError:
            run = Path(elsewhere) / run.name
        if (run / "config.json").is_file():
            _refuse_another(run, made_for)  # which may lie on a node of a cluster alone
            resume(run)
        else:
            shutil.rmtree(run, ignore_errors=True)  # killed before it had begun
            train(Run.of_record(made_for["settings"]), run)
        return {name: np.frombuffer((run / file).read_bytes(), np.uint8) for name, file in KEPT.items()}


def _refuse_another(folder: Path, made_for: Mapping[str, Any]) -> None:
    """Raise ValueError if the folder holds a run that was made with something else."""
    config = json.loads((folder / "config.json").read_text()) if (folder / "config.json").is_file() else made_for
    if any(config.get(name) != value for name, value in made_for.items()):
        other = f"{folder} was trained with other settings or for another environment"
        raise ValueError(f"{other}: remove it, or name another folder with --runs")


def _fill(folder: Path, result: Result) -> None:
    """Write the files of a run that was made on another machine, or whose folder is gone."""
    if not (folder / KEPT["metrics"]).is_file():
        for name, file in KEPT.items():
            write_file(folder / file, result[name].tobytes())


def run(options: Seeds) -> None:
    """Train what is missing of each set-up, and print where its policies are."""
    for name in options.setups:
        print(train_all(load_setup(name), options))


if __name__ == "__main__":
    run_command("train-seeds", Seeds, run)
