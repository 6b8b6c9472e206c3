"""Calls are done once, stored, and done again only where their result is missing or damaged."""

import fcntl
import json
import os
import re
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import cluster_work
import job_cases
import numpy as np
import pytest
import slow_to_load
from cluster_work import begun, calls, fails_on, numbers
from episodes import assert_identical

from agents import jobs
from agents.jobs import Call, JobsFailedError, cached, digest_of
from agents.progress import progress
from impact_gym.files import DiskFullError

ROOT = Path(__file__).parents[2]
HELPERS = ROOT / "tests" / "helpers"
LOCAL = {"processes": 2}


@pytest.fixture
def log(tmp_path):
    """Where each call that is begun leaves a line."""
    return tmp_path / "log"


def listed(log, count=6, **more):
    return [{"log": str(log), "number": number, **more} for number in range(count)]


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
            folder.mkdir()  # where the script runs: Ray's workers here look first where it does
            of_another_cluster = ("RAY_ADDRESS", "RAY_RUNTIME_ENV_HOOK")
            environment = {name: value for name, value in os.environ.items() if name not in of_another_cluster}
            path = os.pathsep.join(map(str, (HELPERS, ROOT)))  # these sources, whatever is installed
            environment |= {"RAY_USAGE_STATS_ENABLED": "0", "PYTHONPATH": path, "PYTHONWARNINGS": "default"}
            command = [sys.executable, "-m", "job_cases", folder]
            with (folder / "printed").open("w") as printed:
                streams = {"stdout": printed, "stderr": printed}
                ended = subprocess.run(command, check=False, cwd=folder, env=environment, timeout=300, **streams)
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
def test_killed_command_computes_only_what_is_missing_and_leaves_no_process(outcome):
    runs, folder = outcome("killed", partial(job_cases.killed_and_resumed, ways=[signal.SIGINT, signal.SIGKILL]))
    assert [run["kept"] for run in runs] == [*range(2, 1 + len(runs)), job_cases.JOBS]
    assert sorted(calls(folder / "log")) == [*range(job_cases.JOBS)]
    assert not any(run["left"] for run in runs)


def test_failed_calls_are_named_when_all_others_are_done(outcome):
    case, folder = outcome("failed", job_cases.failed)
    assert case["calls"] == [0, 3]
    assert len(job_cases.kept(folder)) == 2
    for pattern in (
        "2 of 4 jobs failed",
        r'fails_on {.*"number": 2}: ArithmeticError: no result for 2',
        "the first of these raised:\nTraceback(.|\n)*in fails_on",
    ):
        assert re.search(pattern, case["message"])


def test_lost_process_fails_the_call_that_it_was_doing_alone(log, tmp_path):
    reasons = []
    given = [{"log": str(log), "number": 7}]
    cached(cluster_work.kills_itself, given, tmp_path, failed=lambda each, why: reasons.append((each, why)), **LOCAL)
    assert reasons == [(given[0], "its process was lost, with exit code -9 (out of memory?)")]
    assert calls(log) == [7]


@pytest.mark.storm
def test_ray_results_equal_local_ones_to_the_bit_though_a_node_was_killed(cluster, tmp_path):
    folder, outcome = cluster / "node", json.loads((cluster / "node.json").read_text())
    before = len(begun(folder / "log"))
    for function, there, here in zip(
        (cluster_work.played, numbers), job_cases.slices(folder), job_cases.slices(tmp_path), strict=True
    ):
        stored = cached(function, there, folder / "results", processes=0)  # needs no cluster any more
        computed = cached(function, here, tmp_path / "here", processes=0)
        for first, second in zip(stored, computed, strict=True):
            assert first.pop("where") != second.pop("where")  # the sources, and kernels, that were sent
            first.pop("threads", None), second.pop("threads", None)
        assert_identical(stored, computed)
    numbers_begun = calls(folder / "log")
    assert len(numbers_begun) == before
    assert sorted(outcome["fetched"]) == [*range(12)]
    assert any(numbers_begun.count(number) > 1 for number in outcome["unfetched"])  # done there, and again elsewhere


@pytest.mark.storm
def test_ray_names_the_remedy_where_no_cluster_is(cluster):
    assert "ray start --head" in json.loads((cluster / "none.json").read_text())


