"""The documentation does what it says: every fenced block of README.md and docs/**/*.md is run, or read as a command.

The blocks of a page share one folder and one namespace, from top to bottom. A block with a title is a file. Python runs;
shell commands run, but for those of UNDER_WAY, whose options are read; a block of text under either is its output.
"""

import argparse
import doctest
import os
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
import warnings
from pathlib import Path

import pytest
import tyro

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(\w*)(?: title=\"(.+?)\")?\n(.*?)^```$", re.DOTALL | re.MULTILINE)
FILES, RUN, SHOWN = ("toml", "json", "c", "yaml"), ("python", "sh"), ("text", "diff")
UNDER_WAY = (  # these take minutes; what they do has tests of its own
    "agents.controller", "agents.export", "agents.train", "agents.train_seeds", "agents.tune", "agents.tune_training",
    "experiments.bench", "experiments.paper", "experiments.report", "experiments.speed_vs_error",
    "experiments.stability", "impact_gym.doctor", "impact_gym.robot",
)  # fmt: skip
ELSEWHERE = ("pip", "git", "ray", ".", "tensorboard")  # nothing of ours, or nothing to run here
NEEDS = {"questions.md": "mujoco", "libraries.md": "stable_baselines3"}
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "error"}
ALIKE = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


class Read(BaseException):
    """The options of a command were understood."""


def blocks(page):
    """The language, title, code and first line of each block of a page."""
    text = page.read_text()
    for found in BLOCK.finditer(text):
        language, title, code = found.groups()
        yield language, title, code, text[: found.start()].count("\n") + 2


def commands(code):
    """The commands of a shell block, as lists of words."""
    lines = code.replace("\\\n", " ").splitlines()
    return [words for line in lines for words in (shlex.split(line, comments=True),) if words]


def read_options(module, words, monkeypatch):
    """Have a command of ours read its options, and go no further."""

    def and_stop(read):
        def reading(*arguments, **options):
            read(*arguments, **options)
            raise Read

        return reading

    with monkeypatch.context() as patched:
        patched.setattr(sys, "argv", [module, *words])
        patched.setattr(tyro, "cli", and_stop(tyro.cli))
        patched.setattr(argparse.ArgumentParser, "parse_args", and_stop(argparse.ArgumentParser.parse_args))
        with pytest.raises(Read), warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # of a module that is run and was imported before
            runpy.run_module(module, run_name="__main__", alter_sys=True)


def run_shell(code, monkeypatch):
    """Run a shell block, but for what takes minutes; return what it printed."""
    printed = ""
    for words in commands(code):
        if words[0] == "make":
            subprocess.run([*words, "--dry-run", "--silent"], cwd=ROOT, check=True, capture_output=True)
        elif words[:2] == ["python", "-m"] and words[2] in UNDER_WAY:
            read_options(words[2], words[3:], monkeypatch)
        elif words[0] not in ELSEWHERE and words[2:3] != ["rl_zoo3.train"]:  # tests/envs/test_learning_libraries.py
            line = shlex.join(words).replace("python", sys.executable, 1) if words[0] == "python" else " ".join(words)
            done = subprocess.run(line, shell=True, env=ENVIRONMENT, capture_output=True, text=True, check=False)
            assert done.returncode == 0, f"{line}\n{done.stderr}"
            printed += done.stdout
    return printed


def run_python(code, page, line, namespace):
    """Run a block of Python, its lines numbered as on its page."""
    exec(compile("\n" * (line - 1) + code, str(page), "exec"), namespace)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_shows_is_so(page, tmp_path, monkeypatch, capsys):
    if page.name in NEEDS:
        pytest.importorskip(NEEDS[page.name])
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    namespace, printed = {"__name__": "__main__"}, None
    for language, title, code, line in blocks(page):
        where = f"{page.relative_to(ROOT)}, line {line}"
        if title:
            assert language in (*FILES, "python"), where
            (tmp_path / title).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / title).write_text(code)
        elif language == "python":
            run_python(code.replace('--8<-- "', '# shown from a file that has a test: "'), page, line, namespace)
            printed = capsys.readouterr().out
        elif language == "sh":
            printed = run_shell(code, monkeypatch)
        elif language == "text" and printed is not None:
            assert doctest.OutputChecker().check_output(code, printed, ALIKE), f"{where}: printed was\n{printed}"
            printed = None
        elif language == "toml":
            tomllib.loads(code)
        else:
            assert language in SHOWN, f"{where}: nothing says how {language!r} is tested"
