"""Whatever is given to the environment is refused by a clear error, or played to a finite end."""

import math
from itertools import cycle, islice

import gymnasium as gym
import numpy as np
from episodes import ID, Given, play
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from tasks import rows_of_tasks

from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.quantities import QUANTITIES
from impact_gym.task.task import arguments

HUGE = 10**400  # no float holds it
GARBAGE = st.one_of(
    st.sampled_from([math.nan, math.inf, -math.inf, -1.0, 0.0, -0.0, HUGE, -HUGE, 1e-320, True, None, "", "0.1", 1j]),
    st.tuples(st.floats(), st.floats()),
    st.lists(st.floats(), max_size=3),
    st.floats().map(np.float64),
    st.lists(st.floats(), max_size=2).map(np.array),
    st.sampled_from([{}, {"type": "Rigid", "stiffness": 1.0}]),
)
NAMES = [*arguments(), *QUANTITIES, "Rigid"]
FUZZ = settings(
    deadline=None, derandomize=True, database=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck)
)


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


def all_finite(value):
    if isinstance(value, dict):
        return all(map(all_finite, value.values()))
    return isinstance(value, str) or bool(np.isfinite(value).all())


@settings(FUZZ, max_examples=150)
@given(rows_of_tasks(count=1), st.sampled_from([*arguments()]), GARBAGE)
def test_environment_takes_garbage_for_an_argument_with_a_clear_error_or_plays_it(rows, name, garbage):
    try:
        envs = ImpactApproachVectorEnv(2, **rows[0] | {name: garbage})
    except (TypeError, ValueError) as error:
        refusal = str(error)
        assert any(known in refusal for known in NAMES), refusal
    else:
        assert np.isfinite(envs.reset(seed=0)[0]).all()


@settings(FUZZ, max_examples=100)
@given(st.dictionaries(st.sampled_from([*EXTREME, "mass", ""]), st.one_of(GARBAGE, *EXTREME.values()), max_size=3))
def test_reset_takes_garbage_for_a_scenario_with_a_clear_error_or_plays_it(scenario):
    try:
        observation, _ = gym.make(ID).reset(seed=0, options={"scenario": scenario})
    except (TypeError, ValueError) as error:
        refusal = str(error)
        assert any(name in refusal for name in EXTREME), refusal
    else:
        assert np.isfinite(observation).all()
        assert set(scenario) <= set(EXTREME)


@settings(FUZZ, max_examples=120)
@given(
    rows_of_tasks(count=1),
    st.fixed_dictionaries({}, optional=EXTREME_ARGUMENTS),
    st.fixed_dictionaries({}, optional=EXTREME),
    st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)), min_size=1, max_size=8),
)
def test_environment_plays_whatever_it_accepts_to_a_finite_end(rows, extreme, scenario, actions):
    options = rows[0] | extreme | {"max_episode_steps": None}
    env = gym.make(ID, **options)
    given = Given(islice(cycle(map(np.array, actions)), 1300))
    observations, rewards, info = play(env, given, seed=0, scenario=scenario)
    assert all(observation in env.observation_space for observation in observations)
    assert len(rewards) < 1 + (1.2 + 0.15 + 1.0) / options.get("control_period", 0.016) + 2
    assert math.isfinite(rewards.sum())
    assert all_finite(info)
    if info["status"] != "ok" and not info["status"].startswith("not settled"):
        assert info["reward_terms"]["missed"] == -2.0
