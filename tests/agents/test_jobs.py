"""Jobs on every engine: each done once, kept, and done again only where its result is missing or damaged."""

import fcntl
import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import zipfile
from contextlib import closing
from functools import partial
from pathlib import Path

import job_cases
import numpy as np
import pytest
from cluster_work import begun, calls
from episodes import assert_identical

from agents.jobs import Job, JobsFailedError, digest_of, gather, gather_all, ray_cluster, sources
from agents.jobs.store import NAME, Store

ROOT = Path(__file__).parents[2]
HELPERS = ROOT / "tests" / "helpers"
LOCAL = {"processes": 2}


@pytest.fixture
def log(tmp_path):
    """Where each job that is begun leaves a line."""
    return tmp_path / "log"


def listed(log, count=6, **more):
    return [Job("cluster_work:numbers", {"log": str(log), "number": number, **more}) for number in range(count)]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """The folder that job_cases.py fills on a Ray cluster, once for all workers of pytest-xdist."""
    pytest.importorskip("ray", reason="the extra `cluster` is not installed")
    root = tmp_path_factory.getbasetemp()
    root = root.parent if "PYTEST_XDIST_WORKER" in os.environ else root
    folder = root / "cluster"
    with (root / "cluster.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / job_cases.LAST).exists():
            folder.mkdir()
            of_another_cluster = ("RAY_ADDRESS", "RAY_RUNTIME_ENV_HOOK")
            environment = {name: value for name, value in os.environ.items() if name not in of_another_cluster}
            path = os.pathsep.join(map(str, (HELPERS, ROOT)))  # these sources, whatever is installed
            environment |= {"RAY_USAGE_STATS_ENABLED": "0", "PYTHONPATH": path, "PYTHONWARNINGS": "default"}
            command = [sys.executable, HELPERS / "job_cases.py", folder]
            with (folder / "printed").open("w") as printed:
                streams = {"stdout": printed, "stderr": printed}
                ended = subprocess.run(command, check=False, cwd=ROOT, env=environment, timeout=300, **streams)
            assert ended.returncode == 0, (folder / "printed").read_text()[-4000:]
    return folder


@pytest.fixture(params=["local", pytest.param("ray", marks=pytest.mark.storm)])
def outcome(request, tmp_path):
    """Return what a case of job_cases.py returns on an engine, and the folder that it filled."""

    def of(name, case):
        if request.param == "local":
            return case(tmp_path, **LOCAL), tmp_path
        folder = request.getfixturevalue("cluster")
        return json.loads((folder / f"{name}.json").read_text()), folder / name

    return of


@pytest.mark.storm
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="reads the list of processes where Linux keeps it")
def test_gather_that_was_killed_computes_only_what_is_missing_and_leaves_no_process(outcome):
    ways = [signal.SIGINT, signal.SIGKILL]
    runs, folder = outcome("killed", partial(job_cases.killed_and_resumed, ways=ways))
    kept = [*range(2, 1 + len(runs)), job_cases.JOBS]
    assert [run["kept"] for run in runs] == kept
    assert [run["found"] for run in runs] == [0, *kept[:-1]]
    assert sorted(calls(folder / "log")) == [*range(job_cases.JOBS)]
    assert not any(run["left"] for run in runs)


def test_gather_does_jobs_of_lost_workers_again_and_names_failed_ones_when_all_others_are_done(outcome):
    case, _ = outcome("bad", job_cases.lost_and_failed)
    assert case["gathered"] == [0, 4, 5, 6]
    assert case["calls"] == [0, 1, 2, 100, 100, 200, 200]
    for pattern in (
        "3 of 7 jobs failed",
        r"fails_on\(.*number=300, .*\): ArithmeticError: no result for 300",
        r"number=200, times=99\): its worker was lost 2 time\(s\)",
        r"no_arrays\(\): TypeError: 'value' of a result must be an array",
        "the first of these raised:\nTraceback",
    ):
        assert re.search(pattern, case["message"])


@pytest.mark.storm
def test_ray_results_come_once_and_equal_local_ones_to_the_bit_though_a_node_was_killed(cluster, tmp_path):
    folder = cluster / "node"
    jobs, outcome = job_cases.slices(folder), json.loads((cluster / "node.json").read_text())
    assert sorted(outcome["gathered"]) == list(range(len(jobs)))
    store = Store(folder / "results")
    assert len(store) == len({job.key for job in jobs}) == len(jobs)
    for job, here in zip(jobs, gather_all(job_cases.slices(tmp_path), tmp_path / "here", processes=0), strict=False):
        there = store.read(job.key)
        assert str(here.pop("where")) == str(HELPERS / "cluster_work.py")
        assert Path(str(there.pop("where"))) != HELPERS / "cluster_work.py"  # the sources that were sent
    numbers = [number for number, _ in begun(folder / "log")]
    assert len(outcome["begun there"]) >= 3
    assert any(numbers.count(number) > 1 for number in outcome["unfetched"])  # done there, and again elsewhere
    before = len(numbers)
    again = [place for place, _ in gather(jobs, folder / "results", processes=0)]  # needs no cluster any more
    assert (sorted(again), len(begun(folder / "log"))) == (list(range(36)), before)


