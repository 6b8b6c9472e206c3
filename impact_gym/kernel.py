"""How this package compiles: one decorator, one choice by coupling type, one notice.

numba's on-disk cache is stamped with the date of the file a function stands in, so a kernel would outlive a change in a
law that it calls from another file. Here the stamp is a digest of the package's sources.
"""

import functools
import hashlib
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import event
from numba.extending import overload

_PACKAGE = Path(__file__).parent
_NO_KERNELS = ("doctor", "render", "sb3")  # files that kernels read nothing from: a change there compiles nothing anew
_NOTICE_AFTER = 1.0  # s; a cached kernel loads faster than this

Function = TypeVar("Function", bound=Callable[..., Any])


@functools.cache
def _digest() -> str:
    digest = hashlib.sha256()
    for source in sorted(_PACKAGE.rglob("*.py")):
        if not source.name.startswith(_NO_KERNELS):
            digest.update(source.read_bytes())
    return digest.hexdigest()


def require_compiled() -> None:
    """Refuse to run where numba was told not to compile: the kernels read records that Python cannot.

    Raises:
        RuntimeError: NUMBA_DISABLE_JIT is set.
    """
    settings: Any = numba.config
    if settings.DISABLE_JIT:
        raise RuntimeError("NUMBA_DISABLE_JIT is set, but the kernels only work compiled: unset it")


def kernel(function: Function) -> Function:
    """Compile `function` on first use, keep it on disk, release the interpreter lock while it runs.

    Division by zero gives inf or nan as in IEEE 754, not an exception: failures travel as a status.
    """
    return _compiled(function)


def inner_kernel(function: Function) -> Function:
    """Do as `kernel` does for what only kernels call.

    numba then leaves out the wrappers for Python and C, which take a third of the time that compiling takes.
    """
    return _compiled(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def _compiled(function: Function, **options: bool) -> Function:
    njit: Any = numba.njit  # whose types do not know of the wrappers
    dispatcher = njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    if dispatcher is not function:  # as it is under NUMBA_DISABLE_JIT
        file = dispatcher._cache._cache_file  # private, and watched over by tests/test_kernel.py
        file._source_stamp = _digest()
        file._load_index = _readable(file._load_index)
    return cast(Function, dispatcher)


def _readable(load_index: Callable[[], dict[Any, Any]]) -> Callable[[], dict[Any, Any]]:
    """Take an index for empty that names records these sources no longer have: numba unpickles before it compares."""

    def load() -> dict[Any, Any]:
        try:
            return load_index()
        except (AttributeError, ImportError):
            return {}

    return load


def by_type(implementations: Mapping[type, Callable[..., Any]]) -> Callable[..., Any]:
    """Return a kernel that picks the implementation for the type of its first argument, at compile time.

    The first argument is one of the NamedTuples in `implementations`; only what a scene needs is compiled.
    """

    def choose(first: Any, *rest: Any) -> Any:
        return implementations[type(first)](first, *rest)

    @overload(choose, inline="never")
    def _choose(first: Any, *rest: Any) -> Any:
        chosen = implementations[first.instance_class]

        def call(first: Any, *rest: Any) -> Any:
            return chosen(first, *rest)

        return call

    return choose


class _CompileNotice(event.Listener):
    """Says once, on stderr, that kernels are being compiled, if that takes longer than a second."""

    def __init__(self) -> None:
        self._depth = 0
        self._timer: threading.Timer | None = None
        self._said = False

    @staticmethod
    def _ours(event: Any) -> bool:
        return (event.data["dispatcher"].py_func.__module__ or "").startswith("impact_gym.")

    def on_start(self, event: Any) -> None:
        if not self._ours(event):
            return
        self._depth += 1
        if self._depth == 1 and not self._said:
            self._timer = threading.Timer(_NOTICE_AFTER, self._say)
            self._timer.daemon = True
            self._timer.start()

    def on_end(self, event: Any) -> None:
        if not self._ours(event):
            return
        self._depth -= 1
        if self._depth == 0 and self._timer is not None:
            self._timer.cancel()

    def _say(self) -> None:
        self._said = True
        print("impact_gym: compiling the solver for this machine (once, a few seconds; then cached)", file=sys.stderr)


event.register("numba:compile", _CompileNotice())  # type: ignore[no-untyped-call]  # untyped in numba
