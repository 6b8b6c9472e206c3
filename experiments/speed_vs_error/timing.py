"""Timing in rounds: the contenders take turns, and each keeps its best round."""

import math
from collections.abc import Sequence
from contextlib import suppress

from tqdm import tqdm

from experiments.speed_vs_error.contenders import Contender

LEAST = 5e-3  # s, in a round, so that the clock's grain does not matter
SLOW = 0.2  # s, of a call that is made in the first round only


def best_times(contenders: Sequence[Contender], rounds: int, title: str | None) -> dict[Contender, float]:
    """Return seconds per call, the best of `rounds` rounds in which every contender has its turn.

    What fails is given inf. A first call says how many calls make a round; it is a round where one does. Whatever has
    to be compiled or loaded is so by an earlier call of the first contender, which does not count.
    """
    calls: dict[Contender, int] = {}
    best: dict[Contender, float] = {}
    with suppress(Exception):  # `solve` says why
        contenders[0].seconds(1)
    for turn in tqdm(range(rounds), desc=title, leave=False, disable=title is None):
        for contender in contenders:
            if turn == 0:
                try:
                    once = contender.seconds(1)
                except Exception:  # likewise
                    once = math.inf
                best[contender], calls[contender] = once, math.ceil(min(LEAST / max(once, 1e-9), 1e4))
                if calls[contender] == 1:
                    continue
            if best[contender] < SLOW:
                best[contender] = min(best[contender], contender.seconds(calls[contender]))
    return best