@pytest.mark.storm
def test_ray_names_the_remedy_where_no_cluster_is(cluster):
    assert "ray start --head" in json.loads((cluster / "none.json").read_text())


def test_ray_names_the_extra_where_it_is_missing(tmp_path, monkeypatch, log):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(RuntimeError, match="install the extra `cluster`"):
        gather_all(listed(log, 1), tmp_path / "results", cluster="ray")


def test_ray_refuses_a_node_with_other_libraries():
    versions = ray_cluster._versions()
    job = "cluster_work:no_arrays", {}
    assert "install the same" not in ray_cluster._perform_alike(*job, versions).reason
    assert "install the same" in ray_cluster._perform_alike(*job, versions | {"numpy": "0.1"}).reason


def test_stage_sends_what_the_jobs_import_and_the_compiled_kernels_and_the_same_zip_for_the_same(tmp_path):
    first, again = (sources.stage({"cluster_work:played"}, tmp_path / name, ("agents", "impact_gym", "json"))
                    for name in ("first.zip", "again.zip"))  # fmt: skip
    assert first.read_bytes() == again.read_bytes()
    with zipfile.ZipFile(first) as archive:
        names = archive.namelist()
    assert {"cluster_work.py", "agents/jobs/job.py", "impact_gym/task/sets/validation.csv"} <= set(names)
    assert any(name.startswith("impact_gym/kernels.") and name.endswith(".so") for name in names)
    assert "test_jobs.py" not in names
    assert not any(name.startswith(("runs", "reports", "numpy", "json")) for name in names)  # the nodes have these


