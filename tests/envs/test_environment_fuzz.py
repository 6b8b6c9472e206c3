"""Whatever the environment takes is played to a finite end; what it refuses is in `tests/test_hostile_input.py`."""

import math
from itertools import cycle, islice

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, Given, all_finite, play
from hypothesis import given, settings
from hypothesis import strategies as st
from tasks import STORM, rows_of_tasks

from impact_gym.envs.infos import SLIDE


def powers(low, high):
    """Positive numbers of every magnitude between two."""
    return st.floats(math.log10(low), math.log10(high)).map(lambda power: float(10.0**power))


EXTREME = {
    "object_mass": powers(1e-6, 1e6), "contact_stiffness": powers(1e-2, 1e9), "restitution": powers(1e-4, 1.0),
    "distance": powers(1e-6, 1e3),
}  # fmt: skip
SPRING = st.fixed_dictionaries({"stiffness": powers(1e-3, 1e7), "damping_ratio": st.floats(0.0, 10.0)})
EXTREME_ARGUMENTS = {
    "tool_mass": powers(1e-4, 1e3), "time_weight": powers(1e-3, 1e3), "force_weight": st.floats(0.0, 10.0),
    "control_period": powers(2e-3, 0.15), "reaction_delay": st.floats(0.0, 1.0), "rtol": powers(1e-12, 1e-2),
    "force_noise": st.floats(0.0, 100.0), "coupling": SPRING.map(lambda numbers: {"type": "SpringDamper", **numbers}),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore:SpringDamper.stroke")
@settings(STORM, max_examples=120)
@given(
    rows_of_tasks(count=1),
    st.fixed_dictionaries({}, optional=EXTREME_ARGUMENTS),
    st.fixed_dictionaries({}, optional=EXTREME),
    st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)), min_size=1, max_size=8),
)
def test_environment_plays_whatever_it_accepts_to_a_finite_end(rows, extreme, scenario, actions):
    options = rows[0] | extreme | {"max_episode_steps": None}
    env = gym.make(ID, **options)
    given = Given(islice(cycle(np.resize(action, env.action_space.shape) for action in actions), 1300))
    observations, rewards, info = play(env, given, seed=0, scenario=scenario)
    assert all(observation in env.observation_space for observation in observations)
    assert len(rewards) < 1 + (1.2 + 0.15 + 1.0) / options.get("control_period", 0.016) + 2
    assert math.isfinite(rewards.sum())
    assert all_finite({name: value for name, value in info.items() if name not in SLIDE})  # with friction of 0 inf
    if info["status"] != "ok" and not info["status"].startswith("not settled"):
        assert info["reward_terms"]["missed"] == -options.get("missed_cost", 2.0)
