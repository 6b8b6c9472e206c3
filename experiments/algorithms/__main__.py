"""Four algorithms with the same search budget and ten seeds each: `python -m experiments.algorithms`.

For each set-up and algorithm: a search of TRIALS short trainings on seeds of their own, then SEEDS trainings with what
it found. A trial and a training have as many steps as each algorithm makes in about TRIAL and TRAINING seconds of one
core with the settings that the search begins with; PPO's teacher is left out, as no other algorithm here can have one.
What is done is kept in --runs: the same command goes on.
"""

import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import optuna
import tyro

from agents.command_line import command_line
from agents.train.settings import Algorithm, Settings, default_settings, with_changes
from agents.train_seeds import Seeds, train_all
from agents.tune_training import Search, search
from experiments.algorithms.figures import learning_curves
from experiments.algorithms.results import curves, finals
from experiments.lab.charts import save
from impact_gym.files import whole_file

TRIALS, TRIAL, SEEDS, TRAINING = 8, 40, 10, 80
VALIDATIONS = 12  # of a training, its learning curve
RATES: dict[str, dict[Algorithm, int]] = {
    "linear-blind": {"ppo": 69_000, "recurrent_ppo": 5_600, "sac": 640, "tqc": 180},
    "linear-ranged": {"ppo": 60_000, "recurrent_ppo": 5_600, "sac": 640, "tqc": 180},
    "linear-robust": {"ppo": 37_000, "recurrent_ppo": 5_400, "sac": 640, "tqc": 180},
}
"""Environment steps per second of one core, four trainings side by side on four threads of two cores; of sac and tqc
behind the random steps, which cost next to nothing."""


@dataclass(frozen=True)
class Comparison:
    """Search for the settings of each algorithm on each set-up, then train ten seeds."""

    runs: Path = Path("runs/algorithms")
    """Folder for all that comes of it."""
    processes: int = 2
    """Trainings at a time."""


def begin(setup: str, algo: Algorithm, seconds: int, validations: int) -> Settings:
    """Return the settings an algorithm begins with, for about so many seconds of training."""
    settings = default_settings(setup, algo)
    settings = replace(settings, on_policy=replace(settings.on_policy, teacher=""), simulation_threads=1)
    random = 0 if "ppo" in algo else settings.off_policy.warm_up
    steps = random + RATES[setup][algo] * seconds
    return replace(settings, steps=steps, validate_every=steps // validations, checkpoint_every=steps)


def found(pair: tuple[str, Algorithm], folder: Path) -> Path:
    """Search for the settings of an algorithm on a set-up; return the path of the summary."""
    setup, algo = pair
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    start = begin(setup, algo, TRIAL, 4)
    options = Search(
        setup, algo, TRIALS, start.steps, start.validate_every, journals=folder / "search", summaries=folder / "studies"
    )
    return search(options, start)


def write(pairs: Sequence[tuple[str, Algorithm]], folder: Path) -> None:
    """Write curves.csv, finals.csv and curves.svg into the folder."""
    drawn, scored = curves(pairs, folder / "policies"), finals(pairs, folder / "policies")
    for name, table in (("curves.csv", drawn), ("finals.csv", scored)):
        with whole_file(folder / name) as file:
            table.write_csv(file, float_precision=4)
    print(save(learning_curves(drawn), folder / "curves.svg"), scored, sep="\n")


def main() -> None:
    """Search, then train."""
    with command_line("experiments.algorithms"):
        options = tyro.cli(Comparison, prog="python -m experiments.algorithms")
        pairs = [(setup, algo) for setup, algorithms in RATES.items() for algo in algorithms]
        with ProcessPoolExecutor(options.processes) as pool:
            summaries = list(pool.map(partial(found, folder=options.runs), pairs))
        for (setup, algo), summary in zip(pairs, summaries, strict=True):
            best = json.loads(summary.read_text())["best"]["settings"]
            settings = with_changes(begin(setup, algo, TRAINING, VALIDATIONS), best)
            name = f"{setup}-{algo}"
            seeds = Seeds((setup,), SEEDS, processes=options.processes, runs=options.runs / "trainings")
            print(train_all(name, replace(seeds, policies=options.runs / "policies"), settings))
        write(pairs, options.runs)


if __name__ == "__main__":
    main()
