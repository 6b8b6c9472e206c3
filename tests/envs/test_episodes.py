"""What episodes draw and how one is repeated: records, options of a reset, evaluation sets, states, missing resets."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import ID, TELEOP, Given, action_table, assert_identical, begin, steps
from hypothesis import given, settings
from hypothesis import strategies as st
from random_tasks import EVERYTHING_DRAWN, RANGE_SENSOR, STEERED_DRAWN, STORM, rows_of_tasks
from refusal import refused

import impact_gym as ig
from agents.baselines import PaperTrapezoid
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import ObservationSpec, Task, evaluation_sets
from impact_gym.task.episodes import RECORD_IDS
from impact_gym.task.scenario import FIELDS, NAMED

NOISE = {"range_noise": 0.01, "force_noise": 0.2, "force_bias": 0.1, "reaction_delay": (0.0, 0.05)}


def test_first_of_eleven_numbers_are_the_scenario_as_documented():
    low, high = np.array([(0.1, 2.5), (1e3, 1e6), (0.1, 1.0), (0.15, 0.35), (0.5, 8.0)]).T
    for options in ({}, NOISE):
        env, generator = gym.make(ID, time_weight=(0.5, 8.0), **options), gym.utils.seeding.np_random(12)[0]
        for seed in (12, None, None):
            env.reset(seed=seed)
            uniform, info = generator.random(11)[:5], env.unwrapped.episode_info()
            expected = np.where([1, 1, 0, 0, 1], low * (high / low) ** uniform, low + (high - low) * uniform)
            assert [*info["scenario"].values(), info["time_weight"]] == pytest.approx(expected, rel=1e-13)
            assert (*info["scenario"],) == FIELDS


@settings(STORM, max_examples=20)
@given(rows_of_tasks(count=1), st.integers(0, 1000))
def test_episode_is_repeated_from_its_record_and_from_its_task(rows, seed):
    (options,) = rows
    actions = action_table(seed, 200, 1, lean=(0.3, 0.6), task=options)[:, 0]
    env = gym.make(ID, **options)
    first = [*steps(env, Given(actions), seed)]
    info = env.unwrapped.episode_info()
    assert tuple(info["record"])[: len(RECORD_IDS)] == RECORD_IDS
    for elsewhere in (env, gym.make(ID, **options | {"scenario": "hard"})):
        assert_identical([*steps(elsewhere, Given(actions), record=info["record"])][1:], first[1:])
    task = Task(**options).at(info["record"])
    assert task.drawn == {}
    narrow = {"tool_mass": (0.2, 0.2), "coupling": {"type": "SpringDamper", "stiffness": [60.0, 60.0]}}
    assert Task(**options | narrow) == Task(**options | {"tool_mass": 0.2, "coupling": ig.SpringDamper(60.0)})
    fixed = options | {name: getattr(task, name) for name in {path.partition(".")[0] for path in Task(**options).drawn}}
    assert Task(**fixed) == task
    if not (options["privileged"] and Task(**options).drawn):  # a critic observes what is drawn
        alone, rest = gym.make(ID, **fixed), {name: info["record"][name] for name in RECORD_IDS}
        again = [*steps(alone, Given(actions), record=rest)]
        assert_identical([step[:4] for step in again[1:]], [step[:4] for step in first[1:]])
        assert_identical(alone.unwrapped.episode_info(), info | {"record": rest})


@pytest.mark.parametrize("kind", ["scenario", "record"])
def test_options_fix_numbers_of_one_episode_and_no_others(kind):
    env, free = (gym.make(ID, time_weight=(0.5, 8.0), **NOISE) for _ in range(2))
    actions, fixed = action_table(0, 200, 1)[:, 0], {"object_mass": 0.7, "restitution": 0.5}
    info, drawn = ([*steps(each, Given(actions), 4, **options)][-1][4] for each, options in (
        (env, {kind: fixed}), (free, {}),
    ))  # fmt: skip
    assert info["record"] == drawn["record"] | fixed
    assert_identical(*([*steps(each, Given(actions))] for each in (env, free)))


@pytest.mark.parametrize(("more", "shown"), [
    ({"tool_mass": (0.1, 0.2)}, []), ({"range_sensor": RANGE_SENSOR}, []),
    ({"force_noise": 0.5, "force_bias": 0.5}, [5, 6]),
], ids=["mass", "range", "force"])  # fmt: skip
def test_what_is_drawn_besides_changes_no_other_draw(more, shown):
    plain, drawn = (gym.make_vec(ID, num_envs=50, **options) for options in ({}, more))
    for seed in (3, None, None):
        assert_identical(*(envs.reset(seed=seed)[0][:, :8] for envs in (plain, drawn)))
        record, expected = (envs.unwrapped.batch.info()["record"] for envs in (drawn, plain))
        if shown:
            assert np.ptp(record.pop("force_error")) > expected.pop("force_error").max() == 0.0
        assert min((np.ptp(record[name]) for name in {*record} - {*expected}), default=1.0) > 0.0
        assert_identical({name: record[name] for name in expected}, expected)
        for row in action_table(4, 90, 50) if "tool_mass" not in more else ():  # nor the motion
            (own, *rest), (seen, *others) = plain.step(row)[:4], drawn.step(row)[:4]
            assert_identical([np.delete(own, shown, axis=1), *rest], [np.delete(seen[:, :8], shown, axis=1), *others])
            assert (own[:, shown] != seen[:, shown]).any() == bool(shown)


@pytest.mark.parametrize("name", ["test", "validation", "hard"])
def test_evaluation_set_is_drawn_from_its_seeds(name):
    frozen, ranges = evaluation_sets.load(name), "hard" if name == "hard" else "test"
    envs = gym.make_vec(ID, num_envs=frozen.count, scenario=ranges)
    envs.reset(seed=frozen.seed)
    drawn = envs.batch.info()["scenario"]
    envs.reset(seed=0, options={"scenario": frozen.scenario})
    for field in FIELDS:
        low, high = getattr(NAMED[ranges], field)
        assert frozen.scenario[field] == pytest.approx(drawn[field], rel=1e-15)  # the rounding of exponentials
        assert ((frozen.scenario[field] >= low) & (frozen.scenario[field] <= high)).all()
        assert np.array_equal(envs.batch.info()["scenario"][field], frozen.scenario[field])


def test_slots_of_other_ranges_repeat_and_check_their_records():
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


@pytest.mark.parametrize("alarm", ["force", "reading"])
def test_critic_observes_what_any_row_draws_after_the_actor(alarm):
    drawn = EVERYTHING_DRAWN["spring"] | {"alarm": alarm, "tool_mass": (0.1, 0.2)}
    slots = [{}, {"tool_mass": 0.3, "robot": None}, {"tool_mass": 0.05, "robot": ig.Robot(5.0, 1e5, 50.0)}]
    envs = gym.make_vec(ID, num_envs=3, per_slot=slots, privileged=True, **drawn)
    observations, spec = envs.reset(seed=1)[0], envs.unwrapped.observation_spec
    assert spec.ids[spec.actor] == ObservationSpec(Task(**drawn)).ids
    assert len({*spec.ids}) == len(spec.ids[spec.critic]) == len(spec)
    assert ("time_since_touch" in spec.ids) is (alarm == "reading")
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
def test_altered_state_is_refused_by_name_and_changes_nothing(make):
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


def needs_reset(call, remedy="reset"):
    with pytest.raises((RuntimeError, gym.error.ResetNeeded), match=remedy):
        call()


@pytest.mark.parametrize("make", [
    partial(gym.make, ID), partial(gym.make_vec, ID), partial(ImpactVecEnv, 2), ImpactApproachEnv,
    partial(gym.make, TELEOP, operator={"type": "Person"}),
], ids=["single", "vector", "stable", "by itself", "operator"])  # fmt: skip
def test_calls_before_a_reset_and_after_the_end_are_refused(make):
    env = make()
    single, bare = isinstance(env, gym.Env), env.unwrapped
    action = np.zeros(env.action_space.shape if not isinstance(env, ImpactVecEnv) else (2, 2), np.float32)
    needs_reset(lambda: env.step(action))
    if single:
        for call in (bare.sensors, bare.episode_info, *([lambda: bare.command(0.1)] if len(action) == 3 else [])):
            needs_reset(call)
        if len(action) == 2:  # batches reset their ended slots
            assert len([*steps(env, PaperTrapezoid())]) > 10
            needs_reset(lambda: env.step(action))
    env.reset()
    assert not np.any(env.step(action)[2])


def test_slot_without_autoreset_must_be_reset_before_a_step():
    envs = gym.make_vec(ID, num_envs=2, autoreset_mode="Disabled", max_episode_steps=2)
    action, first, second = np.zeros((2, 2), np.float32), np.array([True, False]), np.array([False, True])
    for remedy in ("reset", "reset_mask"):  # never reset; ended
        envs.reset(seed=0, options={"reset_mask": first})
        needs_reset(lambda: envs.step(action), remedy)
        envs.reset(options={"reset_mask": second})
        assert not envs.step(action)[3].any()
        assert envs.step(action)[3].all()
