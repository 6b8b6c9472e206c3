"""The command `impact-gym study`."""

import sys
from dataclasses import dataclass
from typing import Annotated

import tyro

from experiments.lab.study import StudyOptions, run
from experiments.studies import QUESTIONS, load
from impact_gym.support.command_line import command_of, run_command

STUDIES = "; ".join(f"{name} ({question})" for name, question in QUESTIONS.items())


@dataclass(frozen=True, kw_only=True)
class StudyCommand(StudyOptions):
    """Run a study of this project, and write a page with its tables.

    A cell is one combination of settings; it gives rows of a table. The command measures only cells without results.
    """

    name: Annotated[tyro.conf.Positional[str], tyro.conf.arg(help=f"One of these studies: {STUDIES}")]


if __name__ == "__main__":
    sys.argv += ["--help"] * (len(sys.argv) == 1)
    run_command("study", StudyCommand, lambda command: run(load(command.name), command, command_of("study", command)))
