"""The clock of a film: a quarter of life's speed in flight, slower around contacts, so slow in them that they show."""

import itertools
from collections.abc import Sequence

FLIGHT = 4  # times slower than life
LONG_FLIGHT = 1.0  # s, a flight longer than this runs at life's speed
AROUND = 40  # times slower, at the most, just before and after a contact
MARGIN = 0.01  # s, how long that is
LEVELS = (10, 20, 40, 100, 200, 400, 1000)  # times slower, in a contact
SHOWN = 1.2  # s of film that a contact fills at least
MANY = 6  # contacts; if there are more, each gets a smaller share of film


def clock(contacts: Sequence[tuple[float, float]], end: float) -> list[list[float]]:
    """Return [start (s), times slower than life] of each stretch of the film until `end` (s)."""
    share = min(1.0, MANY / max(len(contacts), 1))
    shown, margin = share * SHOWN, share * MARGIN
    windows: list[tuple[float, float, int]] = []
    for start, stop in contacts:
        length = max(stop - start, 1e-7)
        level = next((level for level in LEVELS if level * length >= shown), LEVELS[-1])
        windows.append((start - 0.15 * length, stop + 0.15 * length, level))
        windows.append((start - margin, stop + margin, min(level, AROUND)))
    edges = {0.0, end, *(edge for window in windows for edge in window[:2])}
    bounds = sorted(edge for edge in edges if 0.0 <= edge <= end)
    stretches: list[list[float]] = []
    for start, stop in itertools.pairwise(bounds):
        middle = 0.5 * (start + stop)
        inside = [slower for first, last, slower in windows if first <= middle <= last]
        slower = max(inside, default=1 if stop - start > LONG_FLIGHT else FLIGHT)
        if not stretches or stretches[-1][1] != slower:
            stretches.append([round(start, 7), slower])
    return stretches
