"""Search for settings: `python -m agents.tune_training [SETUP] --trials 16`.

Each trial is a short training, judged by the best score it reaches on the validation set; one that is worse than the
median of those before it at the same step is given up. The study is a journal below runs/search: the same command goes
on with it, after a kill as well. Its summary, settings and score of each trial, goes to agents/studies; what it found
best is printed as the table `[training]` of a set-up, for whoever wants it there.
"""

import hashlib
import json
import shlex
import shutil
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import optuna
import tyro
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import Trial, TrialState

from agents.command_line import command_line
from agents.setups import load_setup
from agents.train.callback import CollapsedError
from agents.train.run import made_for, provenance, train, write_json
from agents.train.settings import Settings, default_settings, with_changes
from impact_gym.validation import whole

STUDIES = Path(__file__).parent / "studies"
SPACE: dict[str, BaseDistribution] = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "batch": CategoricalDistribution([1024, 2048, 4096]),
    "weight_power": CategoricalDistribution([0.0, 0.5, 1.0]),
    "rollout": CategoricalDistribution([32, 64]),
    "epochs": IntDistribution(1, 3),
    "gae_lambda": CategoricalDistribution([0.9, 0.95, 0.98, 1.0]),
    "log_std": FloatDistribution(-2.0, -0.7),
}
"""What is looked for; all other settings stay as they are."""
COUNTS = ("trials", "steps", "validate_every", "validation_scenarios")


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
    """Folder of the journals."""
    summaries: Path | None = None
    """Folder of the summaries; agents/studies unless given, for a set-up from a file runs/NAME."""

    def __post_init__(self) -> None:
        for name in COUNTS:
            whole(name, getattr(self, name), at_least=1)


def search(options: Search) -> Path:
    """Run the trials that are missing, and return the path of the summary."""
    start = replace(
        default_settings(options.setup),
        steps=options.steps,
        validate_every=options.validate_every,
        validation_scenarios=options.validation_scenarios,
        checkpoint_every=options.steps,
    )
    setup = load_setup(options.setup)
    folder = options.summaries or (STUDIES if setup.shipped else setup.folder)
    summary = folder / f"{setup.name}.json"
    content = json.dumps([made_for(start), {name: vars(one) for name, one in SPACE.items()}], sort_keys=True)
    digest = hashlib.sha256(content.encode()).hexdigest()[:8]  # another study where that has changed
    name = f"{setup.name}-{options.steps}-{digest}"
    options.journals.mkdir(parents=True, exist_ok=True)
    study = optuna.create_study(
        storage=JournalStorage(JournalFileBackend(str(options.journals / f"{name}.journal"))),
        study_name=name,
        load_if_exists=True,
        pruner=optuna.pruners.MedianPruner(n_startup_trials=4, n_warmup_steps=options.steps // 3),
    )
    for killed in study.get_trials(states=(TrialState.RUNNING,)):
        study.tell(killed.number, state=TrialState.FAIL)
    if not study.trials:
        values = {setting: getattr(start, setting) for setting in SPACE}  # what is to be beaten
        study.enqueue_trial({setting: value for setting, value in values.items() if _holds(SPACE[setting], value)})
    while len(_finished(study)) < options.trials:
        # seeded anew in each process, so with another seed, or it would suggest the same again
        study.sampler = optuna.samplers.TPESampler(seed=len(study.trials), n_startup_trials=6)
        trial = study.ask(SPACE)
        settings = replace(
            with_changes(start, trial.params),
            seed=1000 + trial.number,  # none of those that train-all uses
            out=options.journals / f"{name}-{trial.number}",
        )
        _play(study, trial, settings)
        write_json(summary, _summary(study, start, options))
    write_json(summary, _summary(study, start, options))
    return summary


def _play(study: optuna.Study, trial: Trial, settings: Settings) -> None:
    """Train as `trial` suggests and tell the study what came of it."""
    scores: list[float] = []

    def on_validation(steps: int, result: dict[str, Any]) -> None:
        scores.append(result["score"])
        trial.report(min(scores), steps)
        if steps < settings.whole_steps and trial.should_prune():
            raise optuna.TrialPruned

    try:
        train(settings, on_validation)
        study.tell(trial, min(scores))
    except (optuna.TrialPruned, CollapsedError):
        study.tell(trial, state=TrialState.PRUNED)
    shutil.rmtree(settings.out)


def _finished(study: optuna.Study) -> list[optuna.trial.FrozenTrial]:
    return study.get_trials(states=(TrialState.COMPLETE, TrialState.PRUNED))


def _holds(distribution: BaseDistribution, value: Any) -> bool:
    """Return whether the search space contains a value."""
    if isinstance(distribution, CategoricalDistribution):
        return value in distribution.choices
    return distribution.low <= value <= distribution.high


def _summary(study: optuna.Study, start: Settings, options: Search) -> dict[str, Any]:
    trials = [
        {
            "number": trial.number,
            "state": trial.state.name.lower(),
            "score": trial.value,
            "steps": trial.last_step,
            "parameters": trial.params,
        }
        for trial in _finished(study)
    ]
    best = study.best_trial
    found = {"number": best.number, "score": best.value, "settings": best.params}
    words = ["python", "-m", "agents.tune_training", options.setup]
    for name in COUNTS:
        words += [f"--{name}".replace("_", "-"), str(getattr(options, name))]
    return {"best": found, **provenance(start), "command": shlex.join(words), "trials": trials}


def training_table(settings: Mapping[str, Any]) -> str:
    """Return settings as the table [training] of a set-up."""
    return "\n".join(["[training]", *(f"{key} = {json.dumps(value)}" for key, value in settings.items()), ""])


def main() -> None:
    """Read from the command line what to search for, and search."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
    with command_line("agents.tune_training"):
        summary = search(tyro.cli(Search, prog="python -m agents.tune_training"))
        print(training_table(json.loads(summary.read_text())["best"]["settings"]), summary, sep="\n")


if __name__ == "__main__":
    main()
