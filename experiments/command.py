"""The command `impact-gym`: each name runs what `python -m MODULE` runs in a checkout.

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
    "controller": Command(
        "experiments.controller", ("train", "report"), "make a controller for a set-up: tune, train, report, export"
    ),
    "setup": Command("agents.setup", ("train",), "check a set-up, a TOML file, and see what follows from it"),
    "tune": Command("agents.tune", ("train",), "tune the baselines of a set-up"),
    "train": Command("agents.train", ("train",), "train a policy for a set-up"),
    "train-seeds": Command("agents.train_seeds", ("train",), "train several seeds and ship the median"),
    "export": Command("agents.export", ("train",), "write a policy as ONNX and as a controller in C"),
    "policies": Command("experiments.policies", (), "list the shipped policies with what they are for"),
    "gain": Command("experiments.gain", ("train", "report"), "say what the gain over the paper's rule is made of"),
    "teleop": Command("experiments.teleop", ("train", "report"), "say what assistance gives an operator who acts late"),
    "play": Command("experiments.play", ("play",), "take the stick: steer the tool in the browser, alone or assisted"),
    "recordings": Command(
        "experiments.play.recordings", ("play", "minari"), "make a dataset of Minari of what was played"
    ),
    "arm": Command("experiments.arm", ("train", "report", "robot"), "hold the one mass on a spring against whole arms"),
    "measured": Command(
        "experiments.measured", ("train", "report"), "predict half of measured hits from the other half"
    ),
    "design": Command("experiments.design", ("train", "report"), "find the coupling that leaves the object slowest"),
    "identify": Command("impact_gym.identify", (), "fit the numbers of a tool and an object to a measured blow"),
    "robot": Command("impact_gym.robot", ("robot",), "compute the default approach of the Viper s650 from its joints"),
    "paper": Command("experiments.paper", ("report",), "reproduce the paper's figures and compare its statements"),
    "speed": Command("experiments.solver.speed", ("report", "peers"), "measure the solver's speed against its error"),
    "stability": Command(
        "experiments.solver.stability", ("report", "peers"), "send random scenes through solver and rivals"
    ),
    "fits": Command("experiments.identify", ("report",), "fit logs of the independent solver, errors beside the bound"),
    "bench": Command(
        "experiments.bench", ("train", "report", "peers"), "measure approaches, environments and training"
    ),
    "doctor": Command("impact_gym.doctor", (), "say what this machine has, and what to do about it"),
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
