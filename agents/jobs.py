"""Independent calls in parallel, on this machine or a Ray cluster; results are stored, with the same bits everywhere.

`cached` calls a function for each of many arguments. The calling process stores each result as soon as it is there: a
command that was stopped, even killed, continues when it is run again, and the nodes of a cluster need no common disk.
joblib.Memory stores. pebble's pool of processes ends a late call, and reports a lost process for its call alone.
Stored results are pickles: give `cached` no folder but one that it wrote itself, for the same user.
"""

import hashlib
import inspect
import json
import pickle
import sys
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from agents.command_line import progress
from agents.workers import Answers, Call, Failure, on_cluster, on_this_machine
from impact_gym.files import DiskFullError, writing
from impact_gym.validation import WrongTypeError, number, whole

Workers = Callable[[Sequence[Call]], Answers]
SHOWN = 10  # failed calls that an error names one by one


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
    """Return `function(**each)` for each of `arguments`, in their order; results in `folder` are not computed again.

    Args:
        function: at the top level of a module that can be imported; its result can be pickled.
        arguments: mappings of keywords to what JSON holds.
        folder: of the stored results, on this machine. Several processes may use it.
        depends: what else determines the results, such as `digest_of` their sources.
        title: of the progress.
        processes: how many on this machine, started fresh; None: one for each core; 0: none but this process.
        cluster: an existing Ray cluster instead: "ray" for the one of this machine (or of RAY_ADDRESS), or an address.
        seconds: longest time of a call by the clock, beside the start of its process; a longer one fails, and its
            process is ended. Not on a cluster; without effect with `processes` 0.
        failed: returns what stands for the result of a failed call, from its arguments and the reason. The failure is
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
    if cluster:
        workers: Workers = partial(on_cluster, address=cluster)
    else:
        workers = partial(on_this_machine, processes=processes, seconds=seconds)
    given, places = list(arguments), dict[Call, list[int]]()
    for place, each in enumerate(given):
        places.setdefault(_call(function, each, depends), []).append(place)
    results, failures = dict[int, Any](), dict[Call, Failure]()
    answers = _answers(places, _Store(Path(folder)), failed is not None, workers)
    with closing(progress(title, len(given))) as bar, closing(answers):
        for call, pickled in answers:
            bar.update(len(places[call]))
            for place in places[call]:
                result = pickle.loads(pickled)  # a copy for each place
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


def _answers(calls: Iterable[Call], store: "_Store", keep_failures: bool, workers: Workers) -> Answers:
    """Yield each call with its pickled result, stored ones first; new results are stored as they come."""
    missing = []
    for call in calls:
        pickled = store.read(call)
        if pickled is None or (not keep_failures and isinstance(pickle.loads(pickled), Failure)):
            missing.append(call)
        else:
            yield call, pickled
    with closing(workers(missing)) as answers:
        for call, pickled in answers:
            if isinstance(answer := pickle.loads(pickled), DiskFullError):
                raise answer
            if keep_failures or not isinstance(answer, Failure):
                store.write(call, pickled)
            yield call, pickled


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


class _Store:
    """Pickled results in a folder, as joblib.Memory keeps them, each with its checksum."""

    def __init__(self, folder: Path) -> None:
        import joblib

        self._folder, self._kept = folder, joblib.Memory(folder, verbose=0).cache(_kept, ignore=["answer"])
        # where its source is not stored, joblib finds nothing at first
        self._kept.check_call_in_cache("", "", "", None)

    def read(self, call: Call) -> bytes | None:
        """Return the stored result of a call; None if there is none, or it is damaged."""
        try:
            found = self._kept.call_and_shelve(*call.key, None)
        except LookupError:
            return None
        with suppress(Exception):  # any error of reading a damaged file
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
    """Return the answer to store; joblib.Memory calls this without one if none is stored."""
    if answer is None:
        raise LookupError(function, arguments, depends)
    return answer
