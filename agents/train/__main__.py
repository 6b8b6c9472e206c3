"""Train a policy: `impact-gym train [SETUP]`; with `--seeds` train several, whose median represents the set-up."""

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
    """Train a policy on ImpactApproach-v0; with --seeds train several policies, whose median represents the set-up."""

    setup: tyro.conf.Positional[str] = "linear-blind"
    """Set-up, by name or file. It determines the defaults of the settings."""
    training: Annotated[Training, tyro.conf.arg(name="")] = field(default_factory=Training)
    """Settings."""
    seed: int = 0
    """Seed of scenarios, network and exploration. The scenarios of the evaluation have other seeds."""
    seeds: int | None = None
    """Number of seeds to train, from 0 on. The policies of all seeds are written into one file; the median by the
    validation score represents them. Finished seeds are kept; run the same command again to train the remaining
    ones."""
    out: Path | None = None
    """Folder for this training's files. It must not exist yet. Default: a new folder below runs/. With --seeds: folder
    for the folders of all trainings. Default: runs/all/SETUP."""
    policies: Path | None = None
    """With --seeds: folder for the file of the policies. Default: the folder of the shipped policies; for a set-up from
    a file runs/NAME/policies."""
    processes: int = 2
    """With --seeds: number of parallel trainings on this machine, each on one core; 0: train in this process."""
    cluster: str | None = None
    """With --seeds: train on this Ray cluster instead, one core each: "ray" for the cluster on this machine, or an
    address. Its nodes must be able to read the file of a set-up that is not shipped."""
    resume: Path | None = None
    """Resume the run in this folder from its last checkpoint, with its settings. No other option is allowed."""

    def __post_init__(self) -> None:
        whole("processes", self.processes, at_least=0)
        if self.seeds is not None:
            whole("seeds", self.seeds, at_least=1)
            if self.seed:
                raise ValueError(f"seed must be 0 with seeds, which counts from there, got {self.seed}")


def read_options(arguments: Sequence[str]) -> TrainOptions:
    """Return the options on a command line; the set-up determines the defaults of the settings.

    Raises:
        ValueError: there is no such set-up, or --resume is combined with other options.
    """
    default = default_options(read_command("train", TrainOptions, arguments).setup)
    options = read_command("train", TrainOptions, arguments, default)
    if options.resume and options != replace(default, resume=options.resume):
        raise ValueError("--resume takes all settings from the run: give no other option")
    return options


def default_options(setup: str) -> TrainOptions:
    """Return the options of the command `impact-gym train SETUP`, which gives no other option."""
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


if __name__ == "__main__":
    with command_line("train", "the same command continues with --seeds; else use --resume with the run folder"):
        print(run(read_options(sys.argv[1:])))
