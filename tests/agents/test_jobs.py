"""Jobs on this machine: each done once, kept, and done again only where its result is missing or damaged."""

import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from cluster_work import calls
from training import tiny

from agents import train_seeds
from agents.evaluate.play import play
from agents.jobs import Failure, Job, JobsFailedError, gather, gather_all
from agents.jobs.store import NAME, Store
from agents.policies.networks import to_arrays
from agents.policies.policy import load_policy
from agents.train.settings import as_json

HERE = Path(__file__).parents[1] / "helpers"


@pytest.fixture
def log(tmp_path):
    """Where each job that is begun leaves a line."""
    return tmp_path / "log"


def listed(log, count=6, **more):
    return [Job("cluster_work:numbers", {"log": str(log), "number": number, **more}) for number in range(count)]


def same(one, other):
    return one.keys() == other.keys() and all(
        one[name].dtype == other[name].dtype and one[name].tobytes() == other[name].tobytes() for name in one
    )


@pytest.mark.parametrize("processes", [0, 1, 2])
def test_each_job_is_done_once_with_the_same_result_whatever_the_order(log, tmp_path, processes):
    jobs = listed(log)
    backwards = gather_all(jobs[::-1], tmp_path / "results", processes=processes)
    assert sorted(calls(log)) == list(range(6))
    for number, result in enumerate(backwards[::-1]):
        drawn = np.random.default_rng(number).standard_normal((64, 64))
        assert int(result["number"]) == number
        np.testing.assert_allclose(result["product"], drawn @ drawn.T, rtol=1e-12, atol=1e-12)
    again = gather_all(jobs, tmp_path / "results", processes=processes)
    assert len(calls(log)) == 6
    assert all(same(*pair) for pair in zip(again, backwards[::-1], strict=True))


def slice_of(first, count):
    return {"set": "validation", "first": first, "count": count}


def test_results_are_equal_to_the_bit_for_any_number_of_processes(tmp_path):
    policy = {"shipped": "linear-blind"}
    jobs = [
        Job("agents.evaluate.play:play", {"controller": policy, "scenarios": slice_of(first, 10)})
        for first in range(0, 50, 10)
    ]
    whole = play(policy, slice_of(0, 50))
    for count in (0, 1, 2):
        parts = gather_all(jobs, tmp_path / str(count), processes=count)
        assert same(whole, {name: np.concatenate([part[name] for part in parts], axis=-1) for name in whole})


def test_jobs_with_the_same_key_are_done_once_and_come_in_every_place(log, tmp_path):
    jobs = listed(log, 2) + listed(log, 3)
    came = dict(gather(jobs, tmp_path / "results", processes=0))
    assert sorted(calls(log)) == [0, 1, 2]
    assert [int(came[place]["number"]) for place in range(5)] == [0, 1, 0, 1, 2]


def change(path, statement, *values):
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(statement, values)


@pytest.mark.parametrize("damage", [
    "UPDATE results SET answer = substr(answer, 1, length(answer) - 40) WHERE key = ?1",
    "UPDATE results SET answer = x'' WHERE key = ?1",
    "UPDATE results SET answer = (SELECT answer FROM results WHERE key = ?2) WHERE key = ?1",
])  # fmt: skip
def test_a_damaged_result_is_computed_anew(log, tmp_path, capsys, damage):
    folder, jobs = tmp_path / "results", listed(log, 3)
    before = gather_all(jobs, folder, processes=0)
    change(folder / NAME, damage, jobs[1].key, *([jobs[2].key] if "?2" in damage else []))
    after = gather_all(jobs, folder, processes=0)
    assert calls(log) == [0, 1, 2, 1]
    assert all(same(*pair) for pair in zip(before, after, strict=True))
    assert f"computed anew: {jobs[1].key}" in capsys.readouterr().out


@pytest.mark.parametrize("damage", [
    lambda content: b"no database" + content[11:],
    lambda content: content[:100] + bytes(len(content) - 100),
])  # fmt: skip
def test_where_the_file_of_results_is_damaged_all_are_computed_anew_and_it_is_put_aside(tmp_path, capsys, damage):
    log, folder = tmp_path / "log", tmp_path / "results"
    before = gather_all(listed(log, 3), folder, processes=0)
    damaged = damage((folder / NAME).read_bytes())
    (folder / NAME).write_bytes(damaged)
    for _ in range(2):
        after = gather_all(listed(log, 3), folder, processes=0)
        assert calls(log) == [0, 1, 2, 0, 1, 2]
        assert all(same(*pair) for pair in zip(before, after, strict=True))
    assert "is damaged" in capsys.readouterr().out
    assert (folder / f"{NAME}.damaged").read_bytes() == damaged


