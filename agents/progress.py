"""How far something is: a bar that a terminal redraws, or now and then a line in a log."""

import io
import multiprocessing
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tqdm import tqdm

LINE_EVERY = 30.0  # s
FORM = "{desc}: {n_fmt} of {total_fmt} after {elapsed}, {remaining} left"


class _Lines(io.TextIOBase):
    """Where a bar writes that nobody redraws: each of its states becomes a line on standard error."""

    def write(self, text: str) -> int:
        if line := text.strip():
            print(line, file=sys.stderr, flush=True)
        return len(text)


def progress(title: str, total: int, begun: int = 0) -> "tqdm[Any]":
    """Return the progress of `title`, to be updated and closed: `begun` of `total` steps are done.

    The main process redraws a bar where standard error is a terminal. Anything else gets a line every 30 s, and one at
    the end of what took as long.
    """
    from tqdm import tqdm

    if sys.stderr.isatty() and multiprocessing.parent_process() is None:
        return tqdm(total=total, initial=begun, desc=title, smoothing=0.02)
    lines: Any = {"file": _Lines(), "bar_format": FORM, "mininterval": LINE_EVERY, "delay": LINE_EVERY, "miniters": 1}
    return tqdm(total=total, initial=begun, desc=title, smoothing=0.02, **lines)
