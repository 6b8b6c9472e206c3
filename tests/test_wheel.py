"""The wheel of `pip install impact-gym`: its files, and play without the checkout; the import of the package."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from importlib.metadata import Distribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import impact_gym
from experiments.command import COMMANDS

ROOT, PACKAGE = Path(__file__).parents[1], Path(impact_gym.__file__).parent
PACKAGES = ("impact_gym", "agents", "experiments")
NOT_SHIPPED = {".pyx", ".pxi", ".h", ".c", ".so"}
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
FOUND = f"""
import importlib.util, sys
from impact_gym.experiments.command import COMMANDS
print(*[importlib.util.find_spec(each.module).name for group in COMMANDS.values() for each in group.values()])
print(*[name for name, each in sys.modules.items() if str(getattr(each, "__file__", "")).startswith({f"{ROOT}/"!r})])
"""


def run(*command, where, check=True, **variables):
    """Run a command in a folder, without a way to find the checkout."""
    others = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [*map(str, command)], cwd=where, env=others | variables, capture_output=True, text=True, check=False,
        timeout=600,
    )  # fmt: skip
    assert done.returncode == 0 or not check, done.stderr
    return done


def output(code, path, where):
    """What Python prints that imports from the folder `path` first."""
    done = run(sys.executable, "-W", "error", "-c", code, where=where, check=False, PYTHONPATH=str(path))
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A wheel of a copy of the checkout, with the compiled solver of the checkout."""
    copy, out = tmp_path_factory.mktemp("sources"), tmp_path_factory.mktemp("wheel")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    for name in ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    (copy / "impact_gym" / "kernels.c").touch()  # newer than its sources, so that nothing is compiled again
    built = copy / "build" / f"lib.{sysconfig.get_platform()}-{sys.implementation.cache_tag}" / "impact_gym"
    built.mkdir(parents=True)
    for solver in PACKAGE.glob("kernels*.so"):
        shutil.copyfile(solver, built / solver.name)
    build = ("wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check")
    run(sys.executable, "-m", "pip", *build, "--wheel-dir", out, copy, where=out)
    (path,) = out.iterdir()
    return path


def test_wheel_has_all_files_but_the_sources_of_the_solver(wheel):
    archive = zipfile.ZipFile(wheel)
    held = {name for name in archive.namelist() if ".dist-info/" not in name}
    (solver,) = (name for name in held if name.endswith(".so"))
    assert solver.startswith("impact_gym/kernels.")
    files = [file.relative_to(ROOT) for name in PACKAGES for file in (ROOT / name).rglob("*") if file.is_file()]
    mine = {file for file in files if "__pycache__" not in file.parts and file.suffix not in NOT_SHIPPED}
    assert held - {solver} == {str(file if file.parts[0] == "impact_gym" else "impact_gym" / file) for file in mine}
    assert wheel.stat().st_size < 5e6
    (entry,) = (name for name in archive.namelist() if name.endswith("/entry_points.txt"))
    assert "impact-gym = impact_gym.experiments.command:main" in archive.read(entry).decode()
    for name in held - {solver}:  # else a module of another project would be imported
        assert not re.search(rb"(?m)^\s*(from|import) +(agents|experiments)\b.*import", archive.read(name)), name


def test_wheel_plays_like_the_checkout_without_it(wheel, tmp_path, capsys):
    zipfile.ZipFile(wheel).extractall(tmp_path / "wheel")
    for name in ("agents", "experiments"):  # openai-agents installs such a module
        (tmp_path / f"{name}.py").write_text(f"raise ImportError('this is another {name}')")
    played = output(TEN_LINES + FOUND, tmp_path / "wheel", tmp_path).splitlines()
    exec(TEN_LINES, {})
    modules = [each.module for group in COMMANDS.values() for each in group.values()]
    moved = [module if module.startswith("impact_gym.") else f"impact_gym.{module}" for module in modules]
    assert played == [capsys.readouterr().out.strip(), " ".join(moved), ""]


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
def commands(tmp_path_factory, wheel):
    """The commands of an environment with the wheel, its requirements, and other modules named like our folders."""
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


