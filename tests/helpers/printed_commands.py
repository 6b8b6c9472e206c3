"""Commands that pages, cards and reports print: their own parsers read the options, values exist, nothing is run."""

import argparse
import re
import runpy
import shlex
import sys
import warnings
from functools import partial
from pathlib import Path

import pytest
import tyro

from agents.baselines import FIXED
from agents.setups import shipped, shipped_baselines
from experiments import studies
from experiments.command import COMMANDS

MODULES = {name: command.module for group in COMMANDS.values() for name, command in group.items()}
STANDS_FOR = {
    "SETUP": "linear-blind", "my.toml": "linear-blind", "NAME": "linear-blind", "N": "2", "DIR": "out",
    "NAME=LOW:HIGH": "coupling.stiffness=40:60", "...": "",
}  # fmt: skip
"""Values for the placeholders of a usage line."""

ROOT = Path(__file__).parents[2]
FILE = re.compile(r"(?<![\w/.:-])(?:agents|docs|experiments|impact_gym|tests)/[\w./-]*\w")
"""The name of a file or folder of this repository."""
NAMED = {*shipped(), *shipped_baselines(), *FIXED}


def run_python(words, monkeypatch):
    """Run a script or -m module in this process. A warning is an error."""
    module = words[0] == "-m"
    run = partial(runpy.run_module, alter_sys=True) if module else runpy.run_path
    with monkeypatch.context() as patched, warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*found in sys.modules", RuntimeWarning)
        patched.setattr(sys, "argv", words[module:])
        run(words[module], run_name="__main__")


def read_options(module, words, monkeypatch):
    """Let a command read its options, and stop it then; the tables, set-ups and controllers in them exist."""
    unknown = {word for word in words if re.fullmatch("[a-z]+(-[a-z]+)+", word)} - NAMED
    assert not unknown, f"{module} {words}: {unknown}"

    def and_stop(read):
        def reading(*arguments, **options):
            command = read(*arguments, **options)
            if module == MODULES["study"]:
                assert {*command.only} <= {table.name for table in studies.load(command.name).measurements}
            sys.exit()

        return reading

    with monkeypatch.context() as patched:
        for place, reads in ((tyro, "cli"), (argparse.ArgumentParser, "parse_args")):
            patched.setattr(place, reads, and_stop(getattr(place, reads)))
        with pytest.raises(SystemExit) as ended:
            run_python(["-m", module, *words], patched)
    assert not ended.value.code, f"{module} {words}: {ended.value}"


def read_printed(command, monkeypatch):
    """Let a printed command, `impact-gym NAME ...`, read its options; without options only its name is checked."""
    _, name, *words = shlex.split(re.sub(r"[][]", "", command))
    assert name in MODULES, command
    stands_for = STANDS_FOR | ({"NAME": "paper"} if name == "study" else {})
    if words := [stands_for.get(word, word) for word in words]:
        read_options(MODULES[name], [*filter(None, words)], monkeypatch)
