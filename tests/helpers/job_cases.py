"""Calls on a Ray cluster: a script, which starts a cluster of two nodes on this machine.

Ray prints much, and its warnings would fail the tests. So pytest reads only the files that the script writes.
"""

import json
import sys
import time
from pathlib import Path

from cluster_work import begun, fails_on, numbers, played
from ray.cluster_utils import Cluster

from agents.jobs import JobsFailedError, cached

NODE = {"num_cpus": 1, "object_store_memory": 80 * 2**20}
HEAD = {**NODE, "include_dashboard": False, "_system_config": {"health_check_period_ms": 300}}
"""A node is lost after five failed health checks; by default Ray checks every 3 s."""


def scenarios(folder):
    """Return the arguments of calls that play scenarios of the validation set."""
    return [{"log": str(folder / "played"), "number": number, "count": 25} for number in range(12)]


def large(folder, seconds=0.5):
    """Return the arguments of calls whose results are too large to be sent at once."""
    log = str(folder / "log")
    return [{"log": log, "seconds": seconds, "megabytes": 1, "number": number} for number in range(24)]


def said(function, arguments, folder, cluster):
    """Return the message of the error that the calls raise."""
    try:
        cached(function, arguments, folder, cluster=cluster)
    except (JobsFailedError, RuntimeError) as error:
        return str(error)


def lose_node(folder, cluster, node):
    """Kill a node that holds results; return the numbers of its results that were not fetched."""
    fetched, unfetched = [], []
    raylet = node.all_processes["raylet"][0].process.pid

    def on_node():
        return [number for number, parent, _ in begun(folder / "log") if parent == raylet]

    def lose(place, _):
        fetched.append(place)
        if not unfetched and len(on_node()) >= 3:
            time.sleep(2.0)  # in this time it runs its calls
            unfetched.extend({*on_node()} - {*fetched})
            cluster.remove_node(node, allow_graceful=False)

    cached(numbers, large(folder), folder / "results", cluster=cluster.address, done=lose)
    return unfetched


def main():
    """Run all cases on a cluster, and write the outcome into the folder."""
    folder = Path(sys.argv[1])
    cluster = Cluster(initialize_head=True, head_node_args=HEAD)
    node = cluster.add_node(**NODE)
    try:
        cached(played, scenarios(folder), folder / "results", cluster=cluster.address)
        bad = [{"log": str(folder / "bad"), "number": number, "bad": [1]} for number in range(2)]
        outcome = {"failed": said(fails_on, bad, folder, cluster.address)}
        outcome["unfetched"] = lose_node(folder, cluster, node)
    finally:
        cluster.shutdown()
    outcome["none"] = said(numbers, large(folder), folder / "none", "127.0.0.1:1")
    (folder / "outcome.json").write_text(json.dumps(outcome))


if __name__ == "__main__":
    main()
