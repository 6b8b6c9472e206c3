"""How the package loads and compiles, each time in a fresh process."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import impact_gym

PACKAGE = Path(impact_gym.__file__).parent
NOTICE = "impact_gym: compiling the solver for this machine"


def run(code, *, where=PACKAGE.parent, cache=None):
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment["PYTHONPATH"] = str(where)
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    command = [sys.executable, "-W", "error", "-c", code]
    return subprocess.run(command, env=environment, cwd=where, capture_output=True, text=True, check=True, timeout=300)


def test_importing_the_package_does_not_load_what_learning_and_plotting_need():
    heavy = {"torch", "stable_baselines3", "sb3_contrib", "matplotlib", "tensorboard", "pygame", "pandas", "mujoco"}
    loaded = run("import sys, impact_gym; print(*sorted({name.split('.')[0] for name in sys.modules}))").stdout.split()
    assert "impact_gym" in loaded
    assert heavy.isdisjoint(loaded)


APPROACH = """
import impact_gym as ig
import impact_gym.kernel
impact_gym.kernel._NOTICE_AFTER = 0.2  # s, so that a fast machine is no exception
scene = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.2505), ig.Contact(1e5, 0.5))
print(ig.simulate(scene, ig.Trapezoid(1.0, 8.0)).object_velocity)
"""


def test_compiling_is_announced_once_on_stderr_and_not_when_all_is_compiled(tmp_path):
    cold, warm = run(APPROACH, cache=tmp_path), run(APPROACH, cache=tmp_path)
    assert cold.stderr.count(NOTICE) == 1
    assert NOTICE not in warm.stderr
    assert cold.stdout == warm.stdout


LAW = """
from impact_gym.kernel import kernel

@kernel
def force(penetration: float) -> float:
    return {factor} * penetration
"""

CALLER = """
from impact_gym.kernel import kernel
from impact_gym.physics import new_law

@kernel
def rate(penetration: float) -> float:
    return 1.0 + new_law.force(penetration)
"""

CALL = """
from impact_gym.solver import new_caller
print(new_caller.rate(1.0), sum(new_caller.rate.stats.cache_hits.values()))
"""


@pytest.mark.parametrize("elsewhere", [False, True], ids=["cache beside the sources", "cache in NUMBA_CACHE_DIR"])
def test_a_kernel_does_not_outlive_a_change_in_a_law_that_it_calls_from_another_file(tmp_path, elsewhere):
    copy, cache = tmp_path / "impact_gym", tmp_path / "cache" if elsewhere else None
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "solver" / "new_caller.py").write_text(CALLER)

    (copy / "physics" / "new_law.py").write_text(LAW.format(factor=2.0))
    assert run(CALL, where=tmp_path, cache=cache).stdout.split() == ["3.0", "0"]
    assert run(CALL, where=tmp_path, cache=cache).stdout.split() == ["3.0", "1"]  # from the cache

    (copy / "physics" / "new_law.py").write_text(LAW.format(factor=5.0))
    assert run(CALL, where=tmp_path, cache=cache).stdout.split() == ["6.0", "0"]
    assert run(CALL, where=tmp_path, cache=cache).stdout.split() == ["6.0", "1"]


def test_where_numba_is_told_not_to_compile_a_run_is_refused_in_a_sentence(monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    code = "import gymnasium as gym, impact_gym\ntry: gym.make('ImpactApproach-v0')\nexcept RuntimeError as e: print(e)"
    assert "NUMBA_DISABLE_JIT" in run(code).stdout


RECORD = """
from typing import NamedTuple
from impact_gym.kernel import kernel

class {name}(NamedTuple):
    stiffness: float

@kernel
def force(law: {name}) -> float:
    return law.stiffness
"""


def test_a_cache_that_names_a_record_which_is_gone_is_taken_for_empty(tmp_path):
    copy = tmp_path / "impact_gym"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("Before", "After"):
        (copy / "physics" / "new_law.py").write_text(RECORD.format(name=name))
        call = f"from impact_gym.physics.new_law import {name}, force; print(force({name}(2.0)))"
        assert run(call, where=tmp_path).stdout == "2.0\n"


def test_a_stranger_without_a_module_name_compiles_beside_us():
    """numba's event of a compilation reaches our notice for everybody's functions."""
    code = "import numba, impact_gym; f = numba.njit(lambda x: x + 1); f.py_func.__module__ = None; print(f(1))"
    assert run(code).stdout == "2\n"


def test_the_package_runs_uncompiled(monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    code = "from impact_gym.physics.contact import Hertz, force; print(force(Hertz(1.0, 0.0), 2.0, 1.0))"
    assert run(code).stdout == "8.0\n"
