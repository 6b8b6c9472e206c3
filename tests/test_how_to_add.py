"""The files that CONTRIBUTING.md names are enough to add something: a test adds toys to a copy, and they work."""

import os
import re
import shutil
import subprocess
import sys
import tomllib

import pytest
from printed_commands import ROOT

TOYS = tomllib.loads((ROOT / "tests" / "toys.toml").read_text())
ADDING = (ROOT / "CONTRIBUTING.md").read_text().partition("## How to add")[2].partition("\n## ")[0]
OTHERS = """
import gymnasium as gym
import impact_gym as ig
couplings = ig.Rigid(), ig.SpringDamper(50.0, 1.0), ig.SpringDamper(50.0, 1.0, stroke=0.03), ig.Bistable()
for coupling in couplings:
    for robot in (None, ig.Robot(5.0, 1e5, 50.0)):
        scene = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.1), ig.Contact(1e5, 0.5), coupling, robot)
        print(ig.simulate(scene, ig.Trapezoid(1.0, 8.0, ig.Brake())))
for name in ("ImpactApproach-v0", "ImpactApproachRanged-v0", "ImpactTeleop-v0"):
    env = gym.make(name, tool_mass=(0.1, 0.2))
    print(env.reset(seed=1), [env.step(env.action_space.low) for _ in range(20)])
"""


def printed(code, folder):
    """What Python prints that imports the packages in `folder`."""
    done = subprocess.run([sys.executable, "-P", "-c", code], cwd=folder, env=os.environ | {"PYTHONPATH": str(folder)},
                          capture_output=True, text=True, check=False)  # fmt: skip
    assert not done.returncode, done.stderr
    return done.stdout


def add(edit, folder):
    """Make one edit of a toy in the project in `folder`."""
    path, new = folder / edit["file"], edit["lines"].strip("\n").split("\n")
    lines = path.read_text().split("\n") if {"after", "before"} & edit.keys() else []
    begin = edit.get("after", edit.get("before"))
    found = [index for index, line in enumerate(lines) if line.startswith(begin)]
    assert len(found) == bool(lines), f"{begin!r} begins {len(found)} lines of {path.name}"
    at = found[0] + ("after" in edit) if found else 0
    path.write_text("\n".join([*lines[:at], *new, *lines[at:]]))


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("copy") / "project"
    left_out = shutil.ignore_patterns(".*", "build", "reports", "site", "*.so", "__pycache__")
    shutil.copytree(ROOT, folder, ignore=left_out)
    for toy in TOYS.values():
        for edit in toy["edits"]:
            add(edit, folder)
    subprocess.run([sys.executable, "setup.py", "-q", "build_ext", "--inplace"], cwd=folder, check=True)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("kind", TOYS)
def test_files_that_contributing_names_are_enough(kind, copy):
    named = re.search(rf"^\| \*\*{kind}\*\*.*", ADDING, re.MULTILINE)[0]
    for edit in TOYS[kind]["edits"]:
        assert any(edit["file"].startswith(name) for name in re.findall(r"`([\w./]+)`", named)), edit["file"]
    printed(TOYS[kind]["check"], copy)


@pytest.mark.slow
def test_what_is_added_changes_no_result_of_another(copy):
    assert printed(OTHERS, copy) == printed(OTHERS, ROOT)
