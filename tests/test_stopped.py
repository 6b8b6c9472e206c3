"""Commands whose disk is full, then killed: nothing is lost or done again, and the end has the same bits."""

import json
import os
import re
import resource
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import polars as pl
import pytest
from training import assert_same

from agents.jobs import Job, gather_all
from impact_gym.files import DiskFullError

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
    "fits": "fits --scenes 2 --processes 0 --out out",
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


def kept(folder):
    """Return the results that are kept, a row's number by its key: one that is computed again gets another number."""
    rows = {}
    for path in folder.glob("**/results.sqlite"):
        with closing(sqlite3.connect(path, 60.0)) as database:
            if database.execute("SELECT count(*) FROM sqlite_master WHERE name = 'results'").fetchone()[0]:
                rows |= dict(database.execute("SELECT key, rowid FROM results"))
    return rows


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
    """Return what a command left that says neither when nor how fast: files, numbers of tables, answers."""
    out = folder / "out"
    files = [path for kind in ("*.json", "page/*.parquet", "*.toml", "front.svg") for path in out.glob(kind)]
    content = {path.name: path.read_bytes() for path in files if path.name != "results.json"}
    for path in out.glob("*.csv"):
        content[path.name] = pl.read_csv(path).drop("seconds", "clock", strict=False).write_csv()
    if (results := out / "page" / "results.json").is_file():
        content["answers"] = json.loads(results.read_text())["answers"]
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
    assert re.search(rf"^impact-gym {name}: no room to write .*(out|fits).*; make room: .+$", said, re.MULTILINE)
    first = kept(part)
    code, _ = stopped(COMMANDS[name], part, lambda: len(kept(part)) > len(first), kill)
    assert code == -signal.SIGKILL
    second = kept(part)
    assert len(second) > len(first) > 0
    assert ended(started(COMMANDS[name], part))[0] == 0
    assert first.items() <= second.items() <= kept(part).items()
    assert ended(started(COMMANDS[name], whole))[0] == 0
    assert left(part) == left(whole)


def test_train_goes_on_behind_a_full_disk_and_a_kill_and_ends_with_the_same_bits(tmp_path):
    saved = tmp_path / "part" / "checkpoint.npz"
    (tmp_path / "mine.toml").write_text(SET_UP)
    code, said = stopped("train mine.toml --out part", tmp_path, saved.is_file, fill)
    assert code == 1
    assert re.search(r"^impact-gym train: no room to write .*part.*; make room: --resume with", said, re.MULTILINE)
    assert "Traceback" not in said
    first = saved.stat().st_mtime_ns
    code, _ = stopped("train --resume part", tmp_path, lambda: saved.stat().st_mtime_ns > first, kill)
    assert code == -signal.SIGKILL
    assert ended(started("train --resume part", tmp_path))[0] == 0
    assert ended(started("train mine.toml --out whole", tmp_path))[0] == 0
    assert_same(tmp_path / "whole", tmp_path / "part")


@pytest.mark.parametrize("processes", [0, 1])
def test_gather_ends_where_a_job_finds_no_room_and_keeps_what_is_done(processes, tmp_path):
    given = {"log": str(tmp_path / "log"), "number": 1}
    jobs = [Job("cluster_work:numbers", given), Job("cluster_work:finds_no_room", {"path": str(tmp_path / "file")})]
    with pytest.raises(DiskFullError, match=r"no room to write .*file: No space left on device"):
        gather_all(jobs, tmp_path, processes=processes, failures=True)
    assert len(kept(tmp_path)) == 1
