"""The wheel of `pip install impact-gym`: its files, and play without the checkout; the import of the package."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

import impact_gym

ROOT, PACKAGE = Path(__file__).parents[1], Path(impact_gym.__file__).parent
PACKAGES = ("impact_gym", "agents", "experiments")
NOT_SHIPPED = {".pyx", ".pxi", ".h", ".so"}
TEN_LINES = re.search(r"```python\n(import gymnasium.*?)```", (ROOT / "docs/gymnasium.md").read_text(), re.DOTALL)[1]
HEAVY = {"torch", "stable_baselines3", "matplotlib", "tensorboard", "pygame", "pandas", "polars", "tyro", "mujoco"}
CORE_ALONE = f"import sys; sys.modules.update(dict.fromkeys({HEAVY!r}))\n"  # importing one of these then fails
FOUND = f"""
import sys, impact_gym.experiments.command
ours = tuple({[f"{ROOT / name}/" for name in PACKAGES]!r})
print(*[name for name, each in sys.modules.items() if str(getattr(each, "__file__", "")).startswith(ours)])
"""


def output(code, path):
    """What Python prints that imports from the folder `path` first, and not from the folder above, where it runs."""
    variables = os.environ | {"PYTHONPATH": str(path)}
    command = [sys.executable, "-W", "error", "-P", "-c", code]
    done = subprocess.run(command, cwd=path.parent, env=variables, capture_output=True, text=True, check=False)
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
    subprocess.run([sys.executable, "-m", "pip", *build, "--wheel-dir", out, copy], cwd=out, check=True)
    return next(out.iterdir())


def test_wheel_has_all_files_but_the_sources_of_the_solver(wheel):
    archive = zipfile.ZipFile(wheel)
    held = {name for name in archive.namelist() if ".dist-info/" not in name}
    (solver,) = (name for name in held if re.fullmatch(r"impact_gym/kernels\..+\.so", name))
    files = [file.relative_to(ROOT) for name in PACKAGES for file in (ROOT / name).rglob("*") if file.is_file()]
    mine = {file for file in files if "__pycache__" not in file.parts and file.suffix not in NOT_SHIPPED}
    mine -= {Path("impact_gym/kernels.c")}
    assert held - {solver} == {str(file if file.parts[0] == "impact_gym" else "impact_gym" / file) for file in mine}
    (entry,) = (name for name in archive.namelist() if name.endswith("/entry_points.txt"))
    assert "impact-gym = impact_gym.experiments.command:main" in archive.read(entry).decode()
    for name in held - {solver}:  # else a module of another project would be imported
        assert not re.search(rb"(?m)^\s*(from|import) +(agents|experiments)\b.*import", archive.read(name)), name


def test_wheel_plays_like_the_checkout_without_it(wheel, tmp_path, capsys):
    zipfile.ZipFile(wheel).extractall(tmp_path / "wheel")
    for name in ("agents", "experiments"):  # modules named like our folders; openai-agents installs one
        (tmp_path / f"{name}.py").write_text(f"raise ImportError('this is another {name}')")
    played = output(CORE_ALONE + TEN_LINES + FOUND, tmp_path / "wheel").splitlines()
    exec(TEN_LINES, {})
    assert played == [capsys.readouterr().out.strip(), ""]


def test_version_is_that_of_changelog_and_citation():
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    cited = re.search(r"^version: (\S+)", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert newest[1] == cited[1] == impact_gym.__version__


def test_import_loads_no_heavy_package_and_agents_once():
    code = "import sys, impact_gym; print(*{name.split('.')[0] for name in sys.modules}); "
    code += "import agents.jobs, impact_gym.agents.jobs as jobs; print(jobs is agents.jobs, jobs.__spec__.name)"
    loaded, same = output(code, ROOT).splitlines()
    assert HEAVY.isdisjoint(loaded.split())
    assert same == "True agents.jobs"


CHANGED = "sources of the solver have changed since it was compiled; compile it with `make"


@pytest.mark.parametrize(("name", "change", "message"), [
    ("kernels*.so", None, "the solver is not compiled; compile it with `make"),
    ("physics/contact.pxi", ("cdef", " cdef"), CHANGED), ("quantities.py", ('"m/s"', '"km/h"'), CHANGED),
])  # fmt: skip
def test_import_refuses_a_missing_or_outdated_solver(tmp_path, name, change, message):
    copy = shutil.copytree(PACKAGE, tmp_path / "impact_gym", ignore=shutil.ignore_patterns("__pycache__"))
    for file in copy.glob(name):
        file.write_text(file.read_text().replace(*change, 1)) if change else file.unlink()
    assert message in output("import impact_gym", tmp_path)
