"""The command `impact-gym NAME`: runs a module if the packages that the module needs are installed."""

import platform
import re
import runpy
import sys
from collections.abc import Mapping
from importlib.metadata import Distribution, requires, version
from typing import NamedTuple

from impact_gym.support.command_line import until_reader_ends
from impact_gym.support.validation import nearest


class Command(NamedTuple):
    """A module to run, and the extras of the package impact-gym that the module needs."""

    module: str
    extras: tuple[str, ...]
    help: str


COMMANDS: Mapping[str, Mapping[str, Command]] = {
    "for your own arm and tool": {
        "check": Command("agents.check", ("train",), "check a set-up (a TOML file) and describe it"),
        "tune": Command("agents.tune", ("train",), "tune the baselines of a set-up"),
        "train": Command("agents.train", ("train",), "train one policy or several policies for a set-up"),
        "controller": Command("experiments.controller", ("train", "report"), "tune, train, report and export the best"),
        "report": Command("experiments.report", ("report",), "write a page that compares policies and baselines"),
        "export": Command("agents.export", ("train",), "write a controller as C code, and a policy also as ONNX"),
        "policies": Command("experiments.policies", ("report",), "print purpose, failures and results of each policy"),
        "play": Command("experiments.play", ("play",), "steer the tool in the browser, with or without assistance"),
        "identify": Command("impact_gym.identification", (), "fit mass, stiffness and restitution to measured blows"),
        "design": Command("experiments.design", ("train", "report"), "find the coupling with the lowest V_p"),
    },
    "for data": {"dataset": Command("experiments.dataset", ("data",), "record episodes of rules, policies or persons")},
    "for work on this project": {"study": Command("experiments.studies", ("report",), "run a study again")},
}


def overview() -> str:
    """Return the list of all commands."""
    lines = ["usage: impact-gym COMMAND ..."]
    for group, commands in COMMANDS.items():
        lines += ["", f"{group}:", *(f"  {name:<11} {command.help}" for name, command in commands.items())]
    last = "impact-gym COMMAND --help: the options of a command;  impact-gym --version: versions"
    return "\n".join([*lines, "", last])


def versions() -> str:
    """Return the versions of this package, of the main installed libraries and of Python, and the platform."""
    named = ("impact-gym", "numpy", "scipy", "gymnasium", "torch", "stable-baselines3")
    there = [f"{name} {version(name)}" for name in named if any(Distribution.discover(name=name))]
    return "\n".join([*there, f"Python {platform.python_version()}, {platform.platform()}"])


def missing(extras: tuple[str, ...]) -> list[str]:
    """Return the packages of these extras that are not installed."""
    wanted = [line for line in requires("impact-gym") or [] for extra in extras if f'extra == "{extra}"' in line]
    names = dict.fromkeys(re.split(r"[^\w.-]", line, maxsplit=1)[0] for line in wanted)
    return [name for name in names if not any(Distribution.discover(name=name))]


@until_reader_ends()
def main() -> None:
    """Run the command that the first argument names, or print help or versions."""
    name, *arguments = sys.argv[1:] or ["--help"]
    commands = {name: command for group in COMMANDS.values() for name, command in group.items()}
    if name in ("--help", "-h", "help", "--version"):
        print(versions() if name == "--version" else overview())
        return
    if name not in commands:
        print(f"{overview()}\n\nimpact-gym: {nearest('command', name, commands)}", file=sys.stderr)
        sys.exit(2)
    command = commands[name]
    if absent := missing(command.extras):
        remedy = f"pip install 'impact-gym[{','.join(command.extras)}]'"
        sys.exit(f"impact-gym {name} needs {', '.join(absent)}: {remedy}")
    sys.argv[1:] = arguments
    sys.path.append("")  # current folder, for a user's module:object; last, so that our `experiments` comes first
    runpy.run_module(command.module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
