"""Commands whose disk is full, then killed: nothing is lost or done again, and the end has the same bits."""

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import polars as pl
import pytest
from episodes import assert_identical
from job_cases import kept
from training import assert_same
from training import left as left_by_training

from agents.policies import load_ensemble

ROOT = Path(__file__).parents[1]
SET_UP = """
[training]
steps = 2048
envs = 16
rollout = 16
batch = 64
width = 8
validate_every = 1024
validation_scenarios = 10
checkpoint_every = 512
[evaluation]
weights = [1.0, 2.0, 4.0]
"""
SMALL = "--scenarios 8 --budget 16 --population 8 --processes 0"
DESIGN = "design linear-blind --free coupling.stiffness=20:200 --times 1.0 --seeds 2 --against bistable-blind"
COMMANDS = {
    "tune": f"tune ../mine.toml {SMALL} --out out --jobs out/jobs",
    "train": "train ../mine.toml --seeds 3 --processes 0 --out out/runs --policies out",
    "design": f"{DESIGN} {SMALL} --out out",
    "report": "report rigid-blind --count 4 --processes 0 --out out/page",
}


def started(words, folder):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    line = [sys.executable, "-m", "experiments.command", *words.split()]
    return subprocess.Popen(
        line, cwd=folder, env=environment, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )


def ended(process):
    """Return the exit code of a command and what it said of errors."""
    _, said = process.communicate(timeout=300)
    return process.returncode, said


def stopped(words, folder, ready, stop):
    """Run a command until `ready()`, then `stop` it by its process number; return its exit code and what it said."""
    process = started(words, folder)
    while not ready():
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.005)
    stop(process.pid)
    return ended(process)


def fill(pid):
    """From now on no file that the process writes may grow."""
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))


def kill(pid):
    os.kill(pid, signal.SIGKILL)


def left(folder):
    """Return what a command left that says neither when nor how fast: files, tables, answers, policies."""
    out = folder / "out"
    files = [path for kind in ("*.json", "page/*.parquet", "*.toml", "front.svg") for path in out.glob(kind)]
    content = {path.name: path.read_bytes() for path in files if path.name != "results.json"}
    for path in out.glob("*.csv"):
        content[path.name] = pl.read_csv(path).drop("seconds", "clock", strict=False).write_csv()
    if (results := out / "page" / "results.json").is_file():
        content["answers"] = json.loads(results.read_text())["answers"]
    for path in out.glob("*.npz"):
        ensemble = load_ensemble(path)
        content["seeds"] = [policy.seed for policy in ensemble.policies], ensemble[None].seed
        content["runs"] = [left_by_training(run) for run in sorted((out / "runs").glob("seed-*"))]
    assert content
    return content


@pytest.mark.parametrize("name", COMMANDS)
def test_command_goes_on_behind_a_full_disk_and_a_kill_and_ends_with_the_same_bits(name, tmp_path):
    part, whole = tmp_path / "part", tmp_path / "whole"
    part.mkdir()
    whole.mkdir()
    (tmp_path / "mine.toml").write_text(SET_UP)
    code, said = stopped(COMMANDS[name], part, lambda: kept(part), fill)
    assert code == 1
    assert "Traceback" not in said
    assert re.search(rf"^impact-gym {name}: no room to write .*out.*; make room: .+$", said, re.MULTILINE)
    first = kept(part)
    code, _ = stopped(COMMANDS[name], part, lambda: len(kept(part)) > len(first), kill)
    assert code == -signal.SIGKILL
    second = kept(part)
    assert len(second) > len(first) > 0
    assert ended(started(COMMANDS[name], part))[0] == 0
    assert first.items() <= second.items() <= kept(part).items()
    assert ended(started(COMMANDS[name], whole))[0] == 0
    assert_identical(left(part), left(whole))


def test_train_goes_on_behind_a_full_disk_and_a_kill_and_ends_with_the_same_bits(tmp_path):
    saved = tmp_path / "part" / "checkpoint.npz"
    (tmp_path / "mine.toml").write_text(SET_UP)
    code, said = stopped("train mine.toml --out part", tmp_path, saved.is_file, fill)
    assert code == 1
    assert re.search(r"^impact-gym train: no room to write .*part.*; make room: .*--resume", said, re.MULTILINE)
    assert "Traceback" not in said
    first = saved.stat().st_mtime_ns
    code, _ = stopped("train --resume part", tmp_path, lambda: saved.stat().st_mtime_ns > first, kill)
    assert code == -signal.SIGKILL
    assert ended(started("train --resume part", tmp_path))[0] == 0
    assert ended(started("train mine.toml --out whole", tmp_path))[0] == 0
    assert_same(tmp_path / "whole", tmp_path / "part")
