"""Calls on a Ray cluster: a script, which starts a cluster on this machine.

Ray prints much, and its warnings would fail the tests. So pytest reads only the files that the script writes.
"""

import json
import sys
from pathlib import Path

from cluster_work import fails_on, played
from ray.cluster_utils import Cluster

from agents.jobs import JobsFailedError, cached


def scenarios(folder):
    """Return the arguments of calls that play scenarios of the validation set."""
    return [{"log": str(folder / "log"), "number": number, "count": 25} for number in range(12)]


def said(function, arguments, folder, cluster):
    """Return the message of the error that the calls raise."""
    try:
        cached(function, arguments, folder, cluster=cluster)
    except (JobsFailedError, RuntimeError) as error:
        return str(error)


def main():
    """Run all cases on a cluster, and write the messages of the errors into the folder."""
    folder = Path(sys.argv[1])
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False})
    try:
        cached(played, scenarios(folder), folder / "results", cluster=cluster.address)
        bad = [{"log": str(folder / "bad"), "number": number, "bad": [1]} for number in range(2)]
        outcome = {"failed": said(fails_on, bad, folder, cluster.address)}
    finally:
        cluster.shutdown()
    outcome["none"] = said(played, scenarios(folder), folder / "none", "127.0.0.1:1")
    (folder / "outcome.json").write_text(json.dumps(outcome))


if __name__ == "__main__":
    main()
