"""The command `impact-gym study`."""

import sys
from dataclasses import dataclass, field
from typing import Annotated

import tyro

from experiments.lab.study import StudyOptions, run
from experiments.studies import QUESTIONS, load
from impact_gym.support.command_line import run_command

STUDIES = "; ".join(f"{name} ({question})" for name, question in QUESTIONS.items())


@dataclass(frozen=True)
class StudyCommand:
    """Run a study of this project, and write a page with its tables.

    A cell is one combination of settings; it gives rows of a table. The command measures only cells without results.
    """

    name: Annotated[tyro.conf.Positional[str], tyro.conf.arg(help=f"One of these studies: {STUDIES}")]
    options: Annotated[StudyOptions, tyro.conf.arg(name="")] = field(default_factory=StudyOptions)


if __name__ == "__main__":
    sys.argv += ["--help"] * (len(sys.argv) == 1)
    run_command("study", StudyCommand, lambda command: run(load(command.name), command.options))
