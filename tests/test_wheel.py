"""The wheel of `pip install impact-gym`, in an environment with its requirements alone; the import of the package."""

import os
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from importlib.metadata import Distribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import impact_gym

ROOT = Path(__file__).parents[1]
PACKAGES = ("impact_gym", "agents", "experiments")
NOT_SHIPPED = {".pyx", ".pxi", ".h", ".c", ".so"}
BUILT = shutil.ignore_patterns("__pycache__", "*.so", "kernels.c", "dop853.pxi", "numbers.pxi")
TEN_LINES = re.search(r"```python\n(import gymnasium.*?)```", (ROOT / "docs/index.md").read_text(), re.DOTALL)[1]
EPISODES = """
from impact_gym.agents import baselines, load_policy, load_setup
from impact_gym.agents.setups import shipped

for setup in map(load_setup, shipped()):
    paper = baselines.PaperTrapezoid().for_task(setup.task)
    for controller in (load_policy(setup.name), *map(baselines.load_baseline, setup.tuned), paper):
        env = setup.make()
        (observation, info), state, ended = env.reset(seed=1), None, False
        while not ended:
            action, state = controller.predict(observation, state=state)
            observation, reward, ended, truncated, info = env.step(action)
        print(setup.name, type(controller).__name__, info["approach_time"], info["object_velocity"])
"""


def run(*command, where, check=True, **variables):
    """Run a command in a folder, without a way to find the checkout."""
    others = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [*map(str, command)], cwd=where, env=others | variables, capture_output=True, text=True, check=False,
        timeout=300,
    )  # fmt: skip
    assert done.returncode == 0 or not check, done.stderr
    return done