def test_gather_does_each_job_once_with_the_same_bits_whatever_the_order_and_the_engine(log, tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    here = gather_all(listed(log), tmp_path / "here", processes=0)
    assert calls(log) == list(range(6))
    for number, result in enumerate(here):
        drawn = np.random.default_rng(number).standard_normal((64, 64))
        np.testing.assert_allclose(result["product"], drawn @ drawn.T, rtol=1e-12, atol=1e-12)
    threads = Job("cluster_work:threads", {})
    *backwards, of_worker = gather_all([*listed(log)[::-1], threads], tmp_path / "results", **LOCAL)
    again = gather_all(listed(log), tmp_path / "results", **LOCAL)
    assert sorted(calls(log)) == sorted([*range(6), *range(6)])
    assert_identical(here, backwards[::-1])
    assert_identical(here, again)
    assert of_worker["threads"].tolist() == ["1", "1", "1", "1"]
    assert (os.environ["OMP_NUM_THREADS"], "MKL_NUM_THREADS" in os.environ) == ("7", False)  # this process's own


def test_gather_does_jobs_with_the_same_key_once_and_yields_them_in_every_place(log, tmp_path):
    answers = gather_all(listed(log, 2) + listed(log, 3), tmp_path, processes=0)
    assert calls(log) == [0, 1, 2]
    assert [int(answer["number"]) for answer in answers] == [0, 1, 0, 1, 2]


@pytest.mark.parametrize("damage", [
    "UPDATE results SET answer = substr(answer, 1, length(answer) - 40) WHERE key = ?1",
    "UPDATE results SET answer = x'' WHERE key = ?1",
    "UPDATE results SET answer = (SELECT answer FROM results WHERE key = ?2) WHERE key = ?1",
])  # fmt: skip
def test_gather_computes_a_damaged_result_anew(log, tmp_path, capsys, damage):
    folder, jobs = tmp_path / "results", listed(log, 3)
    before = gather_all(jobs, folder, processes=0)
    with closing(sqlite3.connect(folder / NAME)) as database, database:
        database.execute(damage, (jobs[1].key, *([jobs[2].key] if "?2" in damage else [])))
    after = gather_all(jobs, folder, processes=0)
    assert calls(log) == [0, 1, 2, 1]
    assert_identical(before, after)
    assert f"computed anew: {jobs[1].key}" in capsys.readouterr().out


@pytest.mark.parametrize("damage", [
    lambda content: b"no database" + content[11:],
    lambda content: content[:100] + bytes(len(content) - 100),
])  # fmt: skip
def test_gather_puts_a_damaged_file_of_results_aside_and_computes_all_anew(log, tmp_path, capsys, damage):
    folder = tmp_path / "results"
    before = gather_all(listed(log, 3), folder, processes=0)
    damaged = damage((folder / NAME).read_bytes())
    (folder / NAME).write_bytes(damaged)
    for _ in range(2):
        after = gather_all(listed(log, 3), folder, processes=0)
        assert calls(log) == [0, 1, 2, 0, 1, 2]
        assert_identical(before, after)
    assert "is damaged" in capsys.readouterr().out
    assert (folder / f"{NAME}.damaged").read_bytes() == damaged


def test_two_gatherings_may_share_a_folder(log, tmp_path):
    folder = tmp_path / "results"
    upwards, downwards = gather(listed(log, 3), folder, processes=0), gather(listed(log, 6)[::-1], folder, processes=0)
    first = [next(upwards), next(downwards)]  # 0; and 5, once it is seen that 1 and 2 are still to do
    assert sorted(int(result["number"]) for _, result in [*first, *upwards, *downwards]) == [0, 0, 1, 1, 2, 2, 3, 4, 5]
    assert len(calls(log)) == len({*calls(log)}) + 2
    assert job_cases.kept(tmp_path) == 6


def test_gather_ends_a_job_that_hangs_counts_no_start_and_keeps_failures_where_they_are_asked_for(log, tmp_path):
    jobs = [
        Job("cluster_work:fails_on", {"log": str(log), "number": 1, "bad": [1]}),
        Job("cluster_work:numbers", {"log": str(log), "number": 3, "seconds": 600.0}),
        Job("slow_to_load:at_once", {}),  # which takes longer to import than a job may take
    ]
    for _ in range(2):  # the second time nothing is begun
        raised, late, done = gather_all(jobs, tmp_path, seconds=0.7, failures=True, **LOCAL)
        assert (raised.reason, late.reason) == ("ArithmeticError: no result for 1", "no answer within 0.7 s")
        assert "in fails_on" in raised.trace
        assert int(done["value"]) == 1
        assert calls(log) == [3]
    with pytest.raises(JobsFailedError, match="ArithmeticError"):  # whoever wants results tries once more
        gather_all(jobs[:1], tmp_path, processes=0)


@pytest.mark.parametrize(("options", "message"), [
    ({"processes": -1}, "processes must be a whole number of at least 0, got -1"),
    ({"processes": 2, "cluster": "ray"}, "processes or cluster, not both"),
    ({"seconds": 0.0}, "seconds must be finite and above 0 s"),
])  # fmt: skip
def test_gather_refuses_wrong_options_and_jobs_at_once(tmp_path, options, message):
    with pytest.raises(ValueError, match=message):
        gather([], tmp_path, **options)
    with pytest.raises(TypeError, match=r"jobs\[0\] must be a Job"):
        gather(["cluster_work:numbers"], tmp_path)


def test_job_key_is_that_of_all_that_determines_the_result():
    given = {"log": "x", "number": 1, "bad": [1]}
    job, numbers = Job("cluster_work:fails_on", given), {"log": "x", "number": 1}
    others = [Job("cluster_work:numbers", numbers), Job("cluster_work:numbers", numbers | {"number": 2})]
    others.append(Job("cluster_work:numbers", numbers, depends=digest_of("impact_gym.files")))
    assert len({each.key for each in (job, *others)}) == 4
    assert Job("cluster_work:fails_on", dict(reversed(given.items()))).key == job.key
    key = job.key
    given["bad"].append(2)
    assert job.key == key


def test_digest_changes_with_any_source_of_the_module(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    inner = tmp_path / "package_of_jobs" / "inner"
    inner.mkdir(parents=True)
    (inner.parent / "__init__.py").touch()
    (inner / "__init__.py").write_text("ONE = 1\n")
    before = digest_of("package_of_jobs"), digest_of("package_of_jobs.inner")
    assert digest_of("package_of_jobs") == before[0]
    (inner / "data.json").write_text("{}")
    assert digest_of("package_of_jobs") != before[0]
    assert digest_of("package_of_jobs.inner") != before[1]
    with pytest.raises(ValueError, match="no module 'not_there'"):
        digest_of("not_there")


@pytest.mark.parametrize(("function", "arguments", "kind", "message"), [
    ("cluster_work", {}, ValueError, "'module:name'"),
    (7, {}, TypeError, "'module:name'"),
    ("not_there:play", {}, ValueError, "not importable"),
    ("cluster_work:not_there", {}, ValueError, "not importable"),
    ("cluster_work:__doc__", {}, ValueError, "no function"),
    ("__main__:play", {}, ValueError, "put it into a module"),
    ("cluster_work:numbers", [], TypeError, "must be a mapping"),
    ("cluster_work:numbers", {"log": "x"}, TypeError, "missing a required argument: 'number'"),
    ("cluster_work:numbers", {"log": "x", "number": float("nan")}, ValueError, "finite"),
    ("cluster_work:numbers", {"log": "x", "number": (1, 2)}, TypeError, "what JSON holds"),
    ("cluster_work:numbers", {"log": "x", "number": {1: 2}}, TypeError, "what JSON holds"),
    ("cluster_work:numbers", {"log": "x", "number": np.array([1.0])}, TypeError, "what JSON holds"),
])  # fmt: skip
def test_job_refuses_what_is_none_with_the_reason(function, arguments, kind, message):
    with pytest.raises(kind, match=re.escape(message)):
        Job(function, arguments)
