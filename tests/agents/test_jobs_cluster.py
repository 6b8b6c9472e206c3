"""Jobs on a Ray cluster of two nodes, one of which is killed midway: nothing is lost, nothing is counted twice."""

import fcntl
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import cluster_script
import pytest
from cluster_work import begun

from agents.evaluate.play import play
from agents.jobs import gather, gather_all, ray_cluster, sources
from agents.jobs.store import Store

HERE = Path(__file__).parents[1] / "helpers"
LAST = "none.json"  # the file that cluster_script.py writes last


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """The folder that cluster_script.py filled, once for all workers of pytest-xdist, and the results made here."""
    pytest.importorskip("ray", reason="the extra `cluster` is not installed")
    root = tmp_path_factory.getbasetemp()
    root = root.parent if "PYTEST_XDIST_WORKER" in os.environ else root
    folder, here = root / "cluster", root / "here"
    with (root / "cluster.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / LAST).exists():
            folder.mkdir()
            run_script(folder)
        return folder, gather_all(cluster_script.jobs(here), here / "results", processes=0)


def run_script(folder):
    of_another_cluster = ("RAY_ADDRESS", "RAY_RUNTIME_ENV_HOOK")
    environment = {name: value for name, value in os.environ.items() if name not in of_another_cluster}
    path = os.pathsep.join(map(str, (HERE, HERE.parents[1])))  # these sources, whatever is installed
    environment |= {"RAY_USAGE_STATS_ENABLED": "0", "PYTHONPATH": path, "PYTHONWARNINGS": "default"}
    command = [sys.executable, HERE / "cluster_script.py", folder]
    with (folder / "said").open("w") as said:
        streams = {"stdout": said, "stderr": said}
        done = subprocess.run(command, check=False, cwd=HERE.parents[1], env=environment, timeout=300, **streams)
    assert done.returncode == 0, (folder / "said").read_text()[-4000:]


@pytest.mark.storm
def test_every_result_comes_once_and_equals_the_local_one_to_the_bit(cluster):
    folder, locally = cluster
    jobs = cluster_script.jobs(folder)
    came = json.loads((folder / "came.json").read_text())["came"]
    assert sorted(came) == list(range(len(jobs)))
    store = Store(folder / "results")
    assert len(store) == len({job.key for job in jobs}) == len(jobs)
    for job, here in zip(jobs, locally, strict=True):
        there = store.read(job.key)
        assert str(here.pop("where")) == str(HERE / "cluster_work.py")
        assert Path(str(there.pop("where"))) != HERE / "cluster_work.py"  # the sources that were sent
        assert there.keys() == here.keys()
        for name, values in here.items():
            assert (there[name].dtype, there[name].shape) == (values.dtype, values.shape)
            assert there[name].tobytes() == values.tobytes(), name


@pytest.mark.storm
def test_the_killed_node_had_done_jobs_whose_results_had_to_be_made_again(cluster):
    folder, _ = cluster
    told = json.loads((folder / "came.json").read_text())
    again = {number for number in told["unfetched"] if [one for one, _ in begun(folder / "log")].count(number) > 1}
    assert len(told["done there"]) >= 3
    assert again


@pytest.mark.storm
def test_a_gathering_that_is_repeated_needs_no_cluster_any_more(cluster):
    folder, _ = cluster
    before = len(begun(folder / "log"))
    came = [place for place, _ in gather(cluster_script.jobs(folder), folder / "results", processes=0)]
    assert sorted(came) == list(range(36))
    assert len(begun(folder / "log")) == before


@pytest.mark.storm
def test_lost_workers_are_retried_and_failed_jobs_named(cluster):
    folder, _ = cluster
    told = json.loads((folder / "bad.json").read_text())
    assert told["calls"] == [100, 100, 200, 200]
    assert "2 of 3 jobs failed" in told["said"]
    assert "number=300, bad=[300]): ArithmeticError: no result for 300" in told["said"]
    assert "number=200, times=99): its worker was lost 2 time(s)" in told["said"]


@pytest.mark.storm
def test_where_no_cluster_is_the_remedy_is_named(cluster):
    assert "ray start --head" in json.loads((cluster[0] / "none.json").read_text())


def test_where_ray_is_missing_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(RuntimeError, match="install the extra `cluster`"):
        gather_all(cluster_script.jobs(tmp_path), tmp_path / "results", cluster="ray")


def test_a_node_with_other_libraries_is_refused():
    versions = ray_cluster._versions()
    job = "cluster_work:no_arrays", {}
    assert "install the same" not in ray_cluster._perform_alike(*job, versions).reason
    assert "install the same" in ray_cluster._perform_alike(*job, versions | {"numpy": "0.1"}).reason


def test_the_sources_that_are_sent_hold_what_the_jobs_import_and_the_compiled_kernels(tmp_path):
    play({"baseline": "paper-trapezoid"}, {"set": "validation", "count": 1})
    with zipfile.ZipFile(sources.stage({"cluster_work:played"}, tmp_path / "sources.zip")) as archive:
        names = archive.namelist()
    assert {"cluster_work.py", "agents/jobs/work.py", "impact_gym/envs/sets/validation.csv"} <= set(names)
    assert any(name.startswith("impact_gym/kernels.") and name.endswith(".so") for name in names)
    assert "test_jobs.py" not in names
    assert not any(name.startswith(("runs", "reports", "numpy")) for name in names)


def test_the_same_sources_make_the_same_zip_and_too_large_ones_none(tmp_path, monkeypatch):
    monkeypatch.setattr(sources, "ALWAYS", ("impact_gym.envs", "json"))
    one, two = (sources.stage({"cluster_work:played"}, tmp_path / f"{name}.zip") for name in ("one", "two"))
    assert one.read_bytes() == two.read_bytes()
    with zipfile.ZipFile(one) as archive:
        assert "json/__init__.py" not in archive.namelist()  # the nodes have it
    monkeypatch.setattr(sources, "LARGEST", 1000)
    with pytest.raises(ValueError, match="the sources for the cluster are"):
        sources.stage({"cluster_work:played"}, tmp_path / "three.zip")
