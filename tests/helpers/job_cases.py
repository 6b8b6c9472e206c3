"""What a Ray cluster must do with calls. Run as a script, on a cluster of two nodes on this machine.

Ray is noisy and its warnings are not ours, so pytest looks only at what the script leaves in its folder.
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
"""A node is lost once five looks after it fail; by itself Ray looks every 3 s."""


def scenarios(folder):
    """Return arguments for scenarios of the validation set."""
    return [{"log": str(folder / "played"), "number": number, "count": 25} for number in range(12)]


def large(folder, seconds=0.5):
    """Return arguments for results too large to be sent with the answer."""
    log = str(folder / "log")
    return [{"log": log, "seconds": seconds, "megabytes": 1, "number": number} for number in range(24)]


def said(function, arguments, folder, cluster):
    """Return what the error says."""
    try:
        cached(function, arguments, folder, cluster=cluster)
    except (JobsFailedError, RuntimeError) as error:
        return str(error)


def lose_node(folder, cluster, node):
    """Lose a node, without its leave, while it holds results; return which of them were not fetched."""
    fetched, unfetched = [], []
    raylet = node.all_processes["raylet"][0].process.pid

    def on_node():
        return [number for number, parent in begun(folder / "log") if parent == raylet]

    def lose(place, _):
        fetched.append(place)
        if not unfetched and len(on_node()) >= 3:
            time.sleep(2.0)  # in which it does what it was given
            unfetched.extend({*on_node()} - {*fetched})
            cluster.remove_node(node, allow_graceful=False)

    cached(numbers, large(folder), folder / "results", cluster=cluster.address, done=lose)
    return unfetched


def main():
    """Do all on a cluster, and leave what came of it in the folder."""
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
