"""Workers that run independent calls for `agents.jobs`: processes of this machine or nodes of a Ray cluster.

The package pebble starts the processes. It can end a call that takes too long, and a dead process fails only its call.
"""

import json
import logging
import multiprocessing
import os
import pickle
import pkgutil
import socket
import threading
import traceback
import warnings
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import islice
from typing import Any, NamedTuple

from agents.provenance import origin_of
from impact_gym.files import DiskFullError

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment variables that give a worker one thread, so that sums do not depend on the number of cores."""


class Failure(NamedTuple):
    """The reason for which a call has no result."""

    reason: str
    trace: str = ""  # traceback of the error that the function raised


@dataclass(frozen=True)
class Call:
    """A call: function "module:name", arguments as JSON, and everything else on which its result depends."""

    function: str
    arguments: str  # with sorted keys
    depends: str
    given: str = field(default="", compare=False)  # arguments as JSON, in the order of the caller


Answers = Generator[tuple[Call, bytes], None, None]
"""Each call, in the order of completion, with its pickled result, `Failure` or `DiskFullError`."""


def perform(call: Call, versions: Mapping[str, str]) -> bytes:
    """Run a call, if packages have these `versions`; return its pickled result, `Failure` or `DiskFullError`."""
    try:
        if (here := {name: version(name) for name in versions}) != versions:
            same = "install the same versions on all nodes"
            raise RuntimeError(f"the node has {here}, the calling process {versions}: {same}")
        with warnings.catch_warnings(action="ignore", category=UserWarning):  # the calling process has warned already
            result = pkgutil.resolve_name(call.function)(**json.loads(call.given or call.arguments))
        return pickle.dumps(result, protocol=5)
    except DiskFullError as error:
        return pickle.dumps(error)
    except (Exception, SystemExit) as error:
        return pickle.dumps(Failure(f"{type(error).__name__}: {error}", traceback.format_exc()))


def on_this_machine(calls: Sequence[Call], processes: int | None, seconds: float | None) -> Answers:
    """Run calls in new processes of this machine, spawned, because forked ones would inherit threads and locks."""
    if processes == 0 or not calls:
        yield from ((call, perform(call, {})) for call in calls)
        return
    from unittest.mock import patch

    from pebble import ProcessExpired, ProcessPool

    count, context = min(len(calls), processes or os.cpu_count() or 1), multiprocessing.get_context("spawn")
    with patch.dict(os.environ, ONE_THREAD):
        pool = ProcessPool(count, initializer=_begin, initargs=[calls[0].function], context=context)
        try:
            under_way: dict[Any, Call] = {pool.schedule(perform, [call, {}], timeout=seconds): call for call in calls}
            for future in as_completed([*under_way]):
                try:
                    pickled = future.result()
                except TimeoutError:
                    pickled = pickle.dumps(Failure(f"no answer within {seconds:g} s"))
                except ProcessExpired as error:
                    reason = f"its process was lost, with exit code {error.exitcode} (out of memory?)"
                    pickled = pickle.dumps(Failure(reason))
                except Exception as error:
                    reason = f"no process started, as in a script without `if __name__ == '__main__'`: {error}"
                    pickled = pickle.dumps(Failure(reason))
                yield under_way.pop(future), pickled
        finally:
            pool.stop()  # type: ignore[no-untyped-call]  # pebble's own
            pool.join()


def _begin(function: str) -> None:
    """Import the function in a new worker, which ends when the calling process ends or is killed."""

    def end_with_parent() -> None:
        if parent := multiprocessing.parent_process():
            parent.join()
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    pkgutil.resolve_name(function)


def on_cluster(calls: Sequence[Call], address: str) -> Answers:
    """Run each call on one core of a Ray cluster, with this machine's sources; Ray repeats the calls of a lost node."""
    if not calls:
        return
    try:
        import ray
        import ray.exceptions
    except ImportError as error:
        raise RuntimeError("Ray is not installed: install the extra `cluster`, here and on all nodes") from error
    sources = {"agents", "impact_gym", calls[0].function.replace(":", ".").split(".")[0]}
    sent: dict[str, Any] = {"py_modules": [str(origin_of(name)) for name in sorted(sources)], "env_vars": ONE_THREAD}
    sent["working_dir"] = str(origin_of("agents") / "tuned")  # a folder without modules: nodes import only `py_modules`
    try:
        place = os.environ.get("RAY_ADDRESS", "") if address in ("ray", "auto") else address
        if place and place not in ("ray", "auto"):  # Ray itself would wait for minutes for a dead address
            host, _, port = place.removeprefix("ray://").rpartition(":")
            socket.create_connection((host.strip("[]"), int(port)), timeout=10.0).close()
        name = "auto" if address == "ray" else address
        ray.init(name, runtime_env=sent, log_to_driver=False, logging_level=logging.WARNING)
    except (OSError, RuntimeError, ValueError) as error:
        begin = "`ray start --head`, and `ray start --address=HOST:PORT` on each further node"
        raise RuntimeError(f"no Ray cluster at {address!r} ({error}): start one with {begin}") from error
    task: Any = ray.remote(num_cpus=1, max_retries=3)(perform)
    versions = {name: version(name) for name in ("numpy", "scipy")}  # another version may change the last bit
    waiting, under_way = iter(calls), dict[Any, Call]()
    ahead = 64 + 4 * int(ray.cluster_resources().get("CPU", 0))  # type: ignore[no-untyped-call]  # enough that no node waits
    try:
        while True:
            under_way |= {task.remote(call, versions): call for call in islice(waiting, ahead - len(under_way))}
            if not under_way:
                return
            ready = ray.wait([*under_way])[0][0]
            try:
                pickled = ray.get(ready)
            except ray.exceptions.RayError as error:
                pickled = pickle.dumps(Failure(f"its process was lost, or could not start: {error}"))
            yield under_way.pop(ready), pickled
    finally:
        ray.shutdown()  # ends running calls, too
