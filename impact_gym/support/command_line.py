"""Functions that the commands `impact-gym NAME` share."""

import io
import multiprocessing
import os
import shlex
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from impact_gym.support.files import DiskFullError, writing

if TYPE_CHECKING:
    from tqdm import tqdm

Options = TypeVar("Options")
LINE_EVERY = 30.0  # s, shortest time between two lines of progress in a log
FORM = "{desc}: {n_fmt} of {total_fmt} after {elapsed}, {remaining} left"
READER_ENDED = 141  # exit code of a program that SIGPIPE ended, 128 + 13


def run_command(
    name: str, options: type[Options], work: Callable[[Options], object], after: str = "the same command continues"
) -> None:
    """Read the command line of `impact-gym NAME` into the dataclass `options`, and call `work` with it."""
    with until_reader_ends(), command_line(name, after):
        work(read_command(name, options))


@contextmanager
def until_reader_ends() -> Iterator[None]:
    """Exit without a message if the reader of standard output, such as `head`, has ended."""
    try:
        try:
            yield
        finally:
            if sys.stdout is not None:  # None if standard output is closed, as by `>&-`
                sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what Python writes when it ends
        sys.exit(READER_ENDED)


def read_command(
    name: str, options: type[Options], arguments: Sequence[str] | None = None, default: Options | None = None
) -> Options:
    """Return the options in `arguments`; None: the arguments of this process.

    `default` replaces the default values of the dataclass.
    """
    import tyro  # imported here, because `progress` does not need tyro

    config = (tyro.conf.PositionalMetavarFromFieldName,)
    given: dict[str, Any] = {} if default is None else {"default": default}
    return tyro.cli(options, prog=f"impact-gym {name}", args=arguments, config=config, **given)


@contextmanager
def command_line(name: str, after: str = "the same command continues") -> Iterator[None]:
    """Exit with the message of an expected error; print each warning once. `after` says how to resume."""
    said = set[str]()

    def show(message: Warning | str, *_: object, **__: object) -> None:
        if (text := str(message)) not in said:
            said.add(text)
            print(f"impact-gym {name}: warning: {text}", file=sys.stderr)

    try:
        with warnings.catch_warnings(), writing("a file"):
            warnings.showwarning = show
            yield
    except DiskFullError as error:
        sys.exit(f"impact-gym {name}: {error}; make room: {after}")
    except BrokenPipeError:  # the reader of standard output has ended, see `until_reader_ends`
        raise
    except (OSError, RuntimeError, ValueError) as error:
        sys.exit(f"impact-gym {name}: {error}")
    except ModuleNotFoundError as error:
        sys.exit(f"impact-gym {name}: {error}: run make setup, or pip install 'impact-gym[all]'")
    except KeyboardInterrupt:
        print(f"impact-gym {name}: interrupted; {after}", file=sys.stderr)
        sys.exit(130)


def command_of(name: str, options: Any, default: Any = None, *first: str) -> str:
    """Return the command line `impact-gym NAME ...` from which `read_command` reads `options`.

    A named option is left out if its value equals that in `default` (None: the default of the dataclass). The words in
    `first` come before the options.
    """
    positional, named = _words(options, default)
    return shlex.join(["impact-gym", name, *first, *positional, *named])


def _words(options: Any, default: Any) -> tuple[list[str], list[str]]:
    from tyro.conf import Positional

    positional, named = [], []
    for field in fields(options):
        value = getattr(options, field.name)
        usual = field.default if field.default_factory is MISSING else field.default_factory()
        usual = usual if default is None else getattr(default, field.name)
        words = [str(each) for each in (value if isinstance(value, tuple) else (value,))]
        option = field.name.replace("_", "-")
        if is_dataclass(value):
            named += _words(value, usual)[1]
        elif Positional in getattr(field.type, "__metadata__", ()):  # an option without a name
            positional += words
        elif isinstance(value, bool) and value != usual:
            named.append(f"--{option}" if value else f"--no-{option}")
        elif value != usual:
            named += [f"--{option}", *words]
    return positional, named


class _Lines(io.TextIOBase):
    """A file for tqdm: it prints each state of the progress bar as a line on standard error."""

    def write(self, text: str) -> int:
        if line := text.strip():
            print(line, file=sys.stderr, flush=True)
        return len(text)


def progress(title: str, total: int, begun: int = 0) -> "tqdm[Any]":
    """Return a progress bar with `begun` of `total` steps done; the caller updates and closes it.

    On a terminal, the main process redraws the bar. Elsewhere, an update prints a line, at most every 30 s.
    """
    from tqdm import std, tqdm

    std.time = time.monotonic  # the clock that tqdm takes can go back
    tqdm.set_lock(threading.RLock())  # tqdm's own lock leaks a semaphore when a worker is killed
    if sys.stderr.isatty() and multiprocessing.parent_process() is None:
        return tqdm(total=total, initial=begun, desc=title, smoothing=0.02)
    lines: Any = {"file": _Lines(), "bar_format": FORM, "mininterval": LINE_EVERY, "delay": LINE_EVERY, "miniters": 1}
    return tqdm(total=total, initial=begun, desc=title, smoothing=0.02, **lines)