def test_two_gatherings_may_share_a_folder_and_use_what_is_there(tmp_path):
    log, folder = tmp_path / "log", tmp_path / "results"
    one, other = gather(listed(log, 3), folder, processes=0), gather(listed(log, 6)[::-1], folder, processes=0)
    first = [next(one), next(other)]  # 0; and 5, once it is seen that 1 and 2 are still to do
    came = [*first, *one, *other]
    assert sorted(int(result["number"]) for _, result in came) == [0, 0, 1, 1, 2, 2, 3, 4, 5]
    assert len(calls(log)) == len({*calls(log)}) + 2
    assert kept(folder) == 6


@pytest.mark.parametrize("processes", [0, 2])
def test_failed_jobs_are_named_when_all_others_are_done(log, tmp_path, processes):
    came = []
    jobs = [Job("cluster_work:fails_on", {"log": str(log), "number": number, "bad": [1, 3]}) for number in range(6)]
    jobs.append(Job("cluster_work:no_arrays", {}))
    with pytest.raises(JobsFailedError) as raised:
        came.extend(int(result["number"]) for _, result in gather(jobs, tmp_path / "results", processes=processes))
    assert sorted(came) == sorted(calls(log)) == [0, 2, 4, 5]
    assert len(raised.value.failed) == 3
    said = str(raised.value)
    assert "3 of 7 jobs failed" in said
    for number in (1, 3):
        assert re.search(rf"fails_on\(.*number={number}, .*\): ArithmeticError: no result for {number}", said)
    assert "no_arrays(): TypeError: 'value' of a result must be an array" in said
    assert "in fails_on" in said  # where the first one raised


def test_a_job_whose_process_is_killed_is_done_again(log, tmp_path):
    jobs = [Job("cluster_work:kills_itself", {"log": str(log), "number": 100, "times": 2}), *listed(log, 4)]
    results = gather_all(jobs, tmp_path / "results", processes=2, retries=2)
    assert [int(result["number"]) for result in results] == [100, 0, 1, 2, 3]
    assert sorted(calls(log)) == [0, 1, 2, 3, 100, 100, 100]


def test_a_job_that_kills_every_process_is_named_and_spoils_no_other(log, tmp_path):
    jobs = [Job("cluster_work:kills_itself", {"log": str(log), "number": 100, "times": 99}), *listed(log, 4)]
    with pytest.raises(JobsFailedError, match=r"1 of 5 jobs failed(.|\n)*kills_itself.*worker was lost 2 time"):
        gather_all(jobs, tmp_path / "results", processes=2, retries=1)
    assert sorted(calls(log)) == [0, 1, 2, 3, 100, 100]


def test_a_job_that_hangs_is_ended_named_and_not_begun_again_and_the_others_go_on(tmp_path):
    log, folder = tmp_path / "log", tmp_path / "results"
    hang = Job("cluster_work:numbers", {"log": str(log), "number": 100, "seconds": 600.0})
    dying = Job("cluster_work:kills_itself", {"log": str(log), "number": 200, "times": 1})
    jobs = [hang, *listed(log, 4), dying, *listed(log, 3, seconds=0.2)]
    came, begun = [], time.monotonic()
    with pytest.raises(JobsFailedError, match=r"1 of 9 jobs failed(.|\n)*number=100.*: no answer within 1\.5 s"):
        came.extend(place for place, _ in gather(jobs, folder, processes=2, seconds=1.5))
    assert time.monotonic() - begun < 60.0
    assert sorted(came) == list(range(1, 9))
    assert sorted(calls(log)) == [0, 0, 1, 1, 2, 2, 3, 100, 200, 200]


def test_the_time_that_a_process_takes_to_begin_and_to_import_the_function_is_not_that_of_its_job(tmp_path):
    (result,) = gather_all([Job("slow_to_load:at_once", {})], tmp_path, processes=1, seconds=0.5)
    assert result["value"] == 1.0


