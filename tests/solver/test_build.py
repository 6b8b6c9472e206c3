"""How the package loads: what it leaves alone, and that a solver which is not what its sources say is refused."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import impact_gym

PACKAGE = Path(impact_gym.__file__).parent


def run(code, where=PACKAGE.parent):
    """A fresh process's standard output, with the package that lies in `where`."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], env=os.environ | {"PYTHONPATH": str(where)}, cwd=where,
        capture_output=True, text=True, check=False, timeout=100,
    )  # fmt: skip
    return done.stdout + done.stderr


@pytest.fixture
def copy(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "impact_gym", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "impact_gym"


def test_importing_the_package_does_not_load_what_learning_and_plotting_need():
    heavy = {"torch", "stable_baselines3", "matplotlib", "tensorboard", "pygame", "pandas", "mujoco"}
    loaded = run("import sys, impact_gym; print(*sorted({name.split('.')[0] for name in sys.modules}))").split()
    assert "impact_gym" in loaded
    assert heavy.isdisjoint(loaded)


def test_a_solver_does_not_outlive_a_change_of_a_law_that_it_was_compiled_from(copy):
    assert run("import impact_gym", copy.parent) == ""
    with (copy / "physics" / "contact.pxi").open("a") as law:
        law.write("\n# another law\n")
    said = run("import impact_gym", copy.parent)
    assert "sources of the solver have changed since it was compiled; compile it with `make" in said


@pytest.mark.parametrize(
    ("missing", "says"),
    [
        (["kernels*.so"], "the solver is not compiled; compile it with `make"),
        (["*.pyx", "*/*.pxi"], None),  # a wheel without sources is taken as it is
    ],
)
def test_a_package_that_is_not_compiled_says_what_to_do(copy, missing, says):
    for file in [file for pattern in missing for file in copy.glob(pattern)]:
        file.unlink()
    said = run("import impact_gym", copy.parent)
    assert said == "" if says is None else says in said
