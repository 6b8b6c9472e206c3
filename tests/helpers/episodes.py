"""Episodes for the tests of front ends, wrappers and other libraries."""

import numpy as np
from gymnasium.utils.env_checker import data_equivalence

SLOTS = 4


def action_table(seed, ticks=160, slots=SLOTS):
    """Random actions that lean forward, so that slots end at different times."""
    rng = np.random.default_rng(seed)
    return np.clip(rng.uniform(-1.0, 1.0, (ticks, slots, 2)) + 0.3, -1.0, 1.0).astype(np.float32)


def assert_identical(one, other):
    assert data_equivalence(one, other, exact=True), f"{one}\n{other}"


def play(env, actions, seed=3):
    """One episode: all that reset and step return."""
    history = [env.reset(seed=seed)]
    for action in actions:
        history.append(env.step(action))
        if history[-1][2] or history[-1][3]:
            return history
    raise AssertionError("the episode did not end")
