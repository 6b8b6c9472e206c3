"""The documentation is true: every fenced block of README.md and docs/**/*.md is run, or its options are parsed.

The blocks of a page share one folder and one namespace, from top to bottom. A block with a title is a file. Python
runs. Shell commands run; for those of SLOW only the options are parsed. A block of text is the output of the block
above it.
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
from pathlib import Path

import pytest
from commands import MODULES, read_options, read_printed
from pages import chromium, opened

from agents.policies import SHIPPED
from experiments import policies
from impact_gym.task.task import ARGUMENTS

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(\w*)(?: title=\"(.+?)\")?\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LISTED = {file.read_text() for file in (ROOT / "docs/examples").glob("*.py")}
"""Listings of docs/examples, which have tests of their own."""
FILES = ("toml", "json", "c", "python")
SLOW = {module for name, module in MODULES.items() if name not in ("check", "policies")}
SLOW.add("experiments.loop")
"""Modules that run for minutes, which have tests of their own."""
ELSEWHERE = {"git", "source", "tensorboard", "cleanrl/ppo_continuous_action.py", "rl_zoo3.train"}
"""Programs of others; tests/envs/test_ecosystem.py runs rl_zoo3."""
FOUND = {
    "solref": "Restitution in MuJoCo", "ROS": "Questions", "Windows": "Questions", "cite": "Questions",
    "Franka": "Whole arms", "tutorial": "First hour",
}  # fmt: skip
"""Words to search for, and the page that the search must find."""
NEEDS = {
    "deploy-c.md": "onnxruntime", "mujoco.md": "mujoco",
    "README.md": "stable_baselines3", "libraries.md": "stable_baselines3",
}  # fmt: skip
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "error"}
ALIKE = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def blocks(page):
    """The language, title, code and first line of each block of a page."""
    text = page.read_text()
    assert text.count("```") == 2 * len(BLOCK.findall(text)), f"{page}: not all blocks are understood"
    for block in BLOCK.finditer(text):
        language, title, code = block.groups()
        yield language, title, code, text[: block.start()].count("\n") + 2


def run_shell(code, monkeypatch):
    """Run a shell block, except slow commands; return what it printed."""
    printed = ""
    lines = code.replace("\\\n", " ").splitlines()
    for words in filter(None, (shlex.split(line, comments=True) for line in lines)):
        if words[0] == "make":
            subprocess.run([*words, "--dry-run", "--silent"], cwd=ROOT, check=True, capture_output=True)
            continue
        if words[0] == "impact-gym":
            words[:2] = ["python", "-m", MODULES[words[1]]]
        if words[:2] == ["python", "-m"] and words[2] in SLOW:
            read_options(words[2], words[3:], monkeypatch)
        elif not ELSEWHERE & {*words[:3]}:
            words = [str(ROOT / word) if word.startswith("docs/examples/") else word for word in words]
            line = shlex.join([sys.executable, *words[1:]] if words[0] == "python" else words)
            done = subprocess.run(line, shell=True, env=ENVIRONMENT, capture_output=True, text=True, check=False)
            assert done.returncode == 0, f"{line}\n{done.stderr}"
            printed += done.stdout
    return printed


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_examples_of_a_page_run_and_print_what_the_page_shows(page, tmp_path, monkeypatch, capsys):
    if page.name in NEEDS:
        pytest.importorskip(NEEDS[page.name])
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    namespace, printed = {"__name__": "__main__"}, None
    for language, title, code, line in blocks(page):
        where = f"{page.relative_to(ROOT)}, line {line}"
        assert max(map(len, code.splitlines())) <= 88, f"{where}: wider than a column"
        if title:
            assert language in FILES, where
            (tmp_path / title).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / title).write_text(code)
            if language == "python":
                runpy.run_path(title, run_name="page")
        elif language == "python":
            capsys.readouterr()
            if code not in LISTED:
                exec(compile("\n" * (line - 1) + code, str(page), "exec"), namespace)  # lines numbered as on the page
            printed = capsys.readouterr().out
        elif language == "sh":
            printed = run_shell(code, monkeypatch)
        elif language == "text":
            assert printed is not None, f"{where}: output of nothing"
            assert doctest.OutputChecker().check_output(code, printed, ALIKE), f"{where}: printed was\n{printed}"
            printed = None
        elif language == "toml":
            tomllib.loads(code)
        else:
            assert language == "diff", f"{where}: no test of {language!r}"


CARDS = {path.stem: [*policies.card(path.stem)] for path in SHIPPED.glob("*.npz")}
PRINTED = {
    *(command for page in PAGES for earlier, command in re.findall(
        r"(8fc14f9 \W*(?:with\s+)?)?`(impact-gym [a-z][^`]*)`", page.read_text()) if not earlier),
    *(command for card in CARDS.values() for command in re.findall(r"made by: (impact-gym [^(]*)", "\n".join(card))),
}  # fmt: skip
"""Commands in texts and on cards, except those of an earlier commit."""


@pytest.mark.parametrize("command", sorted(PRINTED))
def test_printed_command_has_valid_options(command, monkeypatch):
    read_printed(command, monkeypatch)


def test_generated_parts_of_pages_are_current():
    for package in ("latex2mathml", "pygame"):
        pytest.importorskip(package, reason="the extra docs is not installed")
    filled = runpy.run_path(str(ROOT / "docs/generated.py"))["filled"]
    written = [page for page in PAGES if "<!-- generated: " in page.read_text()]
    assert len(written) > 4
    assert [page for page in written if filled(page.read_text()) != page.read_text()] == [], "run docs/generated.py"


def test_notebook_prints_the_outputs_that_it_contains(capsys):
    pytest.importorskip("matplotlib").use("Agg")
    namespace = {}
    for cell in json.loads((ROOT / "docs/examples/first_steps.ipynb").read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), namespace)
            shown = [line for output in cell["outputs"] for line in output.get("text", ())]
            assert capsys.readouterr().out == "".join(shown)


def test_readme_is_short_its_links_lead_to_files_and_its_results_are_in_the_documentation():
    text, results = (ROOT / "README.md").read_text(), (ROOT / "docs/results.md").read_text()
    assert len(text.splitlines()) <= 60
    links = re.findall(r"\]\((.+?)\)", text)
    assert links
    assert [link for link in links if not (ROOT / link).is_file()] == []
    shares = re.findall(r"\d+\.\d %", text)
    assert len(shares) == 4
    assert [share for share in shares if share not in results] == []


def test_site_has_all_pages_and_its_search_works_without_a_network(tmp_path):
    for package in ("material", "mkdocstrings", "latex2mathml", "pygame"):
        pytest.importorskip(package, reason="the extra docs is not installed")
    site, environment = tmp_path / "site", os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(site)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    pages = [page.relative_to(ROOT / "docs").with_suffix(".html") for page in PAGES[1:]]
    assert [page for page in pages if not (site / page).is_file()] == []
    for page in site.rglob("*.html"):
        text = page.read_text()
        assert 'class="arithmatex"' not in text, page
    assert all(f"<code>{name}</code>" in (site / "environment.html").read_text() for name in ARGUMENTS)
    with chromium() as browser:
        page, problems = opened(browser, site / "physics" / "contact.html")
        for word, title in FOUND.items():
            page.locator(".md-search__input").fill("")
            page.locator(".md-search__input").press_sequentially(word)
            page.locator(".md-search-result__item h1", has_text=title).first.wait_for(timeout=120_000)
        assert problems == []
