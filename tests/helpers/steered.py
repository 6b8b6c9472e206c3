"""Batches whose flanges an operator steers."""

import numpy as np
from impact_gym.kernels import PACKET

from impact_gym.envs.batch import Batch
from impact_gym.task import Task

ID, ARM = "ImpactTeleop-v0", {"friction": 0.3, "horizon": 8.0, "velocity_range": (-0.3, 0.5)}
OWN, STOP, GENTLE = [1.0, 1.0, -1.0], [-1.0, 1.0, -1.0], [1.0, 2.0 * (8.0 - 1.0) / 19.0 - 1.0, -1.0]
AWAY = {"distance": 0.79}


def steered(operator, rows=1, **options):
    return Batch(rows, Task(**ARM | {"operator": operator} | options), threads=1)


def played(batch, action, seed=0, steps=10_000):
    """Play every row to its end with one action; yields the batch after each step."""
    batch.begin_seeded(seed, {})
    while not batch.ended.all() and steps:
        batch.step(np.broadcast_to(action, (batch.size, 3)), batch.ended)
        steps -= 1
        yield batch


def final(batch, action, seed=0):
    """Play every row to its end; return the columns of the info."""
    *_, _ = played(batch, action, seed)
    return batch.info()


def sent(batch, action, steps=10_000):
    """Play; return the packets of each row's operator in the order of sending: (rows, n), PACKET."""
    seen = {}
    for each in played(batch, action, steps=steps):
        for row in range(batch.size):
            last = int(each.links["packets"][row])
            for number in range(max(last - 3, 0), last):
                seen[row, number] = each.packets[row, number % each.packets.shape[1]].copy()
    count = min(int(last) for last in batch.links["packets"])
    return np.array([[seen[row, number] for number in range(count)] for row in range(batch.size)], PACKET)
