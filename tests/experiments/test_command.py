"""The command `impact-gym`: one table of names, and one way to write a command."""

import shlex
import sys
import warnings
from pathlib import Path

import pytest
import tyro

from agents import load_policy
from agents.command_line import command_line, command_of
from agents.export.__main__ import Export
from agents.setups import Training, load_setup, shipped
from agents.train_seeds import Seeds
from agents.tune import Tune
from experiments import command, policies
from experiments.design.search import Effort
from experiments.design.study import Study
from experiments.report.__main__ import ReportOptions


@pytest.fixture
def exit_of(monkeypatch):
    """Run `impact-gym` with words, and return what it exits with."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["impact-gym", *words])
        with pytest.raises(SystemExit) as ended:
            command.main()
        return ended.value.code

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of a module that is run and was imported before
        yield run


@pytest.mark.parametrize("name", command.COMMANDS)
def test_help_of_a_command_prints_its_name(name, exit_of, capsys):
    assert exit_of(name, "--help") == 0
    assert capsys.readouterr().out.startswith(f"usage: impact-gym {name} ")


@pytest.mark.parametrize(("name", "options"), [
    ("tune", Tune(("linear-blind",), names=("blind-profile",), weights=(0.5, 2.0), budget=8, bound=True)),
    ("train-seeds", Seeds(("linear-blind", "rigid-blind"), seeds=2, cluster="ray", runs=Path("there"))),
    ("report", ReportOptions(("linear-blind",), folder=Path("a b"), force=True, count=200)),
    ("export", Export("linear-blind", Path("out"))),
    ("design", Study("linear-blind", ("coupling.stiffness=20:200",), Path("out"), effort=Effort(budget=8), against=())),
], ids=lambda value: value if isinstance(value, str) else "")  # fmt: skip
def test_command_of_options_is_read_into_the_same_options(name, options):
    words = shlex.split(command_of(name, options))
    assert words[:2] == ["impact-gym", name]
    assert tyro.cli(type(options), args=words[2:]) == options


def test_command_of_leaves_out_what_another_default_says():
    settings = Training()
    assert command_of("train", settings, settings, "linear-blind") == "impact-gym train linear-blind"
    assert command_of("train", Training(steps=5), settings, "mine.toml") == "impact-gym train mine.toml --steps 5"


def test_command_line_says_in_one_line_what_went_wrong(capsys):
    with pytest.raises(SystemExit, match=r"impact-gym tune: no such thing$"), command_line("tune"):
        raise ValueError("no such thing")
    with pytest.raises(SystemExit, match="130"), command_line("tune"):
        raise KeyboardInterrupt
    assert capsys.readouterr().err == "impact-gym tune: interrupted; the same command continues\n"


def test_design_refuses_in_one_line(exit_of, tmp_path):
    message = exit_of("design", "linear-blind", "--free", "coupling.stiffness=9:1", "--out", str(tmp_path))
    assert message == "impact-gym design: --free coupling.stiffness must have LOW below HIGH, got 9:1"


def test_policies_lists_every_shipped_policy_with_its_purpose():
    text = "\n".join(policies.lines())
    for name in shipped():
        assert f"{name}: {load_setup(name).title}\n  {load_setup(name).about}\n" in text
        assert load_policy(name)
