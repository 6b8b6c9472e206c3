"""Run independent calls in parallel, on this machine or on a Ray cluster, and store their results.

A result has the same bits wherever it is computed. The process that calls `cached` stores each result in a file as soon
as it arrives. So a command that was stopped or killed continues when it is run again, and the nodes of a cluster need
no common disk. Stored results are pickles, and reading a pickle can run code: give `cached` only a folder that only
you can write to.
"""

import hashlib
import inspect
import json
import os
import pickle
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from agents.command_line import progress
from agents.workers import Answers, Call, Failure, on_cluster, on_this_machine
from impact_gym.files import DiskFullError, writing
from impact_gym.validation import WrongTypeError, number, whole

Workers = Callable[[Sequence[Call]], Answers]
SHOWN = 10  # number of failed calls that the error lists


class JobsFailedError(RuntimeError):
    """Some calls failed; the results of all others are stored."""

    def __init__(self, failed: Mapping[Call, Failure], count: int) -> None:
        self.failed = failed
        lines = [f"{len(failed)} of {count} jobs failed (the others are done and kept):"]
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
        folder: folder of the stored results, on this machine. Several processes may use it at once.
        depends: everything else that determines the results, such as `digest_of` the sources.
        title: title of the progress bar.
        processes: number of new processes on this machine; None: one for each core; 0: compute in this process.
        cluster: existing Ray cluster to use instead: "ray" for the one of this machine (or of RAY_ADDRESS), or an
            address.
        seconds: time limit of a call by the clock, without the start of its process. A call that exceeds it fails.
            Not allowed on a cluster; without effect if `processes` is 0.
        failed: function that gets the arguments of a failed call and the reason, and returns a replacement for the
            result. The failure is stored, and the call is not repeated.
        done: function that this process calls with index and result of each call, stored results first.

    Raises:
        JobsFailedError: `failed` is None, and calls failed. It is raised after all other calls.
        DiskFullError: the disk has no room for a result, or for a file that a call writes.
        RuntimeError: there is no such cluster, or Ray is not installed.
        TypeError, ValueError: other processes cannot import the function, or it does not take the arguments.
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
    missing = []
    for call in calls:
        pickled = _stored(call, folder)
        if pickled is None or (not keep_failures and isinstance(pickle.loads(pickled), Failure)):
            missing.append(call)
        else:
            yield call, pickled
    with closing(workers(missing)) as answers:
        for call, pickled in answers:
            if isinstance(answer := pickle.loads(pickled), DiskFullError):
                raise answer
            if keep_failures or not isinstance(answer, Failure):
                path = _path(call, folder)
                part = path.with_suffix(f".{os.getpid()}")
                with writing(str(path)):
                    folder.mkdir(parents=True, exist_ok=True)
                    part.write_bytes(hashlib.sha256(pickled).digest() + pickled)
                    part.replace(path)
            yield call, pickled


def _path(call: Call, folder: Path) -> Path:
    key = json.dumps([call.function, call.arguments, call.depends])
    return folder / f"{hashlib.sha256(key.encode()).hexdigest()}.pkl"


def _stored(call: Call, folder: Path) -> bytes | None:
    """Return the stored result of a call; None if there is none, or its checksum is wrong."""
    path = _path(call, folder)
    content = path.read_bytes() if path.is_file() else None
    if content is None or hashlib.sha256(content[32:]).digest() == content[:32]:
        return content and content[32:]
    stored = f"the stored result of {call.function} {call.arguments[:400]}"
    print(f"computed anew: {stored} in {folder} is damaged", file=sys.stderr)
    return None


def _call(function: Callable[..., Any], arguments: Mapping[str, Any], depends: str) -> Call:
    """Return the `Call` of a function, which other processes must be able to import, with JSON arguments."""
    module, name = function.__module__, function.__qualname__
    if module == "__main__":  # a command runs a module as a script
        module = getattr(sys.modules["__main__"].__spec__, "name", "")
    if not module or not name.isidentifier():
        raise ValueError(f"other processes cannot import the function {name}: put it into a module, at its top level")
    try:
        inspect.signature(function).bind(**arguments)
        return Call(f"{module}:{name}", json.dumps(arguments, sort_keys=True), depends, json.dumps(arguments))
    except TypeError as error:
        raise WrongTypeError(f"arguments of {name} must be its keywords, with JSON values: {error}") from None
