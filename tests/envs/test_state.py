"""A state that was altered is refused and changes nothing."""

import copy

import gymnasium as gym
import numpy as np
import pytest
from episodes import action_table, assert_identical, begin
from refusals import refused
from tasks import EVERYTHING_DRAWN, STEERED_DRAWN

from impact_gym.sb3 import ImpactVecEnv

KINDS = {
    "spring": lambda: gym.make_vec("mo-impact-approach-v0", 3, force_weight=0.01),
    "everything drawn": lambda: ImpactVecEnv(3, **EVERYTHING_DRAWN["mechanism"]),
    "operator": lambda: ImpactVecEnv(3, **STEERED_DRAWN["Reach"]),
}


def running(make, ticks=25):
    """A batch in mid-episode, and actions for it."""
    envs = make()
    begin(envs, seed=1)
    actions = action_table(4, 30 + ticks, 3, task={"operator": envs.action_space.shape[-1] == 3})
    for row in actions[:ticks]:
        envs.step(row)
    return envs, actions[ticks:]


def fields(values, path=()):
    """Paths of the arrays in a state, and of the fields of those of records."""
    if isinstance(values, dict):
        return [found for name, inner in values.items() for found in fields(inner, (*path, name))]
    if isinstance(values, np.ndarray) and values.dtype.names:
        return [found for name in values.dtype.names for found in fields(values[name], (*path, name))]
    return [path] if isinstance(values, np.ndarray) and values.size else []


def corrupted(state, path):
    """Copies of a state with other numbers in a field, or another array in its place."""
    *outer, last = path
    for bad in (-1, 2**62, np.nan, -1e300, 7):
        node = there = copy.deepcopy(state)
        for name in outer:
            node = node[name]
        with np.errstate(all="ignore"):
            changed = np.array(bad).astype(node[last].dtype)
        if node[last][-1:].tobytes() != np.broadcast_to(changed, node[last][-1:].shape).tobytes():
            node[last][-1:] = changed
            yield there
    for change in (lambda old: old[:-1], lambda old: np.concatenate([old, old]), lambda old: None,
                   lambda old: old.view(np.uint8), lambda old: old.tolist()):  # fmt: skip
        there = copy.deepcopy(state)
        there["batch"][path[1]] = change(there["batch"][path[1]])
        yield there


@pytest.mark.parametrize("kind", KINDS)
def test_altered_state_is_refused_by_name_and_changes_nothing(kind):
    envs, _ = running(KINDS[kind])
    target = getattr(envs, "unwrapped", envs)
    good = target.get_state()
    for path in fields({"batch": {name: part for name, part in good["batch"].items() if name != "sha256"}}):
        for state in corrupted(good, path):
            with pytest.raises(ValueError, match=rf"^(sha256|{path[1]}) of a state must be"):
                target.set_state(state)
    assert_identical(target.get_state(), good)


@pytest.mark.parametrize("kind", KINDS)
def test_state_with_fewer_generators_or_that_of_no_generator_is_refused(kind):
    envs, actions = running(KINDS[kind])
    target = getattr(envs, "unwrapped", envs)
    state = target.get_state()
    one = state["generators"][0]
    for bad in (state["generators"][:-1], [], None, 3, [one, one, {}], [one, one, {**one, "bit_generator": "MT19937"}]):
        refused(lambda bad=bad: target.set_state({**state, "generators": bad}), "generators")
        assert_identical(target.get_state(), state)
    apart = {name: np.repeat(array, 2, axis=0)[::2] for name, array in state["batch"].items()}  # not contiguous
    target.set_state({**state, "batch": apart})
    expected = [envs.step(row) for row in actions]
    target.set_state(state)
    assert_identical([envs.step(row) for row in actions], expected)
