"""What the commands share: each is called `impact-gym NAME`, and one line says what went wrong or how to continue."""

import re
import shlex
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass, replace
from typing import Any, TypeVar

from impact_gym.files import DiskFullError, writing

Options = TypeVar("Options")


def run_command(
    name: str, options: type[Options], work: Callable[[Options], object], after: str = "the same command continues"
) -> None:
    """Read the command line of `impact-gym NAME` into `options`, a dataclass, and do the work."""
    with command_line(name, after):
        work(read_command(name, options))


def read_command(
    name: str, options: type[Options], arguments: Sequence[str] | None = None, default: Options | None = None
) -> Options:
    """Return what a command line asks for: words after `impact-gym NAME`, those of this process unless given.

    The help says SETUP, NAME, NUMBER and PATH for what stands where, instead of types.
    """
    import tyro  # whoever only plays has no need of it
    from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

    registry, asking = ConstructorRegistry(), list[PrimitiveTypeInfo]()

    @registry.primitive_rule
    def readable(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
        """Read as tyro does, which is asked while this rule looks away, but say plainly what."""
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
    """Return a word for what a value is, such as "PATH" for "{None}|PATH" and "NAME ..." for "[STR [STR ...]]"."""
    metavar = re.sub(r"\[(\w+) \[\1 \.\.\.\]\]", r"\1 ...", metavar.replace("{None}|", ""))
    return re.sub("INT|FLOAT", "NUMBER", metavar.replace("STR", "NAME"))


@contextmanager
def command_line(name: str, after: str = "the same command continues") -> Iterator[None]:
    """Run `impact-gym NAME`; an error that a user can mend is one line. `after` says how to go on once it stopped.

    So is a warning, which is printed once.
    """
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

    Options are left out where they are those of `default`, another one, or else their own defaults. What is not among
    them stands `first`.
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
