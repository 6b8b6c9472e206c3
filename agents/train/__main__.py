"""Train a policy: `impact-gym train [SETUP]`, or with `--seeds` several, of which the median is shipped."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro

from agents.command_line import command_line, read_command
from agents.setups import Training, load_setup
from agents.train.ppo import Run, resume, train
from agents.train.seeds import train_seeds
from impact_gym.validation import whole


@dataclass(frozen=True)
class TrainOptions:
    """Train a policy on ImpactApproach-v0: a single one, or with --seeds several, of which the median is shipped."""

    setup: tyro.conf.Positional[str] = "linear-blind"
    """Set-up by name or file, which has the default settings."""
    training: Annotated[Training, tyro.conf.arg(name="")] = field(default_factory=Training)
    """Settings."""
    seed: int = 0
    """Seed of the scenarios, the network and the exploration; scenarios are others than in evaluation."""
    seeds: int | None = None
    """Train this many seeds, from 0 on, and ship the median by its score on the validation set, with all others in the
    same file. Finished seeds are kept: the same command continues."""
    out: Path | None = None
    """Run folder, which must not exist; a new one below runs/ unless given. With --seeds the folder of the run folders,
    runs/all/SETUP unless given."""
    policies: Path | None = None
    """With --seeds: folder of the file with the policies; that of the shipped ones unless given, for a set-up from a
    file runs/NAME/policies."""
    processes: int = 2
    """With --seeds: trainings at a time on this machine, each on one core; 0: none but this process."""
    cluster: str | None = None
    """With --seeds: train on this Ray cluster instead, one core each: "ray" for the one that runs here, or its address.
    Its nodes must see the files of set-ups that are not shipped."""
    resume: Path | None = None
    """Resume the run in this folder, from its last checkpoint and with its settings; allows no other option."""

    def __post_init__(self) -> None:
        whole("processes", self.processes, at_least=0)
        if self.seeds is not None:
            whole("seeds", self.seeds, at_least=1)
            if self.seed:
                raise ValueError(f"seed must be 0 with seeds, which counts from there, got {self.seed}")


def read_options(arguments: Sequence[str]) -> TrainOptions:
    """Return the options on a command line; settings that are not given are the set-up's.

    Raises:
        ValueError: there is no such set-up, or options beside --resume.
    """
    default = default_options(read_command("train", TrainOptions, arguments).setup)
    options = read_command("train", TrainOptions, arguments, default)
    if options.resume and options != replace(default, resume=options.resume):
        raise ValueError("--resume takes its settings from the run: give nothing else")
    return options


def default_options(setup: str) -> TrainOptions:
    """Return the options of `impact-gym train SETUP` without any others."""
    return TrainOptions(setup, load_setup(setup).training)


def run(options: TrainOptions) -> Path:
    """Train; return the run folder, or with several seeds the file of their policies."""
    if options.resume:
        return resume(options.resume)
    setup = load_setup(options.setup)
    if options.seeds is None:
        return train(Run(setup, options.training, options.seed), options.out)
    out, policies = options.out or Path("runs/all") / setup.name, options.policies or setup.folder / "policies"
    return train_seeds(setup, options.training, options.seeds, out, policies, options.processes, options.cluster)


def main() -> None:
    """Train as the command line asks, and print the path of the result."""
    with command_line("train", "the same command continues with --seeds, --resume with the run folder without"):
        print(run(read_options(sys.argv[1:])))


if __name__ == "__main__":
    main()
