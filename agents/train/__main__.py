"""Train a policy: `impact-gym train [SETUP]`. Writes a run folder and prints its path."""

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro

from agents.command_line import command_line
from agents.setups import Training, load_setup
from agents.train.ppo import Run, resume, train


@dataclass(frozen=True)
class TrainOptions:
    """Train a policy on ImpactApproach-v0."""

    setup: tyro.conf.Positional[str] = "linear-blind"
    """What is trained for: a set-up by name or file. It says what the settings are unless they are given here."""
    training: Annotated[Training, tyro.conf.arg(name="")] = field(default_factory=Training)
    """Settings."""
    seed: int = 0
    """Seed of the scenarios, the network and the exploration; no scenario is drawn as in evaluation."""
    out: Path | None = None
    """Run folder; it must not exist. Default: a new one below runs/."""
    resume: Path | None = None
    """Go on with the run in this folder, from its last checkpoint and with its settings; give nothing else then."""


def read_options(arguments: list[str]) -> TrainOptions:
    """Return what a command line asks for; the set-up decides the settings that are not given.

    Raises:
        ValueError: there is no such set-up; something beside the folder to resume.
    """
    setup = tyro.cli(TrainOptions, args=arguments, prog="impact-gym train").setup
    default = TrainOptions(setup, load_setup(setup).training)
    options = tyro.cli(TrainOptions, default=default, args=arguments, prog="impact-gym train")
    if options.resume and options != replace(default, resume=options.resume):
        raise ValueError("--resume takes its settings from the run: give nothing else")
    return options


def main() -> None:
    """Read the settings from the command line and train."""
    with command_line("train", "--resume with the run folder goes on"):
        options = read_options(sys.argv[1:])
        if options.resume:
            print(resume(options.resume))
        else:
            print(train(Run(load_setup(options.setup), options.training, options.seed), options.out))


if __name__ == "__main__":
    main()
