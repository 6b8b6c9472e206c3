"""The command `impact-gym train`."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro

from agents.setups import Training, load_setup
from agents.train.ppo import Run, resume, train
from agents.train.seeds import train_seeds
from impact_gym.parameters import SI, Index, Options
from impact_gym.support.command_line import command_line, read_command, until_reader_ends


@dataclass(frozen=True)
class TrainOptions(Options):
    """Train a policy (a neural network) for a set-up, or several policies with --seeds."""

    setup: tyro.conf.Positional[str] = "linear-blind"
    """Name of a shipped set-up, or file of a set-up. The set-up's table [training] gives the defaults of the options
    from --steps to --checkpoint-every."""
    training: Annotated[Training, tyro.conf.arg(name="")] = field(default_factory=Training)
    """Settings."""
    seed: Index = 0
    """Seed of the training scenarios, the initial network and the exploration."""
    seeds: Annotated[int | None, SI("-", at_least=1)] = None
    """Number of policies to train, with the seeds 0, 1, 2 and so on. The command writes all policies into one file. The
    file's default policy is the one with the median validation score. If you repeat the command after an interruption,
    it trains only the missing policies."""
    out: Path | None = None
    """Folder for the files of the training. Without --seeds, the folder must not exist yet; the default is in runs/.
    With --seeds, each training has a subfolder, and the default is runs/all/NAME."""
    policies: Path | None = None
    """With --seeds: folder for the file that contains all policies. The default is the folder of the shipped policies
    for a shipped set-up, and runs/NAME/policies for another set-up."""
    processes: Index = 2
    """With --seeds: number of trainings at the same time on this machine, each on one core. 0: the trainings run in
    this process."""
    cluster: str | None = None
    """With --seeds: address of a Ray cluster for the trainings, each on one core. "ray": the address in RAY_ADDRESS or
    else the cluster of this machine. If the set-up is a file, all nodes must be able to read it."""
    resume: Path | None = None
    """Folder of an interrupted training. The training continues from its last checkpoint, with its original settings.
    No other option is allowed."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.seeds is not None and self.seed:
            raise ValueError(f"seed must be 0 if seeds is given (trainings get seeds 0, 1, ...), got {self.seed}")


def read_options(arguments: Sequence[str]) -> TrainOptions:
    """Return the options on a command line; the set-up determines the defaults of the settings."""
    setup = read_command("train", TrainOptions, arguments).setup
    default = TrainOptions(setup, load_setup(setup).training)
    options = read_command("train", TrainOptions, arguments, default)
    if options.resume and options != replace(default, setup=TrainOptions.setup, resume=options.resume):
        raise ValueError("--resume takes all settings from the run: give no other option")
    return options


def run(options: TrainOptions) -> Path:
    """Train; return the run folder, or with `seeds` the file of all policies."""
    if options.resume:
        return resume(options.resume)
    setup = load_setup(options.setup)
    if options.seeds is None:
        return train(Run(setup, options.training, options.seed), options.out)
    out, policies = options.out or Path("runs/all") / setup.name, options.policies or setup.folder / "policies"
    return train_seeds(setup, options.training, options.seeds, out, policies, options.processes, options.cluster)


if __name__ == "__main__":
    after = "with --seeds, the same command continues; without, use --resume with the run folder"
    with until_reader_ends(), command_line("train", after):
        print(run(read_options(sys.argv[1:])))
