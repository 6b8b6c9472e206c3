"""Calls run once and are stored; they run again only if their result is missing or damaged."""

import errno
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from cluster_work import calls, ends_badly, numbers, played
from episode_runs import assert_identical

from agents import jobs
from agents.jobs import Call, JobsFailedError, cached
from impact_gym.support.command_line import command_line
from impact_gym.support.files import UNFINISHED, DiskFullError

ROOT = Path(__file__).parents[2]


@pytest.fixture
def log(tmp_path):
    return tmp_path / "log"


def listed(log, count=6, **more):
    return [{"log": str(log), "number": number, **more} for number in range(count)]


DRIVER = """
import signal, cluster_work
from agents.jobs import cached
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background process would ignore it
cached(cluster_work.numbers, {given!r}, "results", processes=2)
"""
ON_RAY = """
from ray.cluster_utils import Cluster
import cluster_work
from agents.jobs import cached
cluster = Cluster(initialize_head=True, head_node_args={{"num_cpus": 2, "include_dashboard": False}})
try:
    cached(cluster_work.played, {given!r}, "results", cluster=cluster.address)
finally:
    cluster.shutdown()
"""
SOURCES = {"PYTHONPATH": os.pathsep.join(map(str, (ROOT / "tests" / "helpers", ROOT)))}  # instead of installed ones


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_killed_command_leaves_no_process(log, tmp_path, how):
    """Every process holds the pipe."""
    line = [sys.executable, "-c", DRIVER.format(given=listed(log, 4, seconds=600.0))]
    with subprocess.Popen(line, cwd=tmp_path, env=os.environ | SOURCES, stdout=subprocess.PIPE) as run:
        while len(calls(log)) < 2:
            assert run.poll() is None, "the command ended too soon"
            time.sleep(0.02)
        run.send_signal(how)
        run.wait(60)
        run.communicate(timeout=60)  # until the last process has closed it


def test_failed_late_and_killed_calls_are_named_and_stored(log, tmp_path):
    """If there is a replacement, else they run again. All others are stored."""
    how = ["", "fails", "killed", "late", ""]
    given = [{"log": str(log), "number": number, "how": each} for number, each in enumerate(how)]

    for _ in range(2):  # the second time no call starts
        first, *bad, last = cached(ends_badly, given, tmp_path, processes=2, seconds=3.0, failed=lambda *bad: bad)
        assert (first["number"], last["number"]) == (0, 4)
        assert [arguments["number"] for arguments, _ in bad] == [1, 2, 3]
        reasons = "no result for 1", "lost, with exit code -9 (out of memory?)", "no answer within 3 s"
        assert all(part in reason for part, (_, reason) in zip(reasons, bad, strict=True))
        assert sorted(calls(log)) == [0, 2, 3, 4]
    with pytest.raises(JobsFailedError) as raised:
        cached(ends_badly, given[:2] + listed(log, 9, how="fails")[2:], tmp_path, processes=0)
    assert len([*tmp_path.glob("*.pkl")]) == 5
    raised.match("8 of 9 jobs failed")
    raised.match(r'ends_badly {.*"number": 8}: ArithmeticError: no result for 8')
    raised.match("the first of these raised:\nTraceback(.|\n)*in ends_badly")
    without_folder = listed(tmp_path / "later" / "log", 1)
    assert cached(numbers, without_folder, tmp_path, processes=0, failed=lambda *_: "bad") == ["bad"]
    (tmp_path / "later").mkdir()
    assert cached(numbers, without_folder, tmp_path, processes=0)[0]["number"] == 0


def test_folder_that_cannot_be_written_starts_no_call(log):
    log.touch()
    with pytest.raises(OSError, match=re.escape(f"{log}")):
        cached(numbers, listed(log, 1), log / "results", processes=0)
    assert not calls(log)


@pytest.mark.slow
def test_ray_results_equal_local_ones_to_the_bit(log, tmp_path):
    """Ray prints much, and its warnings would fail the test: a script runs the calls, and stores their results."""
    pytest.importorskip("ray", reason="the extra `cluster` is not installed")
    of_another_cluster = ("RAY_ADDRESS", "RAY_RUNTIME_ENV_HOOK")
    environment = {name: value for name, value in os.environ.items() if name not in of_another_cluster} | SOURCES
    environment |= {"RAY_USAGE_STATS_ENABLED": "0", "PYTHONWARNINGS": "default"}
    command = [sys.executable, "-c", ON_RAY.format(given=listed(log))]
    with (tmp_path / "printed").open("w") as printed:
        subprocess.run(command, check=True, cwd=tmp_path, env=environment, timeout=300, stdout=printed, stderr=printed)
    stored = cached(played, listed(log), tmp_path / "results", processes=0)
    assert sorted(calls(log)) == [*range(6)]  # only on the cluster
    computed = cached(played, listed(log), tmp_path / "here", processes=0)
    assert not {each.pop("where") for each in stored} & {each.pop("where") for each in computed}  # kernels were sent
    assert_identical(stored, computed)


