"""Cases that processes of this machine and a Ray cluster must pass. Run as a script, on a cluster of two nodes here.

Ray is noisy and its warnings are not ours, so pytest looks only at what the script leaves in its folder.
"""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import cluster_work
from cluster_work import begun, calls

from agents.jobs import JobsFailedError, cached

ROOT = Path(__file__).parents[2]
NODE = {"num_cpus": 1, "object_store_memory": 80 * 2**20}
HEAD = {**NODE, "include_dashboard": False, "_system_config": {"health_check_period_ms": 300}}
"""A node is lost once five looks after it fail; by itself Ray looks every 3 s."""
LAST = "none.json"  # the file that the script writes last
JOBS = 8  # of a command that is killed
DRIVER = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # else ignored where pytest is in the background
sys.path[:0] = {path!r}  # what is tested, not what is installed
import cluster_work
from agents.jobs import cached
if __name__ == "__main__":
    given = [dict(log={log!r}, below={below!r}, number=number) for number in range({jobs})]
    cached(cluster_work.numbers, given, {results!r}, **{engine!r})
"""


def failed(folder, **engine):
    """Call what raises and what does not; return what the error says."""
    given = [{"log": str(folder / "log"), "number": number, "bad": [1, 2]} for number in range(4)]
    try:
        cached(cluster_work.fails_on, given, folder / "results", **engine)
    except JobsFailedError as error:
        return {"message": str(error), "calls": sorted(calls(folder / "log"))}


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
    """Return the stored results below a folder, each with what changes when it is computed again."""
    return {path: path.stat().st_mtime_ns for path in folder.glob("**/output.pkl")}


def killed_and_resumed(folder, ways, **engine):
    """Stop a command in these ways, and let it end; return what each run left stored and alive."""
    paths = {name: str(folder / name) for name in ("log", "below", "results")}
    path = [str(Path(__file__).parent), str(ROOT)]
    (folder / "driver.py").write_text(DRIVER.format(path=path, jobs=JOBS, engine=engine, **paths))
    runs = []
    for enough, how in (*enumerate(ways, 2), (JOBS, None)):
        (folder / "below").write_text(str(enough))
        with subprocess.Popen([sys.executable, str(folder / "driver.py")], cwd=ROOT, stderr=subprocess.DEVNULL) as run:
            while len(kept(folder)) < enough:
                assert run.poll() is None, "the command ended too soon"
                time.sleep(0.02)
            below = descendants(run.pid) if how else []
            if how:
                run.send_signal(how)
            run.wait(60)
        deadline = time.monotonic() + 10
        while any(map(alive, below)) and time.monotonic() < deadline:
            time.sleep(0.05)
        runs.append({"kept": len(kept(folder)), "left": sum(map(alive, below))})
    return runs


def slices(folder):
    """Return arguments for scenarios of the validation set, and for results too large to be sent with the answer."""
    log = str(folder / "log")
    large = [{"log": log, "seconds": 0.1, "megabytes": 1, "number": number} for number in range(12)]
    return [{"log": str(folder / "log played"), "number": number, "count": 25} for number in range(6)], large


def node_killed(cluster, node, folder):
    """Lose a node, without its leave, while it holds results that nobody has fetched."""
    small, large = slices(folder)
    cached(cluster_work.played, small, folder / "results", cluster=cluster.address)
    raylet, fetched, held = node.all_processes["raylet"][0].process.pid, [], {}

    def on_node():
        return [number for number, parent in begun(folder / "log") if parent == raylet]

    def lose(place, _):
        fetched.append(place)
        if not held and len(on_node()) >= 3:
            time.sleep(2.0)  # in which it does what it was given
            held["unfetched"] = sorted({*on_node()} - {*fetched})
            cluster.remove_node(node, allow_graceful=False)

    cached(cluster_work.numbers, large, folder / "results", cluster=cluster.address, done=lose)
    return {"fetched": fetched, **held}


def no_cluster(folder):
    """Ask for a cluster that is not there."""
    try:
        cached(cluster_work.numbers, slices(folder)[1], folder, cluster="127.0.0.1:1")
    except RuntimeError as error:
        return str(error)


def main():
    """Run all on a cluster, and write what they return into the folder."""
    from ray.cluster_utils import Cluster

    root = Path(sys.argv[1])
    cluster = Cluster(initialize_head=True, head_node_args=HEAD)
    address = {"cluster": cluster.address}
    cases = {
        "killed": lambda folder: killed_and_resumed(folder, [signal.SIGKILL], **address),
        "failed": lambda folder: failed(folder, **address),
        "node": lambda folder: node_killed(cluster, cluster.add_node(**NODE), folder),
        "none": no_cluster,
    }
    try:
        for name, case in cases.items():
            started = time.monotonic()
            (root / name).mkdir()
            (root / f"{name}.json").write_text(json.dumps(case(root / name)))
            print(f"{name}: {time.monotonic() - started:.1f} s", file=sys.stderr)
    finally:
        cluster.shutdown()


if __name__ == "__main__":
    main()
