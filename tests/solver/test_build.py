"""How the package loads: what it leaves alone, and that a solver which is not what its sources say is refused."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import impact_gym

PACKAGE = Path(impact_gym.__file__).parent


def printed(code, where=PACKAGE.parent):
    """What a fresh process prints, with the package that lies in `where`."""
    process = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], env=os.environ | {"PYTHONPATH": str(where)}, cwd=where,
        capture_output=True, text=True, check=False, timeout=100,
    )  # fmt: skip
    return process.stdout + process.stderr


@pytest.fixture
def copy(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "impact_gym", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "impact_gym"


def test_import_does_not_load_what_learning_and_plotting_need():
    heavy = {"torch", "stable_baselines3", "matplotlib", "tensorboard", "pygame", "pandas", "mujoco"}
    loaded = printed("import sys, impact_gym; print(*sorted({name.split('.')[0] for name in sys.modules}))").split()
    assert "impact_gym" in loaded
    assert heavy.isdisjoint(loaded)


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        ([], "sources of the solver have changed since it was compiled; compile it with `make"),
        (["kernels*.so"], "the solver is not compiled; compile it with `make"),
        (["*.pyx", "*/*.pxi"], ""),  # a wheel without sources is taken as it is
    ],
)
def test_import_refuses_a_solver_that_is_not_what_its_sources_say(copy, missing, message):
    if not missing:
        with (copy / "physics" / "contact.pxi").open("a") as law:
            law.write("\n# another law\n")
    for file in [file for pattern in missing for file in copy.glob(pattern)]:
        file.unlink()
    answer = printed("import impact_gym", copy.parent)
    assert message in answer if message else answer == ""