def test_failures_are_values_that_are_kept_where_they_are_asked_for(tmp_path):
    log, folder = tmp_path / "log", tmp_path / "results"
    jobs = [
        Job("cluster_work:fails_on", {"log": str(log), "number": 1, "bad": [1]}),
        Job("cluster_work:kills_itself", {"log": str(log), "number": 2, "times": 99}),
        Job("cluster_work:numbers", {"log": str(log), "number": 3, "seconds": 600.0}),
        *listed(log, 1),
    ]
    found = gather_all(jobs, folder, processes=2, retries=0, seconds=1.0, failures=True)
    assert [type(one) for one in found] == [Failure, Failure, Failure, dict]
    raised, lost, late = (one.reason for one in found[:3])
    assert raised == "ArithmeticError: no result for 1"
    assert "worker was lost 1 time" in lost
    assert late == "no answer within 1 s"
    assert "in fails_on" in found[0].trace
    before = calls(log)
    again = gather_all(jobs, folder, processes=2, failures=True)
    assert again[:3] == found[:3]
    assert calls(log) == before
    with pytest.raises(JobsFailedError, match="ArithmeticError"):  # whoever wants results tries once more
        gather_all(jobs[:1], folder, processes=0)


def driver(tmp_path, log):
    script = tmp_path / "driver.py"
    script.write_text(
        "import sys\n"
        f"sys.path[:0] = {[str(HERE), str(HERE.parents[1])]!r}\n"  # what is tested, not what is installed
        "from agents.jobs import Job, gather_all\n"
        "if __name__ == '__main__':\n"
        f"    jobs = [Job('cluster_work:numbers', dict(log={str(log)!r}, number=n, seconds=0.2)) for n in range(12)]\n"
        f"    gather_all(jobs, {str(tmp_path / 'results')!r}, processes=2)\n"
    )
    return [sys.executable, str(script)]


def descendants(pid):
    """Return the processes below one, as the kernel lists them."""
    below = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(one) for one in below] + [deeper for one in below for deeper in descendants(int(one))]


def kept(folder):
    with closing(Store(folder)) as store:
        return len(store)


@pytest.mark.storm
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="reads the list of processes where Linux keeps it")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_what_a_killed_gathering_had_is_kept_and_no_process_is_left(log, tmp_path, how):
    results = tmp_path / "results"
    with subprocess.Popen(driver(tmp_path, log), cwd=HERE.parents[1], stderr=subprocess.PIPE) as running:
        while kept(results) < 3:
            assert running.poll() is None, running.stderr.read()
            time.sleep(0.02)
        below = descendants(running.pid)
        running.send_signal(how)
        running.wait(20)
    assert len(below) >= 2
    deadline = time.monotonic() + 10
    while any(alive(pid) for pid in below):
        assert time.monotonic() < deadline, "a worker outlived the gathering process"
        time.sleep(0.05)
    before, begun = kept(results), len(calls(log))
    assert 3 <= before < 12
    subprocess.run(driver(tmp_path, log), cwd=HERE.parents[1], check=True, stderr=subprocess.DEVNULL)
    assert len(calls(log)) - begun == 12 - before
    assert set(calls(log)) == set(range(12))
    assert kept(results) == 12


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_workers_have_one_thread_each_and_this_process_keeps_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    (result,) = gather_all([Job("cluster_work:threads", {})], tmp_path, processes=1)
    assert result["threads"].tolist() == ["1", "1", "1", "1"]
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ


@pytest.mark.parametrize(("options", "said"), [
    ({"processes": -1}, "processes must be a whole number of at least 0, got -1"),
    ({"retries": -1}, "retries must be a whole number of at least 0, got -1"),
    ({"processes": 2, "cluster": "ray"}, "processes or cluster, not both"),
    ({"seconds": 1.0, "cluster": "ray"}, "seconds or cluster, not both"),
    ({"seconds": 0.0}, "seconds must be finite and above 0 s"),
])  # fmt: skip
def test_wrong_options_of_gathering_are_refused_at_once(tmp_path, options, said):
    with pytest.raises(ValueError, match=said):
        gather([], tmp_path, **options)
    with pytest.raises(TypeError, match=r"jobs\[0\] must be a Job"):
        gather(["cluster_work:numbers"], tmp_path)


def test_a_training_is_a_job_that_needs_no_common_folder(tmp_path):
    """A run folder that cannot be made, as on a node without a common one, gives what one does that can."""
    settings = json.loads(json.dumps(as_json(tiny(steps=512))))
    (tmp_path / "file").touch()
    elsewhere = train_seeds.train_one(settings, str(tmp_path / "file" / "linear-blind" / "seed-0"))
    here = train_seeds.train_one(settings, str(tmp_path / "linear-blind" / "seed-0"))
    assert here["best"].tobytes() == (tmp_path / "linear-blind" / "seed-0" / "best.npz").read_bytes()
    policies = []
    for result in (here, elsewhere):
        (tmp_path / "policy.npz").write_bytes(result["best"].tobytes())
        policies.append(to_arrays(load_policy(tmp_path / "policy.npz").network))
    assert same(*policies)
