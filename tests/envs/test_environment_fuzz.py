"""Whatever is given to the environment is refused by a clear error, or played to a finite end."""

import math
from itertools import cycle, islice

import gymnasium as gym
import numpy as np
from episodes import ID, ROBOT, Given, play
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import impact_gym as ig

HUGE = 10**400  # no float holds it


def powers(low, high):
    """Positive numbers of every magnitude between two."""
    return st.floats(math.log10(low), math.log10(high)).map(lambda power: float(10.0**power))


GARBAGE = st.one_of(
    st.sampled_from([math.nan, math.inf, -math.inf, -1.0, 0.0, -0.0, HUGE, -HUGE, 1e-320, True, None, "", "0.1", 1j]),
    st.tuples(st.floats(), st.floats()),
    st.lists(st.floats(), max_size=3),
    st.floats().map(np.float64),
    st.lists(st.floats(), max_size=2).map(np.array),
    st.sampled_from([{}, {"type": "Rigid", "stiffness": 1.0}]),
)
SCENARIO = {
    "object_mass": powers(1e-6, 1e6),
    "contact_stiffness": powers(1e-2, 1e9),
    "restitution": powers(1e-4, 1.0),
    "distance": powers(1e-6, 1e3),
}
SPRINGS = st.fixed_dictionaries(
    {"type": st.just("SpringDamper"), "stiffness": powers(1e-3, 1e7), "damping_ratio": st.floats(0.0, 10.0)}
)
ARGUMENTS = {
    "scenario": st.fixed_dictionaries({}, optional={name: SCENARIO[name] | GARBAGE for name in SCENARIO}),
    "coupling": st.sampled_from([{"type": "Rigid"}, ig.SpringDamper(150.0), {"type": "Bistable"}]) | SPRINGS,
    "tool_mass": powers(1e-4, 1e3),
    "time_weight": powers(1e-3, 1e3),
    "force_weight": st.floats(0.0, 10.0),
    "reaction_delay": st.one_of(st.floats(0.0, 1.0), st.tuples(st.floats(1e-9, 0.05), st.floats(0.05, 1.0))),
    "control_period": powers(2e-3, 0.15),
    "range_noise": powers(1e-6, 10.0),
    "force_noise": st.floats(0.0, 100.0),
    "force_bias": st.floats(0.0, 100.0),
    "privileged": st.booleans(),
    "robot": st.sampled_from([None, ROBOT, {"type": "Robot", "mass": 1.0, "stiffness": 1e4, "damping": 10.0}]),
    "rtol": powers(1e-12, 1e-2),
}
EPISODE = st.fixed_dictionaries({}, optional=ARGUMENTS)
NAMES = [*ARGUMENTS, *SCENARIO, "Rigid"]
FUZZ = settings(deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))


def all_finite(value):
    if isinstance(value, dict):
        return all(map(all_finite, value.values()))
    return isinstance(value, str) or bool(np.isfinite(value).all())


@settings(FUZZ, max_examples=150)
@given(EPISODE, st.sampled_from(list(ARGUMENTS)), GARBAGE)
def test_garbage_in_an_argument_is_a_clear_error_or_an_argument_after_all(arguments, name, garbage):
    try:
        env = gym.make(ID, **{**arguments, name: garbage})
    except (TypeError, ValueError) as error:
        refusal = str(error)
        assert any(name in refusal for name in NAMES), refusal
    else:
        assert np.isfinite(env.reset(seed=0)[0]).all()


@settings(FUZZ, max_examples=100)
@given(st.dictionaries(st.sampled_from([*SCENARIO, "mass", ""]), st.one_of(GARBAGE, *SCENARIO.values()), max_size=3))
def test_garbage_in_the_options_of_a_reset_is_a_clear_error_or_a_scenario_after_all(scenario):
    try:
        observation, _ = gym.make(ID).reset(seed=0, options={"scenario": scenario})
    except (TypeError, ValueError) as error:
        refusal = str(error)
        assert any(name in refusal for name in SCENARIO), refusal
    else:
        assert np.isfinite(observation).all()
        assert set(scenario) <= set(SCENARIO)


@settings(FUZZ, max_examples=120)
@given(
    EPISODE.filter(lambda arguments: "scenario" not in arguments),
    st.fixed_dictionaries({}, optional=SCENARIO),
    st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)), min_size=1, max_size=8),
)
def test_whatever_is_accepted_is_played_to_a_finite_end(arguments, scenario, actions):
    env = gym.make(ID, **arguments)
    observations, rewards, info = play(
        env, Given(islice(cycle(map(np.array, actions)), 1300)), seed=0, scenario=scenario
    )
    assert all(observation in env.observation_space for observation in observations)
    assert len(rewards) < 1 + (1.2 + 0.15 + 1.0) / arguments.get("control_period", 0.016) + 2
    assert math.isfinite(rewards.sum())
    assert all_finite(info)
    assert info["status"] == "ok" or info["reward_terms"]["missed"] == -2.0
