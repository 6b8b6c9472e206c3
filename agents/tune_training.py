"""Search for settings of a training: `impact-gym tune-training [SETUP] --trials 16`.

Each trial is a short training, judged by the best score it reaches on the validation set; one that is worse than the
median of those before it at the same step is given up. The study is a journal below runs/search: the same command
continues it, after a kill as well. Its summary, settings and score of each trial, stands beside it; the best settings
are printed as the table `[training]` of a set-up.
"""

import hashlib
import json
import shutil
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import optuna
import tomli_w
import tyro
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import Trial, TrialState

from agents.command_line import command_of, run_command
from agents.setups import Training, load_setup
from agents.train.callback import CollapsedError
from agents.train.ppo import Run, train, write_json
from impact_gym.validation import whole

SPACE: dict[str, BaseDistribution] = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "batch": CategoricalDistribution([1024, 2048, 4096]),
    "weight_power": CategoricalDistribution([0.0, 0.5, 1.0]),
    "rollout": CategoricalDistribution([32, 64]),
    "epochs": IntDistribution(1, 3),
    "gae_lambda": CategoricalDistribution([0.9, 0.95, 0.98, 1.0]),
    "log_std": FloatDistribution(-2.0, -0.7),
}
"""The settings that are searched; all others stay as they are."""
FINISHED = (TrialState.COMPLETE, TrialState.PRUNED)
FIRST_SEED = 1000  # of the trials: none of those that are trained and shipped


@dataclass(frozen=True)
class Search:
    """Search for the settings of a training."""

    setup: tyro.conf.Positional[str] = "linear-blind"
    """Name or file of the set-up that is trained for."""
    trials: int = 16
    """How many trials the study shall have in the end; those it has already count."""
    steps: int = 3_000_000
    """Environment steps of each."""
    validate_every: int = 500_000
    """Steps between two plays of the validation set; there a trial may be given up."""
    validation_scenarios: int = 1000
    """How many of its scenarios."""
    journals: Path = Path("runs/search")
    """Folder of the journal and of the summary, NAME.json."""

    def __post_init__(self) -> None:
        for name in ("trials", "steps", "validate_every", "validation_scenarios"):
            whole(name, getattr(self, name), at_least=1)


def search(options: Search, training: Training | None = None) -> Path:
    """Run the trials that are missing, and return the path of the summary.

    The search begins with the settings in `training`, those of the set-up unless given.
    """
    setup = load_setup(options.setup)
    extent = {name: getattr(options, name) for name in ("steps", "validate_every", "validation_scenarios")}
    training = replace(training or setup.training, **extent, checkpoint_every=options.steps)
    start = Run(setup, training, FIRST_SEED)
    content = json.dumps([start.made_for(), {name: vars(values) for name, values in SPACE.items()}], sort_keys=True)
    digest = hashlib.sha256(content.encode()).hexdigest()[:8]  # another study where that has changed
    name, summary = f"{setup.name}-{options.steps}-{digest}", options.journals / f"{setup.name}.json"
    study = _study(options.journals / f"{name}.journal", name, options.steps)
    if not study.trials:
        values = {setting: getattr(training, setting) for setting in SPACE}  # to be beaten
        study.enqueue_trial({setting: value for setting, value in values.items() if _holds(SPACE[setting], value)})
    while len(study.get_trials(states=FINISHED)) < options.trials:
        # seeded anew in each process, so with another seed, or it would suggest the same again
        study.sampler = optuna.samplers.TPESampler(seed=len(study.trials), n_startup_trials=6)
        trial = study.ask(SPACE)
        run = Run(setup, training.changed(trial.params), FIRST_SEED + trial.number)
        study.tell(trial, *_score(trial, run, options.journals / f"{name}-{trial.number}"))
        _write(summary, study, start, options)
    _write(summary, study, start, options)
    return summary


def _study(journal: Path, name: str, steps: int) -> optuna.Study:
    """Return the study in a journal, a new one if there is none; trials that were killed in it have failed."""
    journal.parent.mkdir(parents=True, exist_ok=True)
    storage = JournalStorage(JournalFileBackend(str(journal)))
    pruner = optuna.pruners.MedianPruner(n_startup_trials=4, n_warmup_steps=steps // 3)
    study = optuna.create_study(storage=storage, study_name=name, load_if_exists=True, pruner=pruner)
    for killed in study.get_trials(states=(TrialState.RUNNING,)):
        study.tell(killed.number, state=TrialState.FAIL)
    return study


def _score(trial: Trial, run: Run, folder: Path) -> tuple[float | None, TrialState]:
    """Train in `folder`, for a while; return the best score, or None where the trial was given up."""
    scores: list[float] = []

    def on_validation(steps: int, result: dict[str, Any]) -> None:
        scores.append(result["score"])
        trial.report(min(scores), steps)
        if steps < run.training.whole_steps and trial.should_prune():
            raise optuna.TrialPruned

    try:
        train(run, folder, on_validation)
    except (optuna.TrialPruned, CollapsedError):
        return None, TrialState.PRUNED
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return min(scores), TrialState.COMPLETE


def _holds(distribution: BaseDistribution, value: Any) -> bool:
    """Return whether the search space contains a value."""
    if isinstance(distribution, CategoricalDistribution):
        return value in distribution.choices
    assert isinstance(distribution, FloatDistribution | IntDistribution)
    return bool(distribution.low <= value <= distribution.high)


def _write(summary: Path, study: optuna.Study, start: Run, options: Search) -> None:
    """Write how the study came about, the best trial, and all of them."""
    names = {"number": "number", "score": "value", "steps": "last_step", "parameters": "params"}
    trials = [
        {"state": trial.state.name.lower()} | {name: getattr(trial, field) for name, field in names.items()}
        for trial in study.get_trials(states=FINISHED)
    ]
    best = {"number": study.best_trial.number, "score": study.best_value, "settings": study.best_params}
    made = {**start.record(), "command": command_of("tune-training", options)}
    write_json(summary, {"best": best, **made, "trials": trials})


def run(options: Search) -> None:
    """Search, and print the best settings as the table [training] of a set-up."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
    summary = search(options)
    print(tomli_w.dumps({"training": json.loads(summary.read_text())["best"]["settings"]}), summary, sep="\n")


if __name__ == "__main__":
    run_command("tune-training", Search, run)
