"""Independent calls in parallel, on this machine or a Ray cluster; results are stored, with the same bits everywhere.

`cached` calls a function for each of many arguments. The calling process stores each result as soon as it is there: a
command that was stopped, even killed, continues when it is run again, and the nodes of a cluster need no common disk.
joblib.Memory stores. pebble's pool of processes ends a late call, and reports a lost process for its call alone.

joblib's own ways to run calls were measured and not taken. Its pool, loky, starts in 2.6 s (pebble: 0.9 s), and one
lost process ends all calls. Its Ray backend returns no result before all calls are done: a killed command would have
stored none. Stored results are pickles: give `cached` no folder but one that it wrote itself, for the same user.
"""

import hashlib
import inspect
import json
import logging
import multiprocessing
import os
import pickle
import pkgutil
import socket
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import as_completed
from contextlib import closing, suppress
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from agents.progress import progress
from agents.provenance import digest_of as digest_of
from agents.provenance import origin_of
from impact_gym.files import DiskFullError, writing
from impact_gym.validation import WrongTypeError, number, whole

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment of every worker: each has one core, and no sum is split by how many cores there are."""
SHOWN = 10  # failed calls that an error names one by one


class Failure(NamedTuple):
    """Why a call has no result."""

    reason: str
    trace: str = ""  # where the function raised


@dataclass(frozen=True)
class Call:
    """What determines a result: the function "module:name", its arguments as JSON, and what else it depends on."""

    function: str
    arguments: str  # their keys sorted
    depends: str
    given: str = field(default="", compare=False)  # in the order in which the function gets them

    @property
    def key(self) -> tuple[str, str, str]:
        """What a result is stored by."""
        return self.function, self.arguments, self.depends


Answers = Generator[tuple[Call, bytes], None, None]  # as they come: result, `Failure` or `DiskFullError`, pickled


class JobsFailedError(RuntimeError):
    """Calls have no result; the results of the others are stored."""

    def __init__(self, failed: Mapping[Call, Failure], count: int) -> None:
        self.failed = failed
        lines = [f"{len(failed)} of {count} jobs failed (the others are done and kept):"]
        lines += [
            f"{call.function} {call.arguments[:400]}: {failure.reason}"
            for call, failure in islice(failed.items(), SHOWN)
        ]
        lines += [f"and {len(failed) - SHOWN} more"] if len(failed) > SHOWN else []
        lines += [f"the first of these raised:\n{failure.trace}" for failure in failed.values() if failure.trace][:1]
        super().__init__("\n".join(lines))


def cached(
    function: Callable[..., Any], arguments: Iterable[Mapping[str, Any]], folder: Path | str, *,
    depends: str = "", title: str = "jobs", processes: int | None = None, cluster: str | None = None,
    seconds: float | None = None, failed: Callable[[Mapping[str, Any], str], Any] | None = None,
    done: Callable[[int, Any], object] | None = None,
) -> list[Any]:  # fmt: skip
    """Return `function(**each)` for each of `arguments`, computed once if it is not whole in `folder`, in their order.

    Args:
        function: one at the top level of a module that can be imported; what it returns can be pickled.
        arguments: mappings of keywords to what JSON holds.
        folder: of the stored results, on this machine. Several processes may use it.
        depends: what else determines the results, such as `digest_of` their sources.
        title: of the progress.
        processes: how many on this machine, started fresh; None: one for each core; 0: none but this process.
        cluster: an existing Ray cluster instead: "ray" for the one of this machine (or of RAY_ADDRESS), or an address.
        seconds: how long a call may take by the clock; a later one fails, and its process is ended. Starting a process
            and importing the function do not count. Not on a cluster; with `processes` 0 nothing can end a call.
        failed: given the arguments and the reason, returns what stands for the result of a failed call. The failure is
            stored, and the call not repeated.
        done: called in this process with the place and the result of each call, stored ones first.

    Raises:
        JobsFailedError: without `failed`, once all others are done: calls raised, took too long or lost their process.
        DiskFullError: there is no room for a result, or a call found none for its files.
        RuntimeError: there is no such cluster, or Ray is not installed.
        TypeError, ValueError: a function that other processes cannot import, or arguments that it does not take.
    """
    processes = None if processes is None else whole("processes", processes, at_least=0)
    seconds = None if seconds is None else number("seconds", seconds, "s", above=0.0)
    if cluster and seconds:
        raise ValueError("seconds: only processes of this machine are ended: give seconds or cluster, not both")
    engine = partial(_on_cluster, address=cluster) if cluster else partial(_here, processes=processes, seconds=seconds)
    given, places, store = list(arguments), dict[Call, list[int]](), _Store(Path(folder))
    for place, each in enumerate(given):
        places.setdefault(_call(function, each, depends), []).append(place)
    results, missing = dict[int, Any](), list[Call]()

    def settle(call: Call, pickled: bytes) -> None:
        """Put a result, or what stands for it, in all places of a call, in each a copy."""
        bar.update(len(places[call]))
        for place in places[call]:
            result = pickle.loads(pickled)
            results[place] = failed(given[place], result.reason) if failed and isinstance(result, Failure) else result
            if done and not isinstance(results[place], Failure):
                done(place, results[place])

    with closing(progress(title, len(given))) as bar:
        for call in places:
            pickled = store.read(call)
            if pickled is None or (not failed and isinstance(pickle.loads(pickled), Failure)):
                missing.append(call)
            else:
                settle(call, pickled)
        with closing(engine(missing) if missing else _here([], 0, None)) as answers:
            for call, pickled in answers:
                if isinstance(answer := pickle.loads(pickled), DiskFullError):
                    raise answer
                if failed or not isinstance(answer, Failure):
                    store.write(call, pickled)
                settle(call, pickled)
    if without := {call: results[same[0]] for call, same in places.items() if isinstance(results[same[0]], Failure)}:
        raise JobsFailedError(without, len(given))
    return [results[place] for place in range(len(given))]


def _call(function: Callable[..., Any], arguments: Mapping[str, Any], depends: str) -> Call:
    """Return the call of a function that any process can import, with arguments that it takes and JSON holds."""
    module, name = function.__module__, function.__qualname__
    if module == "__main__":  # a command is a module that runs
        module = getattr(sys.modules["__main__"].__spec__, "name", "")
    if not module or not name.isidentifier():
        raise ValueError(f"function {name} is not importable elsewhere: put it into a module, at its top level")
    try:
        inspect.signature(function).bind(**arguments)
        return Call(f"{module}:{name}", json.dumps(arguments, sort_keys=True), depends, json.dumps(arguments))
    except TypeError as error:
        raise WrongTypeError(f"arguments of {name} must be keywords that it takes, as JSON has them: {error}") from None


def perform(call: Call, versions: Mapping[str, str]) -> bytes:
    """Do a call where these packages have these versions. A full disk is no failure of the call: it ends all."""
    try:
        if (here := {name: version(name) for name in versions}) != versions:
            raise RuntimeError(f"the node has {here}, the calling process {versions}: install the same on all")
        return pickle.dumps(pkgutil.resolve_name(call.function)(**json.loads(call.given or call.arguments)), protocol=5)
    except DiskFullError as error:
        return pickle.dumps(error)
    except (Exception, SystemExit) as error:
        return pickle.dumps(Failure(f"{type(error).__name__}: {error}", traceback.format_exc()))


def _here(calls: Sequence[Call], processes: int | None, seconds: float | None) -> Answers:
    """Do calls in so many processes of this machine, each started fresh: a fork would inherit threads and locks."""
    from unittest.mock import patch

    from pebble import ProcessExpired, ProcessPool

    if processes == 0:
        yield from ((call, perform(call, {})) for call in calls)
        return
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
                    pickled = pickle.dumps(
                        Failure(f"its process was lost, with exit code {error.exitcode} (out of memory?)")
                    )
                except Exception as error:
                    reason = f"no process began, as in a script without `if __name__ == '__main__'`: {error}"
                    pickled = pickle.dumps(Failure(reason))
                yield under_way.pop(future), pickled
        finally:
            pool.stop()  # type: ignore[no-untyped-call]  # pebble's own
            pool.join()


def _begin(function: str) -> None:
    """Prepare a process: it ends when the calling one does, however that ends, and has the function imported."""

    def end_with_parent() -> None:
        if parent := multiprocessing.parent_process():
            parent.join()
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    pkgutil.resolve_name(function)


def _on_cluster(calls: Sequence[Call], address: str) -> Answers:
    """Do calls on a Ray cluster, a core for each, with the sources here; Ray repeats calls whose node was lost."""
    try:
        import ray
        import ray.exceptions
    except ImportError as error:
        raise RuntimeError("Ray is not installed: install the extra `cluster`, here and on all nodes") from error
    sources = {"agents", "impact_gym", calls[0].function.replace(":", ".").split(".")[0]}
    sent: dict[str, Any] = {"py_modules": [str(origin_of(name)) for name in sorted(sources)], "env_vars": ONE_THREAD}
    sent["working_dir"] = str(
        origin_of("agents") / "tuned"
    )  # no modules; without it, nodes look where this process does
    try:
        _listens(address)
        name = "auto" if address == "ray" else address
        ray.init(name, runtime_env=sent, log_to_driver=False, logging_level=logging.WARNING)
    except (OSError, RuntimeError, ValueError) as error:
        begin = "`ray start --head`, and `ray start --address=HOST:PORT` on each further node"
        raise RuntimeError(f"no Ray cluster at {address!r} ({error}): start one with {begin}") from error
    task: Any = ray.remote(num_cpus=1, max_retries=3)(perform)
    versions = {name: version(name) for name in ("numpy", "scipy")}  # which may show in the last bit of a result
    waiting, under_way = iter(calls), dict[Any, Call]()
    ahead = 64 + 4 * int(ray.cluster_resources().get("CPU", 0))  # type: ignore[no-untyped-call]  # so that no node waits
    try:
        while True:
            under_way |= {task.remote(call, versions): call for call in islice(waiting, ahead - len(under_way))}
            if not under_way:
                return
            ready = ray.wait([*under_way])[0][0]
            try:
                pickled = ray.get(ready)
            except ray.exceptions.RayError as error:
                pickled = pickle.dumps(Failure(f"its process was lost, or could not begin: {error}"))
            yield under_way.pop(ready), pickled
    finally:
        ray.shutdown()  # which ends what is under way


def _listens(address: str) -> None:
    """Raise OSError or ValueError where nobody listens at the address: Ray itself keeps asking for minutes."""
    place = os.environ.get("RAY_ADDRESS", "") if address in ("ray", "auto") else address
    if place and place not in ("ray", "auto"):
        host, _, port = place.removeprefix("ray://").rpartition(":")
        socket.create_connection((host.strip("[]"), int(port)), timeout=10.0).close()


class _Store:
    """Pickled results in a folder, as joblib.Memory keeps them, each with its checksum."""

    def __init__(self, folder: Path) -> None:
        import joblib

        self._folder, self._kept = folder, joblib.Memory(folder, verbose=0).cache(_kept, ignore=["answer"])
        # where its source is not stored, joblib finds nothing at first
        self._kept.check_call_in_cache("", "", "", None)

    def read(self, call: Call) -> bytes | None:
        """Return what is stored of a call; None: nothing is, or it is damaged."""
        try:
            found = self._kept.call_and_shelve(*call.key, None)
        except LookupError:
            return None
        with suppress(Exception):  # whatever reading raises where something else was written
            digest, pickled = found.get()
            if digest == hashlib.sha256(pickled).digest():
                return pickled
        print(f"computed anew: {call.function} {call.arguments[:400]} is damaged in {self._folder}", file=sys.stderr)
        return None

    def write(self, call: Call, pickled: bytes) -> None:
        """Store a result, whole or not at all."""
        from joblib.memory import CacheWarning

        with writing(f"a result of {call.function} into {self._folder}"), warnings.catch_warnings():
            warnings.simplefilter("error", CacheWarning)  # which is all that joblib makes of a full disk
            try:
                self._kept.call(*call.key, (hashlib.sha256(pickled).digest(), pickled))
            except CacheWarning as warning:
                raise warning.__context__ or warning from None


def _kept(function: str, arguments: str, depends: str, answer: Any) -> Any:
    """Return the answer to store; there is none where joblib.Memory finds none stored, and asks for it."""
    if answer is None:
        raise LookupError(function, arguments, depends)
    return answer
