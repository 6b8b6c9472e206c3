"""Train a policy: `python -m agents.train [SETUP]`. Writes a run folder and prints its path."""

import sys

from agents.command_line import command_line
from agents.train.run import train
from agents.train.settings import read_settings


def main() -> None:
    """Read the settings from the command line and train."""
    with command_line("agents.train", "--resume with the run folder goes on"):
        print(train(read_settings(sys.argv[1:])))


if __name__ == "__main__":
    main()
