"""What episodes draw; episodes repeated from a record, from an evaluation set; altered states."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import ID, Given, action_table, assert_identical, begin
from episode_runs import play as play_with
from random_tasks import EVERYTHING_DRAWN, STEERED_DRAWN
from refusal import refused

import impact_gym as ig
from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import ObservationSpec, Task, evaluation_sets
from impact_gym.task.episodes import RECORD_IDS as RECORD
from impact_gym.task.scenario import FIELDS, NAMED

NOISE = {"range_noise": 0.01, "force_noise": 0.2, "force_bias": 0.1}
OPTIONS = {"time_weight": (0.5, 8.0), "reaction_delay": (0.0, 0.04), **NOISE}


def play(env, seed=None, **options):
    return play_with(env, Given(action_table(0, 200, 1)[:, 0]), seed, **options)


@pytest.mark.parametrize("kind", ["scenario", "record"])
def test_options_of_a_reset_fix_numbers_for_one_episode_and_change_no_other_draw(kind):
    env, free = gym.make(ID, **OPTIONS), gym.make(ID, **OPTIONS)
    fixed = {"object_mass": 0.7, "restitution": 0.5}
    drawn, info = play(free, seed=4).info["record"], play(env, seed=4, **{kind: fixed}).info
    assert tuple(drawn) == RECORD
    assert info["record"] == drawn | fixed
    assert info["scenario"] == {name: info["record"][name] for name in FIELDS}
    assert_identical(play(env), play(free))


def test_range_of_one_number_changes_no_other_draw():
    plain, drawn = (gym.make_vec(ID, num_envs=50, **options) for options in ({}, {"tool_mass": (0.1, 0.2)}))
    for seed in (3, None, None):
        for envs in (plain, drawn):
            envs.reset(seed=seed)
        record = drawn.unwrapped.batch.info()["record"]
        assert np.ptp(record.pop("tool_mass")) > 0.05
        assert_identical(record, plain.unwrapped.batch.info()["record"])


def test_ranges_of_no_width_are_numbers():
    spring = {"type": "SpringDamper", "stiffness": [60.0, 60.0]}
    narrow = Task(tool_mass=(0.2, 0.2), coupling=spring, force_noise=(1, 1))
    assert narrow == Task(tool_mass=0.2, coupling=ig.SpringDamper(60.0), force_noise=1.0)


@pytest.mark.parametrize("alarm", ["force", "reading"])
def test_observation_of_a_critic_begins_with_that_of_the_actor_and_repeats_nothing(alarm):
    options = EVERYTHING_DRAWN["spring"] | {"alarm": alarm}
    actor, critic = (ObservationSpec(Task(**options, privileged=privileged)) for privileged in (False, True))
    assert critic.ids[critic.actor] == actor.ids
    assert critic.ids[critic.critic] == critic.ids
    assert len(set(critic.ids)) == len(critic)
    assert ("time_since_touch" in critic.ids) is (alarm == "reading")


@pytest.mark.parametrize("name", ["test", "validation", "hard"])
def test_evaluation_set_is_drawn_from_its_seeds(name):
    frozen, ranges = evaluation_sets.load(name), "hard" if name == "hard" else "test"
    envs = gym.make_vec(ID, num_envs=frozen.count, scenario=ranges)
    envs.reset(seed=frozen.seed)
    drawn = envs.batch.info()["scenario"]
    envs.reset(seed=0, options={"scenario": frozen.scenario})
    for field in FIELDS:
        assert frozen.scenario[field] == pytest.approx(drawn[field], rel=1e-15)  # the rounding of exponentials
        low, high = getattr(NAMED[ranges], field)
        assert ((frozen.scenario[field] >= low) & (frozen.scenario[field] <= high)).all()
        assert np.array_equal(envs.batch.info()["scenario"][field], frozen.scenario[field])


def test_slots_with_other_ranges_repeat_their_records_and_refuse_numbers_outside_their_own_ranges():
    slots = [{}, {"tool_mass": 0.3}, {"tool_mass": (0.5, 0.6), "reaction_delay": (0.06, 0.1)}]
    envs, by_slot = (make(3, per_slot=slots, tool_mass=(0.1, 0.2)) for make in (ImpactApproachVectorEnv, ImpactVecEnv))
    envs.reset(seed=1)
    record = envs.batch.info()["record"]
    by_slot.set_options([{"record": info["record"]} for info in envs.batch.infos(np.arange(3))])
    by_slot.reset()
    assert_identical(by_slot.envs.batch.info()["record"], record)
    envs.reset(seed=2, options={"record": record})
    assert_identical(envs.batch.info()["record"], record)
    for mass, field in (([0.15, 0.3, 0.15], "tool_mass'][2]"), (0.15, "tool_mass']")):
        call = partial(envs.reset, options={"record": {"tool_mass": mass}})
        refused(call, field, "at least 0.5 and at most 0.6 kg", "got 0.15 kg")
    mask = np.array([False, True, True])
    envs.reset(options={"record": {"distance": [0.3, 0.31, 0.32]}, "reset_mask": mask})
    assert envs.batch.info()["record"]["distance"].tolist() == [record["distance"][0], 0.31, 0.32]


def test_critic_observes_a_number_in_every_row_if_any_row_draws_it():
    drawn = EVERYTHING_DRAWN["spring"] | {"privileged": True, "tool_mass": (0.1, 0.2)}
    slots = [{}, {"tool_mass": 0.3, "robot": None}, {"tool_mass": 0.05, "robot": ig.Robot(5.0, 1e5, 50.0)}]
    envs = gym.make_vec(ID, num_envs=3, per_slot=slots, **drawn)
    observations, spec = envs.reset(seed=1)[0], envs.unwrapped.observation_spec
    mass, stiffness = (spec.decode(observations, name) for name in ("tool_mass", "robot.stiffness"))
    assert 0.1 <= mass[0] < 0.2
    assert mass[1:] == pytest.approx([0.3, 0.05], rel=2e-6)
    assert stiffness[1:] == pytest.approx([spec.scale("robot.stiffness").high, 1e5], rel=2e-6)  # rigid: the stiffest


def altered(values):
    """An array with another last byte, and others that do not fit."""
    changed = np.ascontiguousarray(values).copy()
    changed.view(np.uint8).reshape(-1)[-1:] ^= 1
    return changed, values[:-1], np.concatenate([values, values]), values.view(np.uint8), None


@pytest.mark.parametrize("make", [
    lambda: gym.make_vec("mo-impact-approach-v0", 3, force_weight=0.01),
    *(partial(ImpactVecEnv, 3, **EVERYTHING_DRAWN[name]) for name in ("mechanism", "sensor")),
    partial(ImpactVecEnv, 3, **STEERED_DRAWN["Reach"]),
], ids=["spring", "mechanism", "range sensor", "operator"])  # fmt: skip
def test_altered_state_is_refused_by_name_and_changes_nothing_and_strided_arrays_are_not(make):
    envs = make()
    begin(envs, seed=1)
    actions = action_table(4, 55, 3, task={"operator": envs.action_space.shape[-1] == 3})
    for row in actions[:25]:
        envs.step(row)
    target = getattr(envs, "unwrapped", envs)
    good = target.get_state()
    one = good["generators"][0]
    bad = {"generators": [good["generators"][:-1], [], None, 3, [one, one, {**one, "bit_generator": "MT19937"}]]}
    bad |= {name: altered(part) for name, part in good.items() if isinstance(part, np.ndarray) and part.size}
    for name, values in bad.items():
        for value in values:
            with pytest.raises(ValueError, match=rf"^(sha256|{name}) of a state must (hold|match)"):
                target.set_state({**good, name: value})
    assert_identical(target.get_state(), good)
    apart = {name: np.repeat(good[name], 2, axis=0)[::2] for name in bad if name != "generators"}  # not contiguous
    target.set_state({**good, **apart})
    expected = [envs.step(row) for row in actions[25:]]
    target.set_state(good)
    assert_identical([envs.step(row) for row in actions[25:]], expected)
