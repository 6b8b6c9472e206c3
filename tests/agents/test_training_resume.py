"""A training that is interrupted ends as one that is not, to the bit."""

import fcntl
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from training import TINY, assert_same, interrupted, rows, tiny

from agents.archive import read_archive
from agents.train import checkpoint
from agents.train.run import resume, train
from agents.train.settings import as_json
from impact_gym.sb3 import ImpactVecEnv


@pytest.mark.storm
def test_an_interrupted_training_ends_as_one_that_is_not(tmp_path):
    settings = tiny()
    whole = train(replace(settings, out=tmp_path / "whole"))
    interrupted(settings, tmp_path / "part", checkpoints=2)
    np.random.seed(7)  # noqa: NPY002 - stable-baselines3 draws from it, and a new process has another state
    assert resume(tmp_path / "part") == tmp_path / "part"
    assert_same(whole, tmp_path / "part")
    steps = [int(float(row["time/total_timesteps"])) for row in rows(whole)]
    assert steps == sorted(set(steps))
    assert steps[-1] == settings.whole_steps


@pytest.mark.storm
def test_a_killed_process_is_gone_on_with(tmp_path):
    """By SIGKILL, at moments of no meaning, three times, until it is done."""
    folder = tmp_path / "killed"
    settings = tiny(steps=6000, checkpoint_every=256)
    whole = train(replace(settings, out=tmp_path / "whole"))
    script = (  # which imports torch once: each line on stdin starts another process
        "import os, sys, json; from pathlib import Path; from dataclasses import replace\n"
        "from agents.train.settings import from_json; from agents.train.run import resume, train\n"
        "folder, settings = Path(sys.argv[1]), from_json(json.loads(sys.argv[2]))\n"
        "for _ in sys.stdin:\n"
        "    if (process := os.fork()) == 0:\n"
        "        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)\n"
        "        resume(folder) if folder.exists() else train(replace(settings, out=folder))\n"
        "        os._exit(0)\n"
        "    print(process, flush=True)\n"
        "    print(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), flush=True)\n"
    )
    command = [sys.executable, "-c", script, str(folder), json.dumps(as_json(settings))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as starter:
        ends = []
        for kill in (True, True, True, False):
            before = _steps_saved(folder)
            print(file=starter.stdin, flush=True)
            process = int(starter.stdout.readline())
            while kill and _steps_saved(folder) <= before:
                assert not (folder / "metrics.json").exists(), "it was done before it could be killed"
                time.sleep(0.01)
            if kill:
                os.kill(process, signal.SIGKILL)
            ends.append(int(starter.stdout.readline()))
        starter.stdin.close()
    assert ends == [-signal.SIGKILL] * 3 + [0]
    assert_same(whole, folder)
    assert not [file.name for file in folder.iterdir() if file.name.startswith(".")]


def _steps_saved(folder):
    """Return after how many steps the checkpoint was written, 0 if there is none; never sees half a file."""
    path = folder / "checkpoint.npz"
    if not path.is_file():
        return 0
    content, _ = read_archive(path, checkpoint.FORMAT)
    return dict(dict(content["state"]["items"])["model"]["items"])["counters"]["items"][0][1]


def test_tensorboard_shows_each_step_once(tmp_path):
    name = "objectives/object_velocity"
    interrupted(tiny(), tmp_path / "run", checkpoints=2)
    resume(tmp_path / "run")
    events = EventAccumulator(str(tmp_path / "run"))
    events.Reload()
    logged = [(event.step, event.value) for event in events.Scalars(name)]
    written = [(int(row["time/total_timesteps"]), float(row[name])) for row in rows(tmp_path / "run") if row[name]]
    assert np.array(logged) == pytest.approx(np.array(written), rel=1e-6)
    steps = [step for step, _ in logged]
    assert steps == sorted(set(steps))


def test_a_finished_run_is_left_alone(tmp_path):
    folder = train(replace(TINY, steps=512, out=tmp_path / "run"))
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert resume(folder) == folder
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


def test_a_damaged_checkpoint_is_refused(tmp_path):
    interrupted(tiny(), tmp_path / "run", checkpoints=1)
    path = tmp_path / "run" / "checkpoint.npz"
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:-1], b"", whole[:5000] + bytes([whole[5000] ^ 1]) + whole[5001:]):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"checkpoint\.npz is no impact_gym checkpoint 1 file, or is damaged"):
            resume(tmp_path / "run")


def test_a_checkpoint_of_another_training_is_refused(tmp_path):
    interrupted(tiny(), tmp_path / "one", checkpoints=1)
    interrupted(tiny(width=24), tmp_path / "other", checkpoints=1)
    (tmp_path / "one" / "checkpoint.npz").replace(tmp_path / "other" / "checkpoint.npz")
    with pytest.raises(ValueError, match="checkpoint of another training"):
        resume(tmp_path / "other")


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(ValueError, match="holds no run"):
        resume(tmp_path)
    record = {"settings": {**as_json(TINY), "gama": 1.0}}
    (tmp_path / "config.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match="gama"):
        resume(tmp_path)


def test_two_processes_do_not_write_one_run(tmp_path):
    interrupted(tiny(), tmp_path / "run", checkpoints=1)
    with (tmp_path / "run" / "lock").open() as lock:  # the kernel asks not who, but which opening of the file
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(ValueError, match="another process"):
            resume(tmp_path / "run")
    resume(tmp_path / "run")


def test_the_state_of_another_batch_is_refused():
    state = ImpactVecEnv(4).get_state()
    for other in (ImpactVecEnv(5), ImpactVecEnv(4, range_noise=0.01)):
        with pytest.raises(ValueError, match="of another batch"):
            other.set_state(state)