@pytest.mark.slow
def test_installed_wheel_works_or_names_what_to_install(commands, tmp_path):
    python, program = commands / "python", commands / "impact-gym"
    played = run(python, "-W", "error", "-c", EPISODES, where=tmp_path).stdout
    assert played == run(sys.executable, "-W", "error", "-c", EPISODES, where=ROOT).stdout
    assert len(played.splitlines()) > 2 * len(list((ROOT / "agents" / "setups").glob("*.toml")))
    assert "No module named 'torch'" in run(python, "-c", "import torch", where=tmp_path, check=False).stderr
    assert "--scene" in run(program, "identify", "--help", where=tmp_path).stdout
    assert "linear-blind: " in run(program, "policies", where=tmp_path).stdout
    refused = run(program, "controller", "linear-blind", where=tmp_path, check=False)
    assert (refused.returncode, refused.stdout) == (1, "")
    assert re.fullmatch(r".* controller needs torch, .* 'impact-gym\[train,report\]'\n", refused.stderr)
    (tmp_path / "experiments").mkdir()
    (tmp_path / "experiments" / "__init__.py").touch()
    (tmp_path / "mine.py").write_text("from impact_gym.agents.baselines import PaperTrapezoid as Rule\n")
    options = ("--policy", "linear-blind", "--baseline", "mine:Rule", "--count", "4", "--out", "page")
    run(program, "report", *options, where=tmp_path)
    assert "mine:Rule" in (tmp_path / "page" / "index.html").read_text()
    run(program, "study", "paper", "--only", "figure_02", "--out", "paper", where=tmp_path)
    assert (tmp_path / "paper" / "statements.csv").is_file()


def test_version_is_that_of_changelog_and_citation():
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    cited = re.search(r"^version: (\S+)", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert newest[1] == cited[1] == impact_gym.__version__


def test_import_loads_no_heavy_package_and_agents_once():
    heavy = {"torch", "stable_baselines3", "matplotlib", "tensorboard", "pygame", "pandas", "mujoco"}
    code = "import sys, impact_gym; print(*{name.split('.')[0] for name in sys.modules}); "
    code += "import agents.jobs, impact_gym.agents.jobs as jobs; print(jobs is agents.jobs, jobs.__spec__.name)"
    loaded, same = output(code, ROOT, ROOT).splitlines()
    assert "impact_gym" in loaded.split()
    assert heavy.isdisjoint(loaded.split())
    assert same == "True agents.jobs"


CHANGED = "sources of the solver have changed since it was compiled; compile it with `make"


@pytest.mark.parametrize(("changes", "message"), [
    ({"kernels*.so": None}, "the solver is not compiled; compile it with `make"),
    (dict.fromkeys(("*.pyx", "*/*.pxi", "*/*.h")), ""),  # as in a wheel
    (dict.fromkeys(("solver/dop853.pxi", "task/numbers.pxi")), ""),  # generated sources
    ({"physics/contact.pxi": ("cdef", " cdef")}, CHANGED),
    ({"solver/tableau.py": ("fifth", "sixth")}, CHANGED),
    ({"quantities.py": ('"m/s"', '"km/h"')}, CHANGED),
], ids=["no solver", "no sources", "no generated sources", "contact", "tableau", "quantities"])  # fmt: skip
def test_import_refuses_a_missing_or_outdated_solver(tmp_path, changes, message):
    copy = shutil.copytree(PACKAGE, tmp_path / "impact_gym", ignore=shutil.ignore_patterns("__pycache__"))
    for file, change in [(file, change) for name, change in changes.items() for file in copy.glob(name)]:
        if change is None:
            file.unlink()
        else:
            file.write_text(file.read_text().replace(*change, 1))
    answer = output("import impact_gym", tmp_path, tmp_path)
    assert message in answer if message else answer == ""
