"""The documentation is true: every fenced block of README.md and docs/**/*.md is run, or its options are parsed.

The blocks of a page share one folder and one namespace, from top to bottom. A block with a title is a file. Python
runs, stable-baselines3 for one rollout. Shell commands run; for those of SLOW only the options are parsed. A block of
text is the output of the block above it.
"""

import doctest
import json
import os
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
from pkgutil import resolve_name

import pytest
from printed_commands import FILE, MODULES, ROOT, read_options, read_printed, run_python

from agents.policies import SHIPPED
from agents.setups import feasible, load_setup
from experiments import policies
from impact_gym.task import Task

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(\w*)(?: title=\"(.+?)\")?\n(.*?)^```$", re.DOTALL | re.MULTILINE)
EXAMPLES = ROOT / "docs" / "examples"
LISTED = {file.read_text() for file in EXAMPLES.glob("*.py")}
"""Listings that a command on a page or another test runs."""
SLOW = {*MODULES.values(), "experiments.loop"} - {MODULES["check"], MODULES["policies"]}
"""Modules that run for minutes, which have tests of their own."""
ELSEWHERE = {"git", "source", "tensorboard", "cleanrl/ppo_continuous_action.py", "rl_zoo3.train"}
"""Programs of others; tests/envs/test_front_ends.py runs rl_zoo3."""
NEEDS = {"deploy-c.md": "onnxruntime", "README.md": "stable_baselines3", "gymnasium.md": "stable_baselines3"}
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "error"}
ALIKE = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def run_shell(code, monkeypatch):
    """Run a shell block, except slow commands."""
    lines = code.replace("\\\n", " ").replace("docs/examples", str(EXAMPLES)).splitlines()
    for words in filter(None, (shlex.split(line, comments=True) for line in lines)):
        if ELSEWHERE & {*words[:3]}:
            continue
        if words[0] == "impact-gym":
            words[:2] = ["python", "-m", MODULES[words[1]]]
        if words[1:2] == ["-m"] and words[2] in SLOW:
            read_options(words[2], words[3:], monkeypatch)
        elif words[0] == "python" and words[1].startswith((str(EXAMPLES), "-m")):
            run_python(words[1:], monkeypatch)
        else:
            program = {"python": [sys.executable], "make": ["make", "--directory", ROOT, "--dry-run", "--silent"]}
            words[:1] = program.get(words[0], words[:1])
            done = subprocess.run(words, env=ENVIRONMENT, capture_output=True, text=True, check=False)
            assert done.returncode == 0, f"{words}\n{done.stderr}"
            print(done.stdout, end="")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_examples_of_a_page_run_and_print_what_it_shows(page, tmp_path, monkeypatch, capsys):
    if page.name in NEEDS:
        needed = pytest.importorskip(NEEDS[page.name])
        if learn := getattr(getattr(needed, "PPO", None), "learn", None):
            monkeypatch.setattr(needed.PPO, "learn", lambda model, steps: learn(model, 1))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    namespace, text = {"__name__": "__main__"}, page.read_text()
    assert text.count("```") == 2 * len(BLOCK.findall(text)), f"{page}: not all blocks are understood"
    for block in BLOCK.finditer(text):
        (language, title, code), line = block.groups(), text[: block.start()].count("\n") + 2
        where = f"{page.relative_to(ROOT)}, line {line}"
        assert max(map(len, code.splitlines())) <= 88, f"{where}: wider than a column"
        if language in ("python", "sh"):
            capsys.readouterr()
        if title:
            (tmp_path / title).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / title).write_text(code)
            if language == "python":
                runpy.run_path(title, run_name="page")
        elif language == "python":
            if code not in LISTED:
                exec(compile("\n" * (line - 1) + code, str(page), "exec"), namespace)  # lines numbered as on the page
        elif language == "sh":
            run_shell(code, monkeypatch)
        elif language == "text":
            printed = capsys.readouterr().out
            assert doctest.OutputChecker().check_output(code, printed, ALIKE), f"{where}: printed was\n{printed}"
        else:
            assert tomllib.loads(code) if language == "toml" else language == "diff", where


PRINTED = {  # commands in texts and on cards
    *(command for page in PAGES for command in re.findall("`(impact-gym [a-z][^`]*)`", page.read_text())),
    *(command for path in SHIPPED.glob("*.npz") for command in re.findall(
        r"made by: (impact-gym [^(]*)", "\n".join(policies.card(path.stem)))),
}  # fmt: skip


@pytest.mark.parametrize("command", sorted(PRINTED))
def test_printed_command_has_valid_options(command, monkeypatch):
    read_printed(command, monkeypatch)


def test_generated_parts_of_pages_are_current():
    pytest.importorskip("latex2mathml", reason="the group docs is not installed")
    filled = runpy.run_path(str(ROOT / "docs/generated.py"))["filled"]
    assert [page for page in PAGES if filled(page.read_text()) != page.read_text()] == [], "run docs/generated.py"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_page_names_files_that_exist_and_no_commit(page):
    text = page.read_text()
    assert [name for name in FILE.findall(text) if not (ROOT / name).exists()] == []
    assert re.findall(r"(?i)\bcommits? `?(?=[0-9a-f]*\d)[0-9a-f]{7,40}\b|\bnot kept\b", text) == []


def test_notebook_prints_the_outputs_that_it_contains(capsys):
    pytest.importorskip("pygame")
    pytest.importorskip("matplotlib").use("Agg")
    namespace = {}
    for cell in json.loads((EXAMPLES / "first_steps.ipynb").read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), namespace)
            shown = [line for output in cell["outputs"] for line in output.get("text", ())]
            assert capsys.readouterr().out == "".join(shown)


def test_links_of_pages_lead_to_files_and_headings():
    for page in PAGES:
        text = BLOCK.sub("", page.read_text())
        for target, heading in re.findall(r"\]\((?!https?:)([^)#\s]*)#?([^)\s]*)\)", text):
            file = (page.parent / target).resolve() if target else page
            assert file.is_file(), f"{page}: {target}"
            if "." in heading:  # an object on a page of the reference
                assert resolve_name(heading)
            elif heading:
                titles = re.findall("^#+ (.+)$", file.read_text(), re.MULTILINE)
                slugs = [re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower()) for title in titles]
                assert heading in slugs, f"{page}: {target}#{heading}"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_example_of_an_end_effector_is_a_possible_set_up(path):
    sentences = feasible.doubts(Task(**load_setup(path).environment))
    stop = "the front stop holds the tool up to"  # a designed mechanism's controller stays below that acceleration
    assert [said for said in sentences if not (stop in said and "designed" in path.stem)] == []
