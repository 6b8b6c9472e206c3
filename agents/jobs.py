"""Run independent calls in parallel, on this machine or on a Ray cluster, and store their results.

The process that calls `cached` stores each result in a file as soon as the result arrives. So a repeated command
computes only the missing results. The nodes of a cluster need no common disk. Reading a stored result can run code,
because the result is a pickle: give `cached` a folder that only you can write to.
"""

import inspect
import json
import logging
import multiprocessing
import os
import pickle
import pkgutil
import socket
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import as_completed
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from impact_gym.support.archive import checksum
from impact_gym.support.command_line import progress
from impact_gym.support.files import DiskFullError, remove_unfinished, write_file
from impact_gym.support.provenance import origin_of
from impact_gym.support.validation import WrongTypeError, number, whole

SHOWN = 10  # largest number of failed calls that JobsFailedError lists
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment variables that give a worker one thread, so that sums do not depend on the number of cores."""


class Failure(NamedTuple):
    """The reason why a call has no result."""

    reason: str
    trace: str = ""  # traceback of the error that the function raised


@dataclass(frozen=True)
class Call:
    """A call of a function."""

    function: str  # "module:name"
    arguments: str  # JSON, with sorted keys
    depends: str  # everything else on which the result depends
    given: str = field(default="", compare=False)  # arguments as JSON, in the order of the caller


Answers = Generator[tuple[Call, bytes], None, None]
"""Each call, in the order of completion, with its pickled result, `Failure` or `DiskFullError`."""
Workers = Callable[[Sequence[Call]], Answers]


class JobsFailedError(RuntimeError):
    """Some calls failed; the results of all others are stored."""

    def __init__(self, failed: Mapping[Call, Failure], count: int) -> None:
        self.failed = failed
        lines = [f"{len(failed)} of {count} jobs failed (the results of the others are stored):"]
        for call, failure in islice(failed.items(), SHOWN):
            lines.append(f"{call.function} {call.arguments[:400]}: {failure.reason}")
        lines += [f"and {len(failed) - SHOWN} more"] if len(failed) > SHOWN else []
        lines += [f"the first of these raised:\n{failure.trace}" for failure in failed.values() if failure.trace][:1]
        super().__init__("\n".join(lines))


def cached(
    function: Callable[..., Any], arguments: Iterable[Mapping[str, Any]], folder: Path | str, *,
    depends: str = "", title: str = "jobs", processes: int | None = None, cluster: str | None = None,
    seconds: float | None = None, failed: Callable[[Mapping[str, Any], str], Any] | None = None,
    done: Callable[[int, Any], object] | None = None,
) -> list[Any]:  # fmt: skip
    """Return `function(**each)` for each of `arguments`, in their order; results in `folder` are not computed again.

    Args:
        function: a function at the top level of an importable module; its result can be pickled.
        arguments: keyword arguments of each call, as JSON values.
        folder: folder of the stored results, on this machine. Several processes may use this folder.
        depends: everything else that determines the results, such as the digest of the sources (`digest_of`).
        title: title of the progress bar.
        processes: largest number of new processes on this machine; None: one for each core; 0: compute in this process.
        cluster: address of an existing Ray cluster that runs the calls. "ray": the address in RAY_ADDRESS, or else the
            cluster of this machine.
        seconds: time limit of a call; the start of a process does not count. Not allowed on a cluster;
            without effect if `processes` is 0.
        failed: function that gets the arguments of a failed call and the reason, and returns a replacement for the
            result. The failure is stored, and the call is not repeated.
        done: function that this process calls with each index and result, stored results first.

    Raises:
        JobsFailedError: `failed` is None, and calls failed. The error is raised when all calls have ended.
        DiskFullError: the disk has no room for a result, or for a file that a call writes.
        OSError: `folder` cannot be written; no call has started.
        RuntimeError: no Ray cluster answers at `cluster`, or Ray is not installed.
        TypeError, ValueError: other processes cannot import `function`, or an argument is wrong.
    """
    processes = None if processes is None else whole("processes", processes, at_least=0)
    seconds = None if seconds is None else number("seconds", seconds, "s", above=0.0)
    if cluster and seconds:
        raise ValueError("seconds limits calls on this machine only: give seconds or cluster, not both")
    if cluster:
        workers: Workers = partial(on_cluster, address=cluster)
    else:
        workers = partial(on_this_machine, processes=processes, seconds=seconds)
    given, places = list(arguments), dict[Call, list[int]]()
    for place, each in enumerate(given):
        places.setdefault(_call(function, each, depends), []).append(place)
    results, failures = dict[int, Any](), dict[Call, Failure]()
    answers = _answers(places, Path(folder), failed is not None, workers)
    with closing(progress(title, len(given))) as bar, closing(answers):
        for call, pickled in answers:
            bar.update(len(places[call]))
            for place in places[call]:
                result = pickle.loads(pickled)  # calls with equal arguments each get a copy
                if isinstance(result, Failure):
                    if failed is None:
                        failures[call] = result
                        continue
                    result = failed(given[place], result.reason)
                results[place] = result
                if done:
                    done(place, result)
    if failures:
        raise JobsFailedError(failures, len(given))
    return [results[place] for place in range(len(given))]


def _answers(calls: Iterable[Call], folder: Path, keep_failures: bool, workers: Workers) -> Answers:
    """Yield each call with its pickled result, stored results first; store each new result before yielding it."""
    remove_unfinished(folder)
    missing = []
    for call in calls:
        pickled = _stored(call, folder)
        if pickled is None or (not keep_failures and isinstance(pickle.loads(pickled), Failure)):
            missing.append(call)
        else:
            yield call, pickled
    if missing:  # a folder that cannot be written is an error before the calls, not after them
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    with closing(workers(missing)) as answers:
        for call, pickled in answers:
            if isinstance(answer := pickle.loads(pickled), DiskFullError):
                raise answer
            if keep_failures or not isinstance(answer, Failure):
                write_file(_path(call, folder), bytes.fromhex(checksum(pickled)) + pickled)
            yield call, pickled


def _path(call: Call, folder: Path) -> Path:
    return folder / f"{checksum([call.function, call.arguments, call.depends])}.pkl"


def _stored(call: Call, folder: Path) -> bytes | None:
    """Return the stored result of a call; None: no stored result, or a wrong checksum."""
    path = _path(call, folder)
    content = path.read_bytes() if path.is_file() else None
    if content is None or checksum(content[32:]) == content[:32].hex():
        return content and content[32:]
    stored = f"the stored result of {call.function} {call.arguments[:400]}"
    print(f"computed anew: {stored} in {folder} is damaged", file=sys.stderr)
    return None


def _call(function: Callable[..., Any], arguments: Mapping[str, Any], depends: str) -> Call:
    module, name = function.__module__, function.__qualname__
    if module == "__main__":  # a command runs the module of `function` as a script
        module = getattr(sys.modules["__main__"].__spec__, "name", "")
    if not module or not name.isidentifier():
        raise ValueError(f"other processes cannot import the function {name}: define it at the top level of a module")
    try:
        inspect.signature(function).bind(**arguments)
        return Call(f"{module}:{name}", json.dumps(arguments, sort_keys=True), depends, json.dumps(arguments))
    except TypeError as error:
        raise WrongTypeError(f"arguments of {name} must be keywords it accepts, with JSON values: {error}") from None


def perform(call: Call, versions: Mapping[str, str]) -> bytes:
    """Run a call; return its pickled result, `Failure` or `DiskFullError`. Packages must have the given `versions`."""
    try:
        if (here := {name: version(name) for name in versions}) != versions:
            same = "install the same versions on all nodes"
            raise RuntimeError(f"the node has {here}, the calling process {versions}: {same}")
        with warnings.catch_warnings(action="ignore", category=UserWarning):  # else each call would repeat the warnings
            result = pkgutil.resolve_name(call.function)(**json.loads(call.given or call.arguments))
        return pickle.dumps(result, protocol=5)
    except DiskFullError as error:
        return pickle.dumps(error)
    except (Exception, SystemExit) as error:
        return pickle.dumps(Failure(f"{type(error).__name__}: {error}", traceback.format_exc()))


def on_this_machine(calls: Sequence[Call], processes: int | None, seconds: float | None) -> Answers:
    """Run calls in spawned processes, which inherit no threads or locks; with 0 `processes`, in this process."""
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
            pool.stop()  # type: ignore[no-untyped-call]  # pebble declares no types
            pool.join()


def _begin(function: str) -> None:
    """Import the function in a new worker, and end the worker when the calling process ends."""

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
    sent["working_dir"] = str(origin_of("agents") / "tuned")  # no modules here: nodes import from `py_modules`
    try:
        place = os.environ.get("RAY_ADDRESS", "") if address in ("ray", "auto") else address
        if place and place not in ("ray", "auto"):  # at an address without a cluster, Ray would wait for minutes
            host, _, port = place.removeprefix("ray://").rpartition(":")
            socket.create_connection((host.strip("[]"), int(port)), timeout=10.0).close()
        name = "auto" if address == "ray" else address
        ray.init(name, runtime_env=sent, log_to_driver=False, logging_level=logging.WARNING)
    except (OSError, RuntimeError, ValueError) as error:
        begin = "`ray start --head`, and `ray start --address=HOST:PORT` on each further node"
        raise RuntimeError(f"no Ray cluster at {address!r} ({error}): start one with {begin}") from error
    task: Any = ray.remote(num_cpus=1, max_retries=3)(perform)
    versions = {name: version(name) for name in ("numpy", "scipy")}  # other versions may change a result's last bit
    waiting, under_way = iter(calls), dict[Any, Call]()
    # largest number of calls that the cluster holds at a time, enough to keep all nodes busy
    ahead = 64 + 4 * int(ray.cluster_resources().get("CPU", 0))  # type: ignore[no-untyped-call]
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
        ray.shutdown()  # also ends running calls
