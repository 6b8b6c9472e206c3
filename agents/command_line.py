"""What the commands `impact-gym NAME` share: their arguments, one line for an error or how to continue, progress."""

import io
import multiprocessing
import re
import shlex
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

from impact_gym.files import DiskFullError, writing

if TYPE_CHECKING:
    from tqdm import tqdm

Options = TypeVar("Options")
LINE_EVERY = 30.0  # s, between lines about progress in a log
FORM = "{desc}: {n_fmt} of {total_fmt} after {elapsed}, {remaining} left"


def run_command(
    name: str, options: type[Options], work: Callable[[Options], object], after: str = "the same command continues"
) -> None:
    """Read the command line of `impact-gym NAME` into `options`, a dataclass, and do the work."""
    with command_line(name, after):
        work(read_command(name, options))


def read_command(
    name: str, options: type[Options], arguments: Sequence[str] | None = None, default: Options | None = None
) -> Options:
    """Return the options on a command line: words after `impact-gym NAME`, those of this process unless given.

    The help shows SETUP, NAME, NUMBER and PATH instead of types.
    """
    import tyro  # not needed to play
    from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

    registry, asking = ConstructorRegistry(), list[PrimitiveTypeInfo]()

    @registry.primitive_rule
    def readable(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
        """Read as tyro does, with a plainer word for the value in the help; `asking` stops the recursion."""
        if asking:
            return None
        asking.append(info)
        spec = ConstructorRegistry.get_primitive_spec(info)
        asking.clear()
        if not isinstance(spec, PrimitiveConstructorSpec):
            return None

        def shown(value: Any) -> list[str]:
            return ["none"] if value in (None, ()) else spec.str_from_instance(value)

        return replace(spec, metavar=_plain(spec.metavar), str_from_instance=shown)

    config = (tyro.conf.PositionalMetavarFromFieldName,)
    given: dict[str, Any] = {} if default is None else {"default": default}
    return tyro.cli(options, prog=f"impact-gym {name}", args=arguments, registry=registry, config=config, **given)


def _plain(metavar: str) -> str:
    """Return a plain word for tyro's: "PATH" for "{None}|PATH", "NAME ..." for "[STR [STR ...]]"."""
    metavar = re.sub(r"\[(\w+) \[\1 \.\.\.\]\]", r"\1 ...", metavar.replace("{None}|", ""))
    return re.sub("INT|FLOAT", "NUMBER", metavar.replace("STR", "NAME"))


@contextmanager
def command_line(name: str, after: str = "the same command continues") -> Iterator[None]:
    """Run `impact-gym NAME` with each error of a user, and each warning once, in one line; `after`: how to continue."""
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
    except (OSError, RuntimeError, ValueError) as error:
        sys.exit(f"impact-gym {name}: {error}")
    except KeyboardInterrupt:
        print(f"impact-gym {name}: interrupted; {after}", file=sys.stderr)
        sys.exit(130)


def command_of(name: str, options: Any, default: Any = None, *first: str) -> str:
    """Return the command line `impact-gym NAME ...` that is read into `options`, a dataclass for tyro.

    Options equal to those of `default`, another such dataclass, or to their own defaults are left out. `first` are
    further words before them.
    """
    positional, named = _words(options, default)
    return shlex.join(["impact-gym", name, *first, *positional, *named])


def _words(options: Any, default: Any) -> tuple[list[str], list[str]]:
    """Return the words of positional and of named options; those of a dataclass in another have no prefix."""
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
        elif Positional in getattr(field.type, "__metadata__", ()):  # tyro reads it without its name
            positional += words
        elif isinstance(value, bool) and value != usual:
            named.append(f"--{option}" if value else f"--no-{option}")
        elif value != usual:
            named += [f"--{option}", *words]
    return positional, named


class _Lines(io.TextIOBase):
    """The file of a progress bar in a log: each of its states becomes a line on standard error."""

    def write(self, text: str) -> int:
        if line := text.strip():
            print(line, file=sys.stderr, flush=True)
        return len(text)


def progress(title: str, total: int, begun: int = 0) -> "tqdm[Any]":
    """Return a progress bar, to be updated and closed, with `begun` of `total` steps done.

    On a terminal the main process redraws it; elsewhere it prints a line every 30 s.
    """
    from tqdm import tqdm

    tqdm.set_lock(threading.RLock())  # its own is a semaphore of all processes, which a worker that is ended leaks
    if sys.stderr.isatty() and multiprocessing.parent_process() is None:
        return tqdm(total=total, initial=begun, desc=title, smoothing=0.02)
    lines: Any = {"file": _Lines(), "bar_format": FORM, "mininterval": LINE_EVERY, "delay": LINE_EVERY, "miniters": 1}
    return tqdm(total=total, initial=begun, desc=title, smoothing=0.02, **lines)
