"""What the commands have in common: one line says what went wrong, or how to go on."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def command_line(name: str, after: str = "the same command goes on") -> Iterator[None]:
    """Run the command `name`; an error that a user can mend is one line, and `after` follows an interruption."""
    try:
        yield
    except (OSError, RuntimeError, ValueError) as error:
        sys.exit(f"{name}: {error}")
    except KeyboardInterrupt:
        print(f"{name}: interrupted; {after}", file=sys.stderr)
        sys.exit(130)
