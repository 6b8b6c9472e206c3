"""Share a loop over rows among threads; compiled loops release the interpreter lock."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

CORES = os.cpu_count() or 1  # default number of threads
_pools: dict[int, ThreadPoolExecutor] = {}


def over_rows(run: Callable[[int, int], object], rows: int, threads: int, smallest: int) -> None:
    """Call `run(first, last)` in up to `threads` threads; if there are several, each gets at least `smallest` rows."""
    if (pieces := min(threads, rows // smallest)) < 2:
        run(0, rows)
        return
    (first, last), *others = pairwise(rows * piece // pieces for piece in range(pieces + 1))
    if os.getpid() not in _pools:  # a forked child makes its own pool
        _pools.clear()
        _pools[os.getpid()] = ThreadPoolExecutor(CORES, thread_name_prefix="impact_gym")
    submitted = [_pools[os.getpid()].submit(run, *other) for other in others]
    run(first, last)
    for piece in submitted:
        piece.result()
