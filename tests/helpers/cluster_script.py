"""Run by test_jobs_cluster.py in a process of its own: two nodes on this machine, one of them killed midway.

Ray is noisy and its warnings are not ours, so pytest looks only at what this leaves in its folder.
"""

import json
import sys
import time
from pathlib import Path

from cluster_work import begun, calls

from agents.jobs import Job, JobsFailedError, gather, gather_all

NODE = {"num_cpus": 1, "object_store_memory": 80 * 2**20}
HEAD = {**NODE, "include_dashboard": False, "_system_config": {"health_check_period_ms": 300}}
"""A node is lost once five looks after it fail; by itself Ray looks every 3 s."""


def jobs(folder):
    """Return slices of the validation set, and results too large to be sent with the answer."""
    log = str(folder / "log")
    slices = [
        Job(
            "cluster_work:played",
            {
                "log": log,
                "number": number,
                "controller": {"baseline": "paper-trapezoid"},
                "first": 25 * number,
                "count": 25,
            },
        )
        for number in range(24)
    ]
    return slices + [
        Job("cluster_work:large", {"log": log, "number": number, "megabytes": 1}) for number in range(24, 36)
    ]


def one_node_killed(cluster, node, folder):
    """Gather while a node is lost, without its leave; at that time it holds results that nobody has fetched."""
    mixed = sorted(jobs(folder), key=lambda job: job.key)
    came, raylet = [], node.all_processes["raylet"][0].process.pid
    for place, _ in gather(mixed, folder / "results", cluster=cluster.address):
        came.append(mixed[place].arguments["number"])
        there = [number for number, parent in begun(folder / "log") if parent == raylet]
        if node and len(there) >= 3:
            time.sleep(2.0)  # in which it does what it was given
            there = [number for number, parent in begun(folder / "log") if parent == raylet]
            cluster.remove_node(node, allow_graceful=False)
            node = None
            told = {"done there": there, "unfetched": sorted({*there} - {*came})}
    (folder / "came.json").write_text(json.dumps({"came": came, **told}))


def bad_jobs(cluster, folder):
    """Gather jobs that raise or kill their worker."""
    log = str(folder / "bad-log")
    bad = [
        Job("cluster_work:kills_itself", {"log": log, "number": 100, "times": 1}),
        Job("cluster_work:kills_itself", {"log": log, "number": 200, "times": 99}),
        Job("cluster_work:fails_on", {"log": log, "number": 300, "bad": [300]}),
    ]
    try:
        gather_all(bad, folder / "bad", cluster=cluster.address, retries=1)
    except JobsFailedError as error:
        (folder / "bad.json").write_text(json.dumps({"said": str(error), "calls": sorted(calls(log))}))


def no_cluster(folder):
    """Ask for a cluster that is not there."""
    try:
        gather_all(jobs(folder)[:1], folder / "none", cluster="127.0.0.1:1")
    except RuntimeError as error:
        (folder / "none.json").write_text(json.dumps(str(error)))


def main():
    """Run all."""
    import ray
    from ray.cluster_utils import Cluster

    folder = Path(sys.argv[1])
    cluster = Cluster(initialize_head=True, head_node_args=HEAD)
    try:
        node = cluster.add_node(**NODE)
        for step in (lambda: one_node_killed(cluster, node, folder), lambda: bad_jobs(cluster, folder)):
            begun = time.monotonic()
            step()
            print(f"{time.monotonic() - begun:.1f} s")
    finally:
        ray.shutdown()
        cluster.shutdown()
    no_cluster(folder)


if __name__ == "__main__":
    main()