def test_ray_names_the_extra_where_it_is_missing(tmp_path, monkeypatch, log):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(RuntimeError, match="install the extra `cluster`"):
        cached(numbers, listed(log, 1), tmp_path / "results", cluster="ray")


def test_node_with_other_libraries_does_no_call(tmp_path, log):
    call = Call("cluster_work:numbers", json.dumps(listed(log)[0]), "")
    assert b"install the same" in jobs.perform(call, {"numpy": "0.1"})
    assert calls(log) == []
    assert b"install the same" not in jobs.perform(call, {"numpy": np.__version__})


def test_results_have_the_same_bits_whatever_the_order_and_the_processes(log, tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    here = cached(numbers, listed(log), tmp_path / "here", processes=0)
    assert calls(log) == list(range(6))
    for number, result in enumerate(here):
        drawn = np.random.default_rng(number).standard_normal((64, 64))
        np.testing.assert_allclose(result["product"], drawn @ drawn.T, rtol=1e-12, atol=1e-12)
        assert result.pop("threads")[0] == "7"
    backwards = cached(numbers, listed(log)[::-1], tmp_path / "results", **LOCAL)
    again = cached(numbers, listed(log), tmp_path / "results", **LOCAL)
    assert sorted(calls(log)) == sorted([*range(6), *range(6)])
    for each in (*backwards, *again):
        assert each.pop("threads") == ["1", "1", "1", "1"]
    assert_identical(here, backwards[::-1])
    assert_identical(here, again)
    assert (os.environ["OMP_NUM_THREADS"], "MKL_NUM_THREADS" in os.environ) == ("7", False)  # this process's own


def test_equal_calls_are_done_once_and_each_has_a_result_of_its_own(log, tmp_path):
    cached(numbers, listed(log, 2)[1:], tmp_path, processes=0)
    seen = []
    results = cached(
        numbers, listed(log, 2) + listed(log, 3), tmp_path, processes=0, done=lambda *each: seen.append(each)
    )
    assert calls(log) == [1, 0, 2]
    assert [result["number"] for result in results] == [0, 1, 0, 1, 2]
    assert results[0] is not results[2]
    assert [place for place, _ in seen] == [1, 3, 0, 2, 4]  # what was stored comes first
    assert all(result is results[place] for place, result in seen)


def flipped(content):
    """One bit in the middle of what is stored."""
    half = len(content) // 2
    return content[:half] + bytes([content[half] ^ 1]) + content[half + 1 :]


@pytest.mark.parametrize("damage", [
    lambda content: content[:-40],
    lambda _: b"",
    lambda content: np.random.default_rng(0).bytes(len(content)),
    flipped,
])  # fmt: skip
def test_damaged_result_is_computed_anew(log, tmp_path, capsys, damage):
    folder, given = tmp_path / "results", listed(log, 3)
    before = cached(numbers, given, folder, processes=0)
    path = min(job_cases.kept(folder))
    path.write_bytes(damage(path.read_bytes()))
    after = cached(numbers, given, folder, processes=0)
    assert len(calls(log)) == 4
    assert_identical(before, after)
    damaged = calls(log)[-1]
    assert re.search(rf'computed anew: .*"number": {damaged}}} is damaged in', capsys.readouterr().err)
    cached(numbers, given, folder, processes=0)
    assert len(calls(log)) == 4


def test_two_commands_may_share_a_folder(log, tmp_path):
    """The second begins when the first has stored one result, and goes on with what there is."""
    others = []

    def meanwhile(*_):
        if not others:
            others.extend(cached(numbers, listed(log, 6)[::-1], tmp_path, processes=0))

    first = cached(numbers, listed(log, 3), tmp_path, processes=0, done=meanwhile)
    assert_identical(first, others[:2:-1])
    assert calls(log)[:6] == [0, 5, 4, 3, 2, 1]
    assert len(job_cases.kept(tmp_path)) == 6


def test_late_call_is_ended_and_its_failure_stored_where_something_stands_for_it(log, tmp_path):
    given = [{"log": str(log), "number": 3, "seconds": 600.0}, {"log": str(log), "number": 4}]
    for _ in range(2):  # the second time nothing is begun
        late, done = cached(numbers, given, tmp_path, seconds=1.0, failed=lambda _, reason: reason, **LOCAL)
        assert (late, done["number"]) == ("no answer within 1 s", 4)
        assert sorted(calls(log)) == [3, 4]
    bad = [{"log": str(log), "number": 1, "bad": [1]}]
    assert cached(fails_on, bad, tmp_path, processes=0, failed=lambda _, why: why) == [
        "ArithmeticError: no result for 1"
    ]
    with pytest.raises(JobsFailedError, match="ArithmeticError"):  # whoever wants results tries once more
        cached(fails_on, bad, tmp_path, processes=0)
    assert cached(slow_to_load.at_once, [{}], tmp_path, seconds=0.7, **LOCAL) == [1.0]  # importing does not count


@pytest.mark.parametrize("processes", [0, 1])
def test_command_ends_where_a_call_finds_no_room_and_keeps_what_is_done(processes, log, tmp_path):
    cached(numbers, listed(log, 1), tmp_path, processes=0)
    given = [{"path": str(tmp_path / "file")}]
    with pytest.raises(DiskFullError, match=r"no room to write .*file: No space left on device"):
        cached(cluster_work.finds_no_room, given, tmp_path, processes=processes, failed=lambda *_: None)
    assert len(job_cases.kept(tmp_path)) == 1


def test_another_process_finds_what_is_stored_in_each_folder(log, tmp_path):
    for name in ("first", "second"):
        cached(numbers, listed(log, 2), tmp_path / name, processes=0)
    before = job_cases.kept(tmp_path)
    code = (
        "import cluster_work, sys; from agents.jobs import cached; cached(cluster_work.numbers, {}, {!r}, processes=0)"
    )
    path = os.pathsep.join(map(str, (HELPERS, ROOT)))
    command = [sys.executable, "-c", code.format(listed(log, 2), str(tmp_path / "second"))]
    subprocess.run(command, check=True, env=os.environ | {"PYTHONPATH": path})
    assert (job_cases.kept(tmp_path), len(calls(log))) == (before, 4)


@pytest.mark.parametrize(("options", "message"), [
    ({"processes": -1}, "processes must be a whole number of at least 0, got -1"),
    ({"seconds": 2.0, "cluster": "ray"}, "seconds or cluster, not both"),
    ({"seconds": 0.0}, "seconds must be finite and above 0 s"),
])  # fmt: skip
def test_wrong_options_are_refused_at_once(tmp_path, options, message):
    with pytest.raises(ValueError, match=message):
        cached(numbers, [], tmp_path, **options)


@pytest.mark.parametrize(("function", "arguments", "kind", "message"), [
    (lambda: 1, {}, ValueError, "put it into a module"),
    (numbers, {"log": "x"}, TypeError, "missing a required argument: 'number'"),
    (numbers, {"log": "x", "number": np.array([1.0])}, TypeError, "JSON"),
    (cluster_work.no_data, {}, JobsFailedError, "no_data.*pickle"),
])  # fmt: skip
def test_function_and_arguments_that_cannot_be_sent_are_refused(function, arguments, kind, message, tmp_path):
    with pytest.raises(kind, match=message):
        cached(function, [arguments], tmp_path, processes=0)


def test_result_is_another_for_another_function_other_arguments_and_what_it_depends_on(log, tmp_path):
    given = {"log": str(log), "number": 1, "bad": []}
    for count, (function, arguments, depends) in enumerate([
        (fails_on, given, ""), (fails_on, given | {"bad": [3]}, ""), (fails_on, given, "sources"),
        (numbers, {"log": str(log), "number": 1}, ""),
    ], start=1):  # fmt: skip
        cached(function, [arguments], tmp_path / "results", depends=depends, processes=0)
        assert len(calls(log)) == count
    cached(fails_on, [dict(reversed(given.items()))], tmp_path / "results", processes=0)
    assert len(calls(log)) == 4


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


def test_progress_in_a_log_is_silent_for_30_s_and_then_a_line_at_a_time(capsys):
    bar = progress("tuning", 3)
    bar.update(2)
    bar.close()
    assert capsys.readouterr().err == ""
    bar = progress("tuning", 3)
    bar.start_t -= 31.0  # as if it had taken as long
    bar.last_print_t -= 31.0
    bar.update(2)
    bar.update(1)
    bar.close()
    lines = capsys.readouterr().err.splitlines()
    assert re.fullmatch(r"tuning: 2 of 3 after 00:31, \S+ left", lines[0])
    assert [line[:14] for line in lines[1:]] == ["tuning: 3 of 3"]
