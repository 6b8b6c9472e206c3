"""What every engine must do with jobs. Run as a script, on a Ray cluster of two nodes on this machine.

Ray is noisy and its warnings are not ours, so pytest looks only at what the script leaves in its folder.
"""

import json
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

from agents.jobs.store import Store
from cluster_work import begun, calls

from agents.jobs import Job, JobsFailedError, gather, gather_all

ROOT = Path(__file__).parents[2]
NODE = {"num_cpus": 1, "object_store_memory": 80 * 2**20}
HEAD = {**NODE, "include_dashboard": False, "_system_config": {"health_check_period_ms": 300}}
"""A node is lost once five looks after it fail; by itself Ray looks every 3 s."""
LAST = "none.json"  # the file that the script writes last
JOBS = 8  # of a gathering that is killed


def lost_and_failed(folder, **engine):
    """Gather jobs that raise, kill their worker, or return what is no result; return what the error says."""
    log = str(folder / "log")
    jobs = [
        Job("cluster_work:kills_itself", {"log": log, "number": 100, "times": 1}),
        Job("cluster_work:kills_itself", {"log": log, "number": 200, "times": 99}),
        Job("cluster_work:fails_on", {"log": log, "number": 300, "bad": [300]}),
        Job("cluster_work:no_arrays", {}),
        *(Job("cluster_work:numbers", {"log": log, "number": number}) for number in range(3)),
    ]
    gathered = []
    try:
        gathered.extend(place for place, _ in gather(jobs, folder / "results", retries=1, **engine))
    except JobsFailedError as error:
        return {"message": str(error), "calls": sorted(calls(log)), "gathered": sorted(gathered)}


def descendants(pid):
    """Return the processes below one, as the kernel lists them."""
    below = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(child) for child in below] + [deeper for child in below for deeper in descendants(int(child))]


def alive(pid):
    """Whether a process runs."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def kept(folder):
    """Return how many results a folder holds."""
    with closing(Store(folder / "results")) as store:
        return len(store)


def killed_and_resumed(folder, ways, **engine):
    """Stop a gathering in these ways, and let it end; return what each run found, kept and left alive."""
    code = (
        "import signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # else ignored where pytest is in the background
        f"sys.path[:0] = {[str(Path(__file__).parent), str(ROOT)]!r}\n"  # what is tested, not what is installed
        "from agents.jobs import Job, gather_all\n"
        "if __name__ == '__main__':\n"
        f"    given = dict(log={str(folder / 'log')!r}, below={str(folder / 'below')!r})\n"
        f"    jobs = [Job('cluster_work:numbers', given | dict(number=number)) for number in range({JOBS})]\n"
        f"    gather_all(jobs, {str(folder / 'results')!r}, **{engine!r})\n"
    )
    (folder / "driver.py").write_text(code)
    runs = []
    for enough, how in (*enumerate(ways, 2), (JOBS, None)):
        found = kept(folder)
        (folder / "below").write_text(str(enough))
        with subprocess.Popen([sys.executable, str(folder / "driver.py")], cwd=ROOT, stderr=subprocess.DEVNULL) as run:
            while kept(folder) < enough:
                assert run.poll() is None, "the gathering ended too soon"
                time.sleep(0.02)
            below = descendants(run.pid) if how else []
            if how:
                run.send_signal(how)
            run.wait(60)
        deadline = time.monotonic() + 10
        while any(map(alive, below)) and time.monotonic() < deadline:
            time.sleep(0.05)
        runs.append({"found": found, "kept": kept(folder), "left": sum(map(alive, below))})
    return runs


def slices(folder):
    """Return slices of the validation set, and results too large to be sent with the answer."""
    log = str(folder / "log")
    jobs = [Job("cluster_work:played", {"log": log, "number": number, "count": 25}) for number in range(24)]
    large = {"log": log, "seconds": 0.1, "megabytes": 1}
    jobs += [Job("cluster_work:numbers", {**large, "number": number}) for number in range(24, 36)]
    return sorted(jobs, key=lambda job: job.key)


def node_killed(cluster, node, folder):
    """Gather while a node is lost, without its leave; at that time it holds results that nobody has fetched."""
    jobs, gathered, raylet = slices(folder), [], node.all_processes["raylet"][0].process.pid
    for place, _ in gather(jobs, folder / "results", cluster=cluster.address):
        gathered.append(jobs[place].arguments["number"])
        there = [number for number, parent in begun(folder / "log") if parent == raylet]
        if node and len(there) >= 3:
            time.sleep(2.0)  # in which it does what it was given
            there = [number for number, parent in begun(folder / "log") if parent == raylet]
            cluster.remove_node(node, allow_graceful=False)
            node = None
            held = {"begun there": there, "unfetched": sorted({*there} - {*gathered})}
    return {"gathered": gathered, **held}


def no_cluster(folder):
    """Ask for a cluster that is not there."""
    try:
        gather_all(slices(folder)[:1], folder, cluster="127.0.0.1:1")
    except RuntimeError as error:
        return str(error)


def main():
    """Run all on a cluster, and write what they return into the folder."""
    import ray
    from ray.cluster_utils import Cluster

    root = Path(sys.argv[1])
    cluster = Cluster(initialize_head=True, head_node_args=HEAD)
    address = {"cluster": cluster.address}
    cases = {
        "killed": lambda folder: killed_and_resumed(folder, [signal.SIGKILL], **address),
        "bad": lambda folder: lost_and_failed(folder, **address),
        "node": lambda folder: node_killed(cluster, cluster.add_node(**NODE), folder),
        "none": no_cluster,
    }
    try:
        for name, case in cases.items():
            begun = time.monotonic()
            (root / name).mkdir()
            (root / f"{name}.json").write_text(json.dumps(case(root / name)))
            print(f"{name}: {time.monotonic() - begun:.1f} s", file=sys.stderr)
    finally:
        ray.shutdown()
        cluster.shutdown()


if __name__ == "__main__":
    main()
