"""The documentation is true: every fenced block of README.md and docs/**/*.md is run, or its options are parsed.

The blocks of a page share one folder and one namespace, from top to bottom. A block with a title is a file. Python
runs, stable-baselines3 for one rollout. Shell commands run; for those of SLOW only the options are parsed. A block of
text is the output of the block above it. Scripts of docs/examples print the numbers of `simulate`.
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
import warnings
from pathlib import Path
from pkgutil import resolve_name

import gymnasium as gym
import numpy as np
import pytest
from browser_pages import chromium, opened
from printed_commands import MODULES, read_options, read_printed
from solver_scenes import MOTION, scene

import impact_gym as ig
from agents.policies import SHIPPED
from agents.setups import feasible, load_setup
from experiments import policies
from experiments.design.options import DRAWN
from experiments.design.pads import on_pad
from impact_gym.task import ScenarioRanges, Task
from impact_gym.task.task import ARGUMENTS

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(\w*)(?: title=\"(.+?)\")?\n(.*?)^```$", re.DOTALL | re.MULTILINE)
EXAMPLES = ROOT / "docs" / "examples"
LISTED = {file.read_text() for file in EXAMPLES.glob("*.py")}
"""Listings, which have tests of their own below."""
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
NEEDS = {"deploy-c.md": "onnxruntime", "mujoco.md": "mujoco"}
NEEDS |= dict.fromkeys(("README.md", "libraries.md"), "stable_baselines3")
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "error"}
ALIKE = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def run_python(words, monkeypatch, capsys):
    """Run a script or -m module in this process; return what it prints. A warning is an error."""
    module, arguments = words[0] == "-m", words[words[0] == "-m" :]
    capsys.readouterr()
    with monkeypatch.context() as patched, warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*found in sys.modules", RuntimeWarning)
        patched.setattr(sys, "argv", arguments)
        (runpy.run_module if module else runpy.run_path)(arguments[0], run_name="__main__")
    return capsys.readouterr().out


def run_shell(code, monkeypatch, capsys):
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
        elif ELSEWHERE & {*words[:3]}:
            continue
        elif words[0] == "python" and words[1].startswith(("docs/examples/", "-m")):
            words = [str(ROOT / word) if word.startswith("docs/examples/") else word for word in words]
            printed += run_python(words[1:], monkeypatch, capsys)
        else:
            words = [sys.executable, *words[1:]] if words[0] == "python" else words
            done = subprocess.run(words, env=ENVIRONMENT, capture_output=True, text=True, check=False)
            assert done.returncode == 0, f"{words}\n{done.stderr}"
            printed += done.stdout
    return printed


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_examples_of_a_page_run_and_print_what_it_shows(page, tmp_path, monkeypatch, capsys):
    if page.name in NEEDS:
        needed = pytest.importorskip(NEEDS[page.name])
        if learn := getattr(getattr(needed, "PPO", None), "learn", None):
            monkeypatch.setattr(needed.PPO, "learn", lambda model, steps: learn(model, 1))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    namespace, printed = {"__name__": "__main__"}, None
    text = page.read_text()
    assert text.count("```") == 2 * len(BLOCK.findall(text)), f"{page}: not all blocks are understood"
    for block in BLOCK.finditer(text):
        (language, title, code), line = block.groups(), text[: block.start()].count("\n") + 2
        where = f"{page.relative_to(ROOT)}, line {line}"
        assert max(map(len, code.splitlines())) <= 88, f"{where}: wider than a column"
        if title:
            assert language in ("toml", "json", "c", "python"), where
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
            printed = run_shell(code, monkeypatch, capsys)
        elif language == "text":
            assert printed is not None, f"{where}: output of nothing"
            assert doctest.OutputChecker().check_output(code, printed, ALIKE), f"{where}: printed was\n{printed}"
            printed = None
        elif language == "toml":
            tomllib.loads(code)
        else:
            assert language == "diff", f"{where}: no test of {language!r}"


PRINTED = {
    *(command for page in PAGES for earlier, command in re.findall(
        r"(8fc14f9 \W*(?:with\s+)?)?`(impact-gym [a-z][^`]*)`", page.read_text()) if not earlier),
    *(command for path in SHIPPED.glob("*.npz") for command in re.findall(
        r"made by: (impact-gym [^(]*)", "\n".join(policies.card(path.stem)))),
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
                assert heading in map(slug, titles), f"{page}: {target}#{heading}"


def slug(title):
    """The address of a heading on a page."""
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower())


def test_readme_is_short_and_its_results_are_in_the_pages():
    text, results = (ROOT / "README.md").read_text(), (ROOT / "docs/results.md").read_text()
    assert len(text.splitlines()) <= 60
    shares = re.findall(r"\d+\.\d %", text)
    assert len(shares) == 4
    assert [share for share in shares if share not in results] == []


@pytest.mark.slow
def test_site_has_all_pages_and_a_search_without_network(tmp_path):
    for package in ("material", "mkdocstrings", "latex2mathml", "pygame"):
        pytest.importorskip(package, reason="the extra docs is not installed")
    site, environment = tmp_path / "site", os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(site)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    pages = [page.relative_to(ROOT / "docs").with_suffix(".html") for page in PAGES[1:]]
    assert [page for page in pages if not (site / page).is_file()] == []
    assert [page for page in site.rglob("*.html") if 'class="arithmatex"' in page.read_text()] == []
    assert all(f"<code>{name}</code>" in (site / "environment.html").read_text() for name in ARGUMENTS)
    with chromium() as browser:
        page, problems = opened(browser, site / "physics" / "contact.html")
        for word, title in FOUND.items():
            page.locator(".md-search__input").fill("")
            page.locator(".md-search__input").press_sequentially(word)
            page.locator(".md-search-result__item h1", has_text=title).first.wait_for(timeout=120_000)
        assert problems == []


@pytest.fixture
def printed_by(monkeypatch, capsys):
    """A function that returns the numbers in each line that an example prints."""

    def numbers(name, *arguments):
        printed = run_python([str(EXAMPLES / name), *arguments], monkeypatch, capsys)
        return [[float(number) for number in re.findall(r"-?\d+(?:\.\d+)?", line)] for line in printed.splitlines()]

    return numbers


@pytest.mark.parametrize("name", ["designed-mechanism.toml", "designed-foam.toml"])
def test_designed_end_effector_is_a_possible_set_up(name):
    setup = load_setup(EXAMPLES / name)
    sentences = feasible.warnings(Task(**setup.environment))  # its controller stays below that acceleration
    assert [sentence for sentence in sentences if "the front stop holds the tool up to" not in sentence] == []
    assert setup.training.steps == load_setup("linear-blind").training.steps


def test_padded_design_has_the_usual_contacts_behind_its_pad():
    setup, usual = load_setup(EXAMPLES / "designed-foam.toml"), ScenarioRanges()
    corners = np.array([on_pad("memory-foam", k, e) for k in usual.contact_stiffness for e in usual.restitution])
    for name, values in zip(("contact_stiffness", "restitution"), corners.T, strict=True):
        assert setup.environment["scenario"][name] == pytest.approx([values.min(), values.max()])
    assert "on a pad of memory-foam" in setup.about
    assert DRAWN in setup.about


def test_mechanism_is_held_in_every_corner_of_its_ranges():
    task = Task(**load_setup(EXAMPLES / "bistable-robust.toml").environment)
    assert (feasible.warnings(task), len([*feasible.corners(task)])) == ([], 64)


def test_loops_print_what_simulate_gives(printed_by):
    lines = printed_by("gymnasium_loop.py")
    ((*means, scenarios),) = printed_by("vector_loop.py")
    envs = gym.make_vec("ImpactApproach-v0", 1000)
    envs.reset(seed=0)
    paths = "object.mass", "contact.stiffness", "contact.restitution", "object.distance"
    drawn = dict(zip(paths, envs.unwrapped.batch.info()["scenario"].values(), strict=True))
    outcomes = ig.sweep(scene(coupling=ig.SpringDamper(50.0)), MOTION, drawn, duration=3.0)
    expected = np.column_stack([outcomes.first_contact, outcomes.object_velocity])
    assert [line[0] for line in lines] == list(range(5))
    assert np.array([line[1:3] for line in lines]) == pytest.approx(expected[:5], rel=0, abs=0.51e-4)  # four decimals
    assert means == pytest.approx(expected.mean(axis=0), rel=0, abs=0.51e-4)
    assert scenarios == 1000


@pytest.mark.slow
def test_stable_baselines3_script_learns(printed_by):
    (untrained,), (steps, trained) = printed_by("stable_baselines3_ppo.py", "32768")
    assert steps == 32768
    assert untrained + 0.05 < trained < 0.0
