"""`impact-gym study NAME`: the options are those of `experiments.lab.study.StudyOptions`."""

import sys
from functools import partial

from agents.command_line import run_command
from experiments.lab.study import StudyOptions, run
from experiments.studies import NAMES, load
from impact_gym.validation import nearest


def main() -> None:
    """Run the study whose name is the first argument."""
    name, *sys.argv[1:] = sys.argv[1:] or ["--help"]
    if name in ("--help", "-h"):
        print("usage: impact-gym study NAME ...\n")
        print(*(f"  {each:<10} {load(each).question}" for each in NAMES), sep="\n")
        sys.exit()
    if name not in NAMES:
        print(f"impact-gym study: {nearest('study', name, NAMES)}", file=sys.stderr)
        sys.exit(2)
    run_command(f"study {name}", StudyOptions, partial(run, load(name)))


if __name__ == "__main__":
    main()
