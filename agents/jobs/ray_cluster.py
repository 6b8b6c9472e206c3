"""Jobs on an existing Ray cluster: one task of one core each, a bounded number of them under way.

The nodes need the same Python, Ray, NumPy and SciPy; the project goes along, compiled. What Ray itself
would repeat after a loss is repeated here, so that it is counted the same way as on one machine, and a result whose
node dies before it was fetched is one more loss: the job is done again. A lost head ends the gathering; what it had
fetched is in the folder, and the same command continues.
"""

import os
import socket
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tqdm import tqdm

from agents.jobs.job import ONE_THREAD, Answer, Answers, Failure, Job, Queue, perform
from agents.jobs.sources import stage

AHEAD = 4  # tasks under way for each core: enough to hide the way there, few enough for the head's memory
LEAST = 64
"""Tasks under way at the least. Where the last one in Ray's queue is done while a longer one runs on another node, what
is asked for next may wait for that node though this one is idle (seen with Ray 2.60): so the queue never runs dry."""
PATIENCE = 60.0  # s without a result until it is said when there is no core
DECISIVE = ("numpy", "scipy")
"""Packages whose version may show in the last bit."""


def run(jobs: Sequence[Job], retries: int, *, address: str) -> Answers:
    """Do jobs on the cluster at `address`; see `agents.jobs.job.Engine` and `agents.jobs.gather`."""
    try:
        import ray
        import ray.exceptions
    except ImportError as error:
        message = f"Ray is not installed ({error}): install the extra `cluster`, here and on all nodes"
        raise RuntimeError(message) from error
    with _connected(ray, address, jobs):
        task = ray.remote(num_cpus=1, max_retries=0)(_perform_alike)
        queue = Queue(len(jobs), retries)
        flying: dict[Any, int] = {}
        cores = 0

        def fill() -> None:
            while queue.waiting and len(flying) < max(AHEAD * cores, LEAST):
                place = queue.waiting.popleft()
                flying[task.remote(jobs[place].function, jobs[place].arguments, _versions())] = place

        try:
            while queue.waiting or flying:
                cores = int(ray.cluster_resources().get("CPU", 0))  # type: ignore[no-untyped-call]  # Ray's own
                fill()
                if not ray.wait(list(flying), timeout=PATIENCE)[0] and cores == 0:
                    tqdm.write("the Ray cluster has no core: waiting for one")
                for ready in ray.wait(list(flying), num_returns=len(flying), timeout=0)[0]:
                    place = flying.pop(ready)
                    answer: Answer | None
                    try:
                        answer = ray.get(ready)
                    except ray.exceptions.RayTaskError as error:  # perform itself raises nothing: it could not be sent
                        answer = Failure(f"the worker could not begin: {error.cause!r}", str(error))
                    except ray.exceptions.RayError as error:
                        answer = queue.lose(place, f"{type(error).__name__}: {error}".splitlines()[0])
                    fill()  # first, so that the nodes have work while the answer is dealt with
                    if answer is not None:
                        yield place, answer
        finally:
            for under_way in flying:
                ray.cancel(under_way, force=True)


def _perform_alike(function: str, arguments: Mapping[str, Any], versions: Mapping[str, str]) -> Answer:
    """Do a job if this worker's libraries are those of the gathering process."""
    other = {name: here for name, here in _versions().items() if here != versions[name]}
    if other:
        return Failure(f"the node has {other}, the gathering process {dict(versions)}: install the same on all")
    return perform(function, arguments)


@cache
def _versions() -> dict[str, str]:
    return {name: version(name) for name in DECISIVE}


@contextmanager
def _connected(ray: Any, address: str, jobs: Sequence[Job]) -> Iterator[None]:
    """Connect to the cluster, with the sources; or use the connection that this process has, as it is.

    Raises:
        RuntimeError: there is no cluster; says how to start one.
    """
    if ray.is_initialized():
        yield
        return
    with tempfile.TemporaryDirectory(prefix="impact-gym-sources-") as folder:
        sources = stage({job.function for job in jobs}, Path(folder) / "sources.zip")  # Ray leaves kernels out
        environment = {"working_dir": str(sources), "env_vars": ONE_THREAD}
        name = "auto" if address == "ray" else address
        try:
            _listens(address)
            ray.init(name, runtime_env=environment, log_to_driver=False, logging_level="WARNING")
        except (OSError, RuntimeError, ValueError) as error:
            raise RuntimeError(
                f"no Ray cluster at {address!r} ({error}): start one with `ray start --head`, and with `ray start "
                "--address=HOST:PORT` on each further node; or name one that runs"
            ) from error
        try:
            yield
        finally:
            ray.shutdown()


def _listens(address: str) -> None:
    """Make sure that somebody listens at the address that is given: Ray itself keeps asking for minutes.

    Raises:
        OSError, ValueError: nobody does, or it is no address.
    """
    place = os.environ.get("RAY_ADDRESS", "") if address in ("ray", "auto") else address
    if place and place not in ("ray", "auto"):
        host, _, port = place.removeprefix("ray://").rpartition(":")
        with socket.create_connection((host.strip("[]"), int(port)), timeout=10.0):
            pass
