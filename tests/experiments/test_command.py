"""The command `impact-gym`: its names, commands as text, and the way from a set-up to its controller."""

import os
import re
import shlex
import subprocess
import sys
import warnings
from contextlib import closing
from errno import ENOSPC
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from own_set_up import change
from refusal import refused
from scipy.stats import ttest_1samp

from agents.policies import load_ensemble
from agents.setups import Training, load_setup
from agents.train.__main__ import TrainOptions
from agents.tune import Tune
from experiments import command, policies
from experiments.controller import copy_setup
from experiments.lab.study import last_run
from experiments.studies import QUESTIONS
from experiments.studies.__main__ import StudyCommand
from impact_gym.support import command_line

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning:runpy")  # of a module that was imported before it runs


@pytest.fixture
def exit_of(monkeypatch):
    """Run `impact-gym` with words; return its exit code or message."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["impact-gym", *words])
        with pytest.raises(SystemExit) as ended:
            sys.exit(command.main())
        return ended.value.code or 0

    return run


NAMES = [name for group in command.COMMANDS.values() for name in group]


@pytest.mark.parametrize("name", NAMES)
def test_help_of_a_command_is_in_words_of_a_user(name, exit_of, capsys):
    assert not exit_of(*name.split(), "--help")
    text = capsys.readouterr().out
    assert text.startswith(f"usage: impact-gym {name} ")
    assert not [jargon for jargon in ("experiments.", "agents.") if jargon in text]


def test_commands_are_listed_for_no_or_an_unknown_name(exit_of, capsys):
    for words, status in (((), 0), (("reprot",), 2)):
        assert exit_of(*words) == status
        text = capsys.readouterr()[status // 2]
        assert [line.split()[0] for line in text.splitlines() if line.startswith("  ")] == NAMES
        assert ("'reprot': did you mean report?" in text) == (status == 2)
    assert exit_of("--version") == 0
    assert {f"impact-gym {version('impact-gym')}", f"numpy {np.__version__}"} <= {*capsys.readouterr().out.splitlines()}


@pytest.mark.parametrize("words", [
    *(f"experiments.command {words}" for words in ("--help", "check --help", "check linear-blind", "policies")),
    "experiments.report --help", "agents.train --help",
])  # fmt: skip
def test_command_ends_quietly_with_its_reader(words, monkeypatch):
    reader, writer = os.pipe()
    os.close(reader)
    line = [sys.executable, "-m", *words.split()]
    with os.fdopen(writer, "wb") as closed:
        ended = subprocess.run(line, stdout=closed, stderr=subprocess.PIPE, cwd=Path(__file__).parents[2], check=False)
    assert (ended.returncode, ended.stderr) == (command_line.READER_ENDED, b"")
    monkeypatch.setattr(sys, "stdout", None)  # as Python sets it if standard output is closed
    with command_line.until_reader_ends():
        pass


def test_progress_has_a_clock_that_never_goes_back(monkeypatch):
    monkeypatch.setattr("tqdm.std.time", iter([9.0, 8.0] * 9).__next__)
    with closing(command_line.progress("a", 2)) as bar:
        assert bar.format_dict["elapsed"] >= 0.0


def test_study_lists_studies_and_refuses_unknown_names(exit_of, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert not exit_of("study")
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert all(f"{name} ({question})" in text for name, question in QUESTIONS.items())
    assert exit_of("study", "telop") == "impact-gym study: no study 'telop': did you mean teleop?"
    assert exit_of("study", "teleop", "--only", "cost").startswith("impact-gym study: only: no table 'cost' in the")


def test_command_names_the_packages_it_lacks(exit_of, monkeypatch):
    there = command.Distribution.discover
    monkeypatch.setattr(command.Distribution, "discover", lambda name: () if name == "cma" else there(name=name))
    assert exit_of("tune") == "impact-gym tune needs cma: pip install 'impact-gym[train]'"
    assert not exit_of("policies", "rigid-blind")  # needs another extra


@pytest.mark.parametrize(("name", "options"), [
    ("tune", Tune(("linear-blind",), names=("blind-profile",), weights=(0.5, 2.0), budget=8, bound=True)),
    ("train", TrainOptions("rigid-blind", Training(width=24), seeds=2, cluster="ray", out=Path("a b"))),
    ("study", StudyCommand(Path("out"), name="speed", quick=True, only=("cost",), processes=1)),
], ids=["tune", "train", "study"])  # fmt: skip
def test_command_of_options_is_read_into_the_same_options(name, options):
    words = shlex.split(command_line.command_of(name, options))
    assert words[:2] == ["impact-gym", name]
    assert command_line.read_command(name, type(options), words[2:]) == options


@pytest.mark.filterwarnings("always:odd")
def test_command_line_says_in_one_line_what_went_wrong(capsys):
    for error, said in (
        (ValueError("no such thing"), r"impact-gym tune: no such thing$"),
        (ModuleNotFoundError("no yaml"), r"tune: .*yaml.*pip install 'impact-gym\[all"),
        (OSError(ENOSPC, "full"), r"tune: .*a file.*make room: go on$"), (KeyboardInterrupt(), "130"),
    ):  # fmt: skip
        with pytest.raises(SystemExit, match=said), command_line.command_line("tune", "go on"):
            raise error
    assert capsys.readouterr().err == "impact-gym tune: interrupted; go on\n"
    with command_line.command_line("tune"):
        for _ in range(2):
            warnings.warn("odd", stacklevel=1)
    assert capsys.readouterr().err == "impact-gym tune: warning: odd\n"


def test_cards_tell_purpose_failures_and_results_of_seeds(mine):
    setup, text = load_setup("linear-blind"), [*policies.card("linear-blind")]
    assert text[:3] == [f"linear-blind: {setup.title}", f"  for: {setup.about}", f"  fails: {setup.fails}"]
    validations = [policy.provenance["validation"] for policy in load_ensemble("linear-blind").policies]
    for place, (weight, line) in enumerate(zip(validations[0]["time_weight"], text[3:-2], strict=True)):
        values = [validation["object_velocity"][place] for validation in validations]
        low, high = ttest_1samp(values, 0.0).confidence_interval(0.95)
        found = re.fullmatch(r"  w = (\S+) m/s per s: T .* s, V_p (\S+) \[(\S+), (\S+)\] m/s", line).groups()
        assert [*map(float, found)] == pytest.approx([weight, np.mean(values), low, high], abs=6e-4)
    refused(lambda: [*policies.card(str(mine))], "mine.toml has no policy yet", "impact-gym train", "--seeds")


def test_copy_setup_keeps_a_folder_for_its_set_up(mine, tmp_path):
    out = tmp_path / "out"
    copy_setup(load_setup(mine), out)
    change(mine, "A slow arm", "A slower arm")
    assert copy_setup(load_setup(mine), out).read_bytes() == mine.read_bytes()
    refused(lambda: copy_setup(load_setup(mine), out, quick=True), "run without --quick: name another folder")
    change(mine, "0.7", "0.8")
    refused(lambda: copy_setup(load_setup(mine), out), "another version of mine.toml", "name another folder")
    refused(lambda: copy_setup(load_setup("linear-blind"), out), "has mine.toml, but no linear-blind.toml")


@pytest.mark.slow
def test_controller_goes_from_a_file_to_the_best_controller(mine, tmp_path, exit_of, capsys):
    out, words = tmp_path / "out", ("controller", str(mine), "--out", str(tmp_path / "out"), "--quick")
    assert exit_of(*words) == 0
    (choice,) = last_run(out / "report")["numbers"]["choices"].values()
    best = "mine" if choice["controller"].startswith("seed-") else choice["controller"]
    exported, first = [path.stem for path in (out / "export").glob("*.h")], (out / "policies/mine.npz").read_bytes()
    assert exported == ["paper-trapezoid" if best == "paper's rule" else best]
    assert choice["sentence"] in capsys.readouterr().out
    assert exit_of(*words, "--all") == 0
    assert {path.stem for path in (out / "export").glob("*.h")} >= {"mine", "mine-profile", "paper-trapezoid"}
    assert (out / "policies/mine.npz").read_bytes() == first
