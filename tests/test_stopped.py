"""Commands that find the disk full, and then are killed: nothing is lost or repeated, and the bits are the same.

The quick tests of this are in agents: test_jobs.py, test_tune.py, test_training_resume.py.
"""

import errno
import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from cluster_work import kept
from episode_runs import assert_identical
from tiny_training import left as left_by_training

from agents import load_policy
from agents.command_line import command_line
from impact_gym.files import writing

COMMANDS = {
    "tune": "tune ../mine.toml --weights 1 2 4 --scenarios 8 --budget 16 --population 8 --out out --jobs out/jobs",
    "train": "train ../mine.toml --seeds 2 --out out/runs --policies out --checkpoint-every 512 --validate-every 1024",
    "report": "report rigid-blind --count 4 --out out/page",
}


def run(name, folder, ready=None, stop=None):
    """Run a command; once `ready()` is true, `stop` its process. Return its exit code and standard error."""
    line = [sys.executable, "-m", "experiments.command", *COMMANDS[name].split(), "--processes", "0"]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    streams = {"text": True, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    process = subprocess.Popen(line, cwd=folder, env=environment, **streams)
    while stop and not ready():
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.005)
    if stop:
        stop(process)
    _, said = process.communicate(timeout=300)
    return process.returncode, said


def saved(folder):
    """Return the stored results and the checkpoints of trainings, each with its time of writing."""
    return kept(folder) | {path: path.stat().st_mtime_ns for path in folder.glob("**/checkpoint.npz")}


def left(folder):
    """Return the results of a command without times: files, tables, answers, trainings."""
    out = folder / "out"
    files = [path for kind in ("*.json", "page/*.parquet") for path in out.glob(kind)]
    content = {path.name: path.read_bytes() for path in files}
    if (results := out / "page" / "results.json").is_file():
        content["answers"] = json.loads(results.read_text())["answers"]
    for path in out.glob("*.npz"):
        content["chosen"] = load_policy(path).seed
        content["runs"] = [left_by_training(run) for run in sorted((out / "runs").glob("seed-*"))]
    assert content
    return content


def test_full_disk_ends_a_command_with_a_line_of_advice():
    said = r"^impact-gym tune: no room to write it: .*; make room: the same command continues$"
    with pytest.raises(SystemExit, match=said), command_line("tune"), writing("it"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def fill_disk(process):
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_stopped_command_continues_and_reaches_the_same_bits(name, mine, tmp_path):
    part, whole = tmp_path / "part", tmp_path / "whole"
    part.mkdir()
    whole.mkdir()
    code, said = run(name, part, lambda: saved(part), fill_disk)
    assert (code, "Traceback" in said) == (1, False)
    assert re.search(rf"^impact-gym {name}: no room to write .*out.*; make room: .*continues.*$", said, re.MULTILINE)
    first = saved(part)
    code, _ = run(name, part, lambda: not saved(part).items() <= first.items(), subprocess.Popen.kill)
    assert code == -signal.SIGKILL
    second = kept(part)
    assert run(name, part)[0] == 0
    assert second.items() <= kept(part).items()  # no stored result is computed again
    assert run(name, whole)[0] == 0
    assert_identical(left(part), left(whole))