def required(requirements, extra=""):
    """Names of the installed distributions that requirements need, directly or not."""
    names, waiting = set(), [(line, extra) for line in requirements]
    while waiting:
        line, of_extra = waiting.pop()
        needed = Requirement(line)
        name = canonicalize_name(needed.name)
        if name not in names and (needed.marker is None or needed.marker.evaluate({"extra": of_extra})):
            names.add(name)
            waiting += [(further, "") for further in distribution(name).requires or ()]
    return names


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A wheel of the checkout, built from a copy, so that no build files are left in the checkout."""
    copy, out = tmp_path_factory.mktemp("sources"), tmp_path_factory.mktemp("wheel")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, copy / name, ignore=BUILT)
    for name in ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    build = ("wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check")
    run(sys.executable, "-m", "pip", *build, "--wheel-dir", out, copy, where=out)
    (path,) = out.iterdir()
    return path


@pytest.fixture(scope="module")
def commands(tmp_path_factory, wheel):
    """The commands of an environment with the wheel and the requirements of it and its report.

    It also has other modules named like our folders, as openai-agents installs one.
    """
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder, with_pip=False)
    (packages,) = folder.glob("lib/python*/site-packages")
    install = ("install", "--quiet", "--no-deps", "--no-index", "--disable-pip-version-check", wheel)
    run(sys.executable, "-m", "pip", "--python", folder / "bin" / "python", *install, where=folder)
    (metadata,) = packages.glob("impact_gym-*.dist-info")
    for name in required(Distribution.at(metadata).requires, "report"):
        files = distribution(name).files
        for top in {file.parts[0] for file in files} - {"..", "__pycache__"}:
            (packages / top).symlink_to(distribution(name).locate_file(top))
    for name in ("agents", "experiments"):
        (packages / f"{name}.py").write_text(f"raise ImportError('this is another {name}')")
    return folder / "bin"


def test_wheel_has_every_file_of_the_packages_except_the_sources_of_the_solver(wheel):
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    (solver,) = (name for name in held if name.endswith(".so"))
    assert solver.startswith("impact_gym/kernels.")
    files = [file.relative_to(ROOT) for name in PACKAGES for file in (ROOT / name).rglob("*") if file.is_file()]
    mine = {file for file in files if "__pycache__" not in file.parts and file.suffix not in NOT_SHIPPED}
    assert held - {solver} == {str(file if file.parts[0] == "impact_gym" else "impact_gym" / file) for file in mine}
    assert wheel.stat().st_size < 5e6


def test_policies_and_baselines_of_the_wheel_have_the_results_of_the_checkout_without_torch(commands, tmp_path):
    for code in (TEN_LINES, EPISODES):
        played = run(commands / "python", "-W", "error", "-c", code, where=tmp_path).stdout
        assert played == run(sys.executable, "-W", "error", "-c", code, where=ROOT).stdout
    assert len(played.splitlines()) > 2 * len(list((ROOT / "agents" / "setups").glob("*.toml")))
    refused = run(commands / "python", "-c", "import torch", where=tmp_path, check=False)
    assert "No module named 'torch'" in refused.stderr


def test_command_runs_or_says_in_one_line_what_to_install(commands, tmp_path):
    assert "identify" in run(commands / "impact-gym", "--help", where=tmp_path).stdout
    assert "--scene" in run(commands / "impact-gym", "identify", "--help", where=tmp_path).stdout
    assert "linear-blind: " in run(commands / "impact-gym", "policies", where=tmp_path).stdout
    refused = run(commands / "impact-gym", "controller", "linear-blind", where=tmp_path, check=False)
    assert (refused.returncode, refused.stdout) == (1, "")
    (line,) = refused.stderr.splitlines()
    assert line.startswith("impact-gym controller needs torch, ")
    assert line.endswith("pip install 'impact-gym[train,report]'")


def test_report_and_study_run_in_a_folder_with_its_own_baseline_and_package_experiments(commands, tmp_path):
    (tmp_path / "experiments").mkdir()
    (tmp_path / "experiments" / "__init__.py").touch()
    (tmp_path / "mine.py").write_text("from impact_gym.agents.baselines import PaperTrapezoid as Rule\n")
    options = ("--policy", "linear-blind", "--baseline", "mine:Rule", "--count", "4", "--out", "page")
    run(commands / "impact-gym", "report", *options, where=tmp_path)
    assert "mine:Rule" in (tmp_path / "page" / "index.html").read_text()
    run(commands / "impact-gym", "study", "paper", "--only", "figure_02", "--out", "paper", where=tmp_path)
    assert (tmp_path / "paper" / "statements.csv").is_file()


def test_version_is_that_of_changelog_and_citation():
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    cited = re.search(r"^version: (\S+)", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert newest[1] == cited[1] == impact_gym.__version__


PACKAGE = Path(impact_gym.__file__).parent


def printed(code, where=PACKAGE.parent):
    """What a new process prints, with the package in the folder `where`."""
    process = run(sys.executable, "-W", "error", "-c", code, where=where, check=False, PYTHONPATH=str(where))
    return process.stdout + process.stderr


def test_import_does_not_load_the_packages_for_learning_and_plotting():
    heavy = {"torch", "stable_baselines3", "matplotlib", "tensorboard", "pygame", "pandas", "mujoco"}
    loaded = printed("import sys, impact_gym; print(*sorted({name.split('.')[0] for name in sys.modules}))").split()
    assert "impact_gym" in loaded
    assert heavy.isdisjoint(loaded)


CHANGED = "sources of the solver have changed since it was compiled; compile it with `make"


@pytest.mark.parametrize(("changes", "message"), [
    ({"kernels*.so": None}, "the solver is not compiled; compile it with `make"),
    (dict.fromkeys(("*.pyx", "*/*.pxi", "*/*.h")), ""),  # as in a wheel
    (dict.fromkeys(("solver/dop853.pxi", "task/numbers.pxi")), ""),  # generated sources
    ({"physics/contact.pxi": ("cdef", " cdef")}, CHANGED),
    ({"solver/tableau.py": ("fifth", "sixth")}, CHANGED),
    ({"quantities.py": ('"m/s"', '"km/h"')}, CHANGED),
], ids=str)  # fmt: skip
def test_import_refuses_a_missing_or_outdated_solver_but_no_missing_sources(tmp_path, changes, message):
    copy = shutil.copytree(PACKAGE, tmp_path / "impact_gym", ignore=shutil.ignore_patterns("__pycache__"))
    for file, change in [(file, change) for name, change in changes.items() for file in copy.glob(name)]:
        if change is None:
            file.unlink()
        else:
            file.write_text(file.read_text().replace(*change, 1))
    answer = printed("import impact_gym", copy.parent)
    assert message in answer if message else answer == ""


def test_impact_gym_agents_is_the_module_agents_in_a_checkout():
    same = "import agents.jobs, impact_gym.agents.jobs as jobs; print(jobs is agents.jobs, jobs.__spec__.name)"
    assert printed(same) == "True agents.jobs\n"
