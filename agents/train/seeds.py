"""Train policies of a set-up with several seeds; the default policy in their file has the median validation score.

`agents.jobs` stores finished trainings, and a killed training resumes from the checkpoint. On a cluster, resuming needs
run folders under the same path on all nodes.
"""

import json
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from agents.jobs import cached
from agents.policies import Ensemble, Policy, load_policy
from agents.setups import Setup, Training
from agents.train.ppo import Run, resume, train
from impact_gym.support.files import write_file

KEPT = ("config.json", "best.npz", "final.npz", "metrics.json")
"""Files of a run folder that a job returns; `metrics.json` exists only if the run is finished."""


def train_seeds(
    setup: Setup, training: Training, seeds: int, out: Path, policies: Path, processes: int | None = None,
    cluster: str | None = None,
) -> Path:  # fmt: skip
    """Train with the seeds 0 to `seeds` - 1, but reuse finished runs in `out`; return the file of all policies."""
    training = replace(training, simulation_threads=1)  # the number of threads does not change the result
    folders = [out.resolve() / f"seed-{seed}" for seed in range(seeds)]
    arguments = list[dict[str, Any]]()
    for seed, folder in enumerate(folders):
        arguments.append({"folder": str(folder), "made_for": Run(setup, training, seed).made_for()})
        _refuse_another(**arguments[-1])

    def fill(seed: int, files: Mapping[str, bytes]) -> None:
        if not (folders[seed] / KEPT[-1]).is_file():
            for name, content in files.items():
                write_file(folders[seed] / name, content)
        score = load_policy(folders[seed]).provenance["validation"]["score"]
        print(f"{setup.name}: seed {seed} scored {score:.4f} m/s", flush=True)

    cached(train_one, arguments, out / "results", done=fill, title=setup.name, processes=processes, cluster=cluster)
    trained = [load_policy(folder) for folder in folders]
    return Ensemble(trained, median(trained).seed).save(policies / f"{setup.name}.npz")


def median(policies: list[Policy]) -> Policy:
    """Return the policy with the median score; for an even number of policies, the worse of the middle two."""
    ordered = sorted(policies, key=lambda policy: (policy.provenance["validation"]["score"], policy.seed))
    return ordered[len(policies) // 2]


def train_one(folder: str, made_for: Mapping[str, Any]) -> dict[str, bytes]:
    """Train, resume or reuse the run in `folder` with the settings `made_for`; return the content of the files KEPT."""
    run = Path(folder)
    with tempfile.TemporaryDirectory(prefix="impact-gym-run-") as elsewhere:
        try:
            run.parent.mkdir(parents=True, exist_ok=True)
        except OSError:  # for example, this node of a cluster cannot access the folder
            run = Path(elsewhere) / run.name
        if (run / "config.json").is_file():
            _refuse_another(str(run), made_for)  # checked again, because `train_seeds` may run on another machine
            resume(run)
        else:
            shutil.rmtree(run, ignore_errors=True)  # remains of a training that was killed before it wrote config.json
            train(Run.of_record(made_for["settings"]), run)
        return {name: (run / name).read_bytes() for name in KEPT}


def _refuse_another(folder: str, made_for: Mapping[str, Any]) -> None:
    path = Path(folder) / "config.json"
    config = json.loads(path.read_text()) if path.is_file() else made_for
    if any(config.get(name) != value for name, value in made_for.items()):
        other = f"{folder} holds a training with other settings or another environment"
        raise ValueError(f"{other}: remove this folder, or name another folder with --out")
