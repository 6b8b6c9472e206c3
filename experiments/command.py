"""The command `impact-gym`: what `python -m` runs in a checkout, by the names that an installation gives it.

A command gets its arguments as they are, so that its options, and its help, stand in one place. What its extras ask for
is looked for first: a command that needs more than is there says so in one line, before it has worked for hours.
"""

import argparse
import re
import runpy
import sys
from importlib.metadata import Distribution, requires
from typing import NamedTuple


class Command(NamedTuple):
    """A module that runs, with the extras that it needs."""

    module: str
    extras: tuple[str, ...]
    does: str


COMMANDS = {
    "report": Command("experiments.report", ("report",), "play policies and baselines and write a page about it"),
    "controller": Command("agents.controller", ("train", "report"), "make a controller for a set-up, a TOML file"),
    "identify": Command("impact_gym.identify", (), "fit the numbers of a tool and an object to a measured blow"),
    "design": Command("agents.design", ("train", "report"), "search for the coupling that leaves the object slowest"),
    "doctor": Command("impact_gym.doctor", (), "say what this machine makes of the environment"),
}


def missing(extras: tuple[str, ...]) -> list[str]:
    """Return what these extras of the project ask for and is not installed."""
    wanted = [line for line in requires("impact-gym") or [] for extra in extras if f'extra == "{extra}"' in line]
    names = dict.fromkeys(re.split(r"[^\w.-]", line, maxsplit=1)[0] for line in wanted)
    return [name for name in names if not any(Distribution.discover(name=name))]


def main() -> None:
    """Run the command that is asked for."""
    parser = argparse.ArgumentParser(prog="impact-gym", epilog="impact-gym COMMAND --help: the arguments of a command")
    commands = parser.add_subparsers(dest="name", required=True, metavar="COMMAND")
    for name, command in COMMANDS.items():
        commands.add_parser(name, help=command.does, add_help=False)
    options, arguments = parser.parse_known_args()
    command = COMMANDS[options.name]
    if lacking := missing(command.extras):
        remedy = f"pip install 'impact-gym[{','.join(command.extras)}]'"
        sys.exit(f"impact-gym {options.name} needs {', '.join(lacking)}: {remedy}")
    sys.argv[1:] = arguments
    sys.path.append("")  # where `module:object` of the report is looked for; last, as many have a folder `experiments`
    runpy.run_module(command.module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
