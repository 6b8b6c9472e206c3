"""One training, from its settings to a run folder, through any number of interruptions.

The folder holds `config.json` (settings, versions, command), `progress.csv` and events for TensorBoard, `best.npz` (the
policy that did best on the validation set) and `final.npz`, `metrics.json` (with the training rate), and until the end
`checkpoint.npz`, from which `resume` goes on to the same end as if nothing had happened. Where a training collapsed,
`collapsed.txt` says why.
"""

import fcntl
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.logger import Logger

from agents.baselines import PaperTrapezoid
from agents.policies.policy import load_policy
from agents.provenance import circumstances, revision
from agents.setups import load_setup
from agents.setups.feasible import warnings
from agents.setups.keys import within
from agents.train import checkpoint
from agents.train.callback import CollapsedError, OnValidation, TrainingCallback
from agents.train.imitation import Teacher
from agents.train.logs import outputs
from agents.train.ppo import make_environment, make_model
from agents.train.settings import FIRST_SEED, SLOTS, Settings, as_json, command, from_json
from impact_gym.envs.task import Task
from impact_gym.files import whole_file

PACKAGES = ("impact-gym", "gymnasium", "numpy", "scipy", "stable-baselines3", "torch")


def train(settings: Settings, on_validation: OnValidation | None = None) -> Path:
    """Train, write the run folder, and return its path; `on_validation` is called after each validation.

    Raises:
        FileExistsError: the run folder is there already.
        ValueError: the run to resume is damaged, of another version, or under way.
        CollapsedError: there is nothing left to go on from; the folder keeps the reason.
    """
    if settings.resume:
        return resume(settings.resume, on_validation)
    with within(settings.setup):
        for sentence in warnings(Task(**settings.environment)):
            print(f"warning: {sentence}")
    stamp, name = datetime.now(UTC).strftime("%Y%m%d-%H%M%S"), load_setup(settings.setup).name
    folder = settings.out or Path("runs") / f"{stamp}-{name}-seed{settings.seed}"
    folder.mkdir(parents=True)
    write_json(folder / "config.json", provenance(settings))
    return resume(folder, on_validation)


def resume(folder: Path, on_validation: OnValidation | None = None) -> Path:
    """Go on with the run in `folder` from its last checkpoint, or from its beginning, and return the folder."""
    record, settings = _configuration(folder)
    collapsed = folder / "collapsed.txt"
    with _locked(folder):
        if collapsed.is_file():
            raise CollapsedError(f"{folder}: {collapsed.read_text()}")
        if not (folder / "metrics.json").is_file():
            try:
                _run(folder, settings, record, on_validation)
            except CollapsedError as error:
                collapsed.write_text(str(error))
                raise
    return folder


def _run(folder: Path, settings: Settings, record: dict[str, Any], on_validation: OnValidation | None) -> None:
    torch.set_num_threads(settings.threads)
    torch.distributions.Distribution.set_default_validate_args(False)  # slow; the environment checks what it is given
    environment = make_environment(settings)
    model = make_model(settings, environment)
    environment.seed(FIRST_SEED + settings.seed * SLOTS)
    callback = TrainingCallback(folder, settings, record, environment, on_validation)
    log = Logger(str(folder), [])
    model.set_logger(log)
    saved = folder / "checkpoint.npz"
    if saved.is_file():
        callback.kept |= checkpoint.restore(saved, model, environment)
        print(f"going on behind {model.num_timesteps:,} of {settings.whole_steps:,} steps")
    else:
        print(f"training for {settings.whole_steps:,} steps; torch uses {settings.threads} thread(s)")
    log.output_formats = outputs(folder, model.num_timesteps)
    try:
        model.learn(
            settings.whole_steps - model.num_timesteps,
            callback=callback,
            log_interval=None,  # the callback writes the log
            reset_num_timesteps=not saved.is_file(),
            progress_bar=sys.stderr.isatty(),
        )
    finally:
        log.close()
    rule = callback.validation.score(PaperTrapezoid().for_environment(settings.environment))
    judged = {name: load_policy(folder / f"{name}.npz").provenance["validation"] for name in ("best", "final")}
    metrics = {
        "validation": {**judged, "paper's rule": rule},
        "curve": [{"steps": steps, "score": score} for steps, score in callback.kept["curve"]],
        "clock": callback.kept["clock"],
        "training_seconds": callback.kept["seconds"],
        "steps_per_second": settings.whole_steps / callback.kept["seconds"],
    }
    write_json(folder / "metrics.json", metrics)
    saved.unlink(missing_ok=True)
    for name, means in metrics["validation"].items():
        points = zip(means["time_weight"], means["object_velocity"], means["approach_time"], strict=True)
        listed = "; ".join(f"at {w:g}: {v:.3f} m/s, {t:.3f} s" for w, v, t in points)
        print(f"{name}: score {means['score']:.4f} m/s; V_p and approach time {listed}")


def _configuration(folder: Path) -> tuple[dict[str, Any], Settings]:
    """Return what the run was started with.

    Raises:
        ValueError: the folder holds no run, or one of another version.
    """
    path = folder / "config.json"
    try:
        record = json.loads(path.read_text())
        settings = from_json(record["settings"])
        if any(record[name] != value for name, value in made_for(settings).items()):
            raise ValueError(f"the set-up {settings.setup} has changed since")
        return record, settings
    except (OSError, LookupError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{folder} holds no run that this version can go on with: {error}") from error


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the run folder, so that no two processes write into it; a killed process lets go of it."""
    with (folder / "lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise ValueError(f"{folder} is being written by another process") from error
        for unfinished in folder.glob(".*.npz.*"):  # what a killed process was writing
            unfinished.unlink()
        yield


def write_json(path: Path, content: Any) -> None:
    """Write `content` to `path`, whole or not at all."""
    with whole_file(path) as file:
        file.write((json.dumps(content, indent=2) + "\n").encode())


def made_for(settings: Settings) -> dict[str, Any]:
    """Return what a run was made for, as JSON gives it back: environment, validation weights, teacher, nominal arm."""
    evaluation = load_setup(settings.setup).evaluation
    also: dict[str, Any] = {}
    if settings.teacher:
        also["teacher"] = Teacher(settings.setup, settings.teacher).checksum
    if settings.nominal:
        also["nominal"] = dict(evaluation.nominal)
    return json.loads(json.dumps({"environment": settings.environment, "weights": evaluation.weights, **also}))


def provenance(settings: Settings) -> dict[str, Any]:
    """Return what it takes to repeat a run."""
    return {
        "command": command(settings),
        "settings": as_json(settings),
        **made_for(settings),
        **revision(),
        **circumstances(*PACKAGES),
    }