def test_node_with_other_versions_runs_no_call(log):
    call = Call("cluster_work:numbers", json.dumps(listed(log)[0]), "")
    assert b"install the same" in jobs.perform(call, {"numpy": "0.1"})
    assert calls(log) == []
    assert b"install the same" not in jobs.perform(call, {"numpy": np.__version__})


def test_results_have_the_same_bits_in_any_order_and_process(log, tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    here = cached(numbers, listed(log), tmp_path / "here", processes=0)
    assert calls(log) == list(range(6))
    assert {result.pop("threads")[0] for result in here} == {"7"}
    backwards = cached(numbers, listed(log)[::-1], tmp_path / "results", processes=2)
    assert sorted(calls(log)) == sorted([*range(6), *range(6)])
    for each in backwards:
        assert each.pop("threads") == ["1", "1", "1", "1"]
    assert_identical(here, backwards[::-1])
    assert (os.environ["OMP_NUM_THREADS"], "MKL_NUM_THREADS" in os.environ) == ("7", False)  # of this process


def test_equal_calls_run_once_and_each_gets_its_own_copy(log, tmp_path):
    cached(numbers, listed(log, 2)[1:], tmp_path, processes=0)
    seen, given = [], listed(log, 2) + listed(log, 3)
    results = cached(numbers, given, tmp_path, processes=0, done=lambda place, _: seen.append(place))
    assert calls(log) == [1, 0, 2]
    assert [result["number"] for result in results] == [0, 1, 0, 1, 2]
    assert results[0] is not results[2]
    assert seen == [1, 3, 0, 2, 4]  # stored results come first


def test_damaged_result_is_computed_again(log, tmp_path, capsys):
    """If it is cut, empty, or has a changed bit."""
    folder, given = tmp_path / "results", listed(log, 3)
    before = cached(numbers, given, folder, processes=0)
    path = min(folder.iterdir())
    whole = path.read_bytes()
    for count, damaged in enumerate((whole[:-40], b"", whole[:-50] + bytes([whole[-50] ^ 1]) + whole[-49:]), start=4):
        path.write_bytes(damaged)
        for _ in range(2):
            assert_identical(before, cached(numbers, given, folder, processes=0))
            assert len(calls(log)) == count
        said = capsys.readouterr().err
        assert re.search(rf'computed anew: .*"number": {calls(log)[-1]}}} in .* is damaged', said)


def test_full_disk_ends_the_command_and_keeps_whole_results(log, tmp_path, monkeypatch):
    """If a call finds the disk full, or if there is no room for a result: then no part of it is taken for a result."""
    cached(numbers, listed(log, 1), tmp_path, processes=0)
    said = r"no room to write .*log: No space left on device; make room: the same command"
    with pytest.raises(SystemExit, match=said), command_line("tune"):
        cached(ends_badly, listed(log, 1, how="no room"), tmp_path, processes=0, failed=lambda *_: None)
    monkeypatch.setattr(os, "fsync", mock.Mock(side_effect=OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
    with pytest.raises(DiskFullError, match=r"no room to write .*pkl: No space left on device"):
        cached(numbers, listed(log), tmp_path, processes=0)
    assert {path.suffix for path in tmp_path.iterdir()} == {".pkl", ""}  # and the log: nothing unfinished
    assert len([*tmp_path.glob("*.pkl")]) == 1


def test_parts_that_killed_processes_left_are_removed(log, tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    left, others = (tmp_path / f".a.pkl.{number}{UNFINISHED}" for number in (ended.pid, os.getppid()))
    left.touch()
    others.touch()  # under way
    cached(numbers, listed(log, 1), tmp_path, processes=0)
    assert (left.exists(), others.exists()) == (False, True)


def test_key_of_a_result_has_function_arguments_and_depends(log, tmp_path):
    given = {"log": str(log), "number": 1}
    different = [(ends_badly, given, ""), (numbers, given, ""), (numbers, given | {"number": 3}, "")]
    different.append((numbers, given, "x"))
    for count, (function, arguments, depends) in enumerate(different, start=1):
        for each in (arguments, dict(reversed(arguments.items()))):
            cached(function, [each], tmp_path / "results", depends=depends, processes=0)
            assert len(calls(log)) == count
