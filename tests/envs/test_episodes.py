"""What episodes draw, how one is repeated and how it ends: with a final V_p, or a status that says that it is not."""

import math
from functools import partial
from itertools import cycle

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import ID, ROBOT, Given, action_table, all_finite, assert_identical, begin, by_path, play, steps
from hypothesis import given, settings
from hypothesis import strategies as st
from random_tasks import RANGE_SENSOR, STEERED_DRAWN, STORM, rows_of_tasks
from solver_scenes import scene

import impact_gym as ig
from agents.baselines import ConstantSpeed, PaperTrapezoid
from agents.evaluate.scenario_batch import ScenarioBatch
from impact_gym.envs.infos import SLIDE
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import Task, evaluation_sets
from impact_gym.task.episodes import RECORD_IDS

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
    *_, last = steps(env, Given(actions), 4, **{kind: fixed})
    *_, drawn = steps(free, Given(actions), 4)
    assert last[4]["record"] == drawn[4]["record"] | fixed
    assert_identical(*([*steps(each, Given(actions))] for each in (env, free)))


@pytest.mark.parametrize(("more", "shown"), [
    ({"tool_mass": (0.1, 0.2)}, []), ({"range_sensor": RANGE_SENSOR}, []), ({"force_noise": 0.5}, [5, 6]),
], ids=str)  # fmt: skip
def test_what_is_drawn_besides_changes_no_other_draw(more, shown):
    plain, drawn = (gym.make_vec(ID, num_envs=50, **options) for options in ({}, more))
    for seed in (3, None, None):
        assert_identical(*(envs.reset(seed=seed)[0][:, :8] for envs in (plain, drawn)))
        record, expected = (envs.unwrapped.batch.info()["record"] for envs in (drawn, plain))
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
    for field, drawn in envs.batch.info()["scenario"].items():
        assert frozen.scenario[field] == pytest.approx(drawn, rel=1e-15)  # the rounding of exponentials


def test_slots_of_other_ranges_repeat_and_check_their_records():
    slots = [{}, {"tool_mass": 0.3}, {"tool_mass": (0.5, 0.6), "reaction_delay": (0.06, 0.1)}]
    envs = gym.make_vec(ID, num_envs=3, per_slot=slots, tool_mass=(0.1, 0.2)).unwrapped
    envs.reset(seed=1)
    record = envs.batch.info()["record"]
    envs.reset(seed=2, options={"record": record})
    assert_identical(envs.batch.info()["record"], record)
    with pytest.raises(ValueError, match=r"tool_mass'\]\[2\].*at least 0.5 and at most 0.6 kg"):
        envs.reset(options={"record": {"tool_mass": [0.15, 0.3, 0.15]}})
    envs.reset(options={"record": {"distance": [0.3, 0.31, 0.32]}, "reset_mask": np.array([False, True, True])})
    assert envs.batch.info()["record"]["distance"].tolist() == [record["distance"][0], 0.31, 0.32]


def test_altered_state_is_refused_by_name_and_changes_nothing():
    envs = ImpactVecEnv(3, **STEERED_DRAWN["Reach"])
    begin(envs, seed=1)
    good = envs.get_state()
    bad = {"generators": [good["generators"][:-1], [], None, 3]}
    for name, part in good.items():
        if isinstance(part, np.ndarray) and part.size:
            changed = np.ascontiguousarray(part).copy()
            changed.view(np.uint8).reshape(-1)[-1:] ^= 1  # its last byte
            bad[name] = changed, part[:-1], np.concatenate([part, part]), part.view(np.uint8), None
    for name, values in bad.items():
        for value in values:
            with pytest.raises(ValueError, match=rf"^(sha256|{name}) of a state must (hold|match)"):
                envs.set_state({**good, name: value})
    assert_identical(envs.get_state(), good)


@pytest.mark.parametrize("other", [
    {"time_weight": 3.0}, {"reaction_delay": 0.03}, {"scenario": "hard"}, {"scenario": {"distance": 0.3}},
    {"tool_mass": (0.1, 0.2)}, {"coupling": {"type": "SpringDamper", "stiffness": (40.0, 60.0)}}, {"horizon": 1.3},
    {"rtol": 1e-7}, {"missed_cost": 3.0}, {"force_limit": 5.0}, {"time_weight": (2.0, 2.1)},
    {"per_slot": [{}, {"time_weight": 3.0}]},
], ids=str)  # fmt: skip
def test_state_of_another_task_is_refused(other):
    envs, others = ImpactApproachVectorEnv(2), ImpactApproachVectorEnv(2, **other)
    for each in (envs, others):
        each.reset(seed=3)
    for one, two in ((envs, others), (others, envs)):
        with pytest.raises(ValueError, match="of a state must"):
            one.set_state(two.get_state())
    for nothing in (None, [], {}, envs.batch.get_state()):
        with pytest.raises(ValueError, match="state"):
            envs.set_state(nothing)
    envs.set_scenario({"distance": 0.4})  # is part of a state, not of the task
    (twin := ImpactApproachVectorEnv(2)).set_state(envs.get_state())
    twin.reset()
    assert twin.episode_info()["scenario"]["distance"].tolist() == [0.4, 0.4]


def test_calls_before_a_reset_and_after_the_end_are_refused():
    env, action = ImpactApproachEnv(), np.zeros(2, np.float32)
    for call in (partial(env.step, action), env.sensors, env.episode_info, ImpactApproachVectorEnv(2).episode_info):
        with pytest.raises(gym.error.ResetNeeded, match="reset"):
            call()
    assert len([*steps(env, PaperTrapezoid())]) > 10
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        env.step(action)


def test_slot_without_autoreset_must_be_reset_before_a_step():
    envs = gym.make_vec(ID, num_envs=2, autoreset_mode="Disabled", max_episode_steps=2)
    action = np.zeros((2, 2), np.float32)
    for remedy in ("reset", "reset_mask"):  # never reset; ended
        envs.reset(seed=0, options={"reset_mask": np.array([True, False])})
        with pytest.raises((RuntimeError, gym.error.ResetNeeded), match=remedy):
            envs.step(action)
        envs.reset(options={"reset_mask": np.array([False, True])})
        assert not envs.step(action)[3].any()
        assert envs.step(action)[3].all()


SEED, SOFT = 7, {"contact_stiffness": (1.0, 100.0), "object_mass": (1.0, 5.0)}
HEAVY = {"contact_stiffness": (1.0, 1e4), "object_mass": (10.0, 1e4)}
FAMILIES = [  # coupling, robot, scenario, number of episodes, and whether all of them settle
    (ig.SpringDamper(5.0, 0.0), None, {}, 1000, True), (ig.SpringDamper(50.0, 0.003), None, {}, 1000, True),
    (ig.SpringDamper(50.0, 1.0), None, SOFT, 500, True), (ig.Bistable(), None, SOFT, 100, True),
    (ig.SpringDamper(50.0, 0.0), ROBOT, {}, 100, True), (ig.SpringDamper(50.0, 0.01), ROBOT, HEAVY, 60, False),
    (ig.Rigid(), None, HEAVY, 400, False), (ig.Bistable(), None, HEAVY, 60, False),
]  # fmt: skip
RULE, MOTION = ConstantSpeed(1.0, 8.0), ig.Trapezoid(1.0, 8.0, ig.Brake(threshold=1e-3))


@pytest.mark.parametrize(("coupling", "robot", "scenario", "count", "settles"), FAMILIES, ids=str)
def test_settled_velocity_is_that_of_a_minute_later(coupling, robot, scenario, count, settles):
    task = {"coupling": coupling, "robot": robot, "scenario": scenario, "alarm_threshold": 1e-3}
    episodes = ScenarioBatch(SEED, count, Task(**task), lenient=True).play(RULE)  # not settled counts as missed
    assert (episodes.contact_count > 0).all()
    later = ig.sweep(scene(coupling=coupling, robot=robot), MOTION, by_path(episodes.scenario), duration=60.0)
    settled, gap = ~episodes.missed, np.abs(episodes.object_velocity - later.object_velocity)
    assert gap[settled].max() < 1e-7
    assert np.array_equal(episodes.contact_count[settled], later.contact_count[settled])
    assert settled.any()
    assert settled.all() == settles
    assert settles or gap[~settled].max() > 1e-4


def test_status_says_that_an_episode_has_not_settled():
    task = {"scenario": {"object_mass": 1e4}, "coupling": ig.SpringDamper(2.0)}
    info = play(gym.make(ID, **task), RULE, SEED).info
    assert info["status"].startswith("not settled")
    assert 0.0 < info["object_velocity"] == -info["reward_terms"]["velocity"]
    with pytest.raises(RuntimeError, match=f"scenario with seed {SEED}: not settled"):
        ScenarioBatch(SEED, 2, Task(**task)).play(RULE)


def test_info_has_slide_and_rest_time_only_with_friction():
    missed = play(gym.make(ID, friction=0.3), ConstantSpeed(0.05)).info
    assert missed.keys() == play(gym.make(ID), PaperTrapezoid()).info.keys() | {*SLIDE}
    assert (missed["missed"], missed["slide"], missed["object_velocity"]) == (True, 0.0, 0.0)


def powers(low, high):
    """Numbers of every order of magnitude between two."""
    return st.floats(math.log10(low), math.log10(high)).map(lambda power: float(10.0**power))


EXTREME = {
    "object_mass": powers(1e-6, 1e6), "contact_stiffness": powers(1e-2, 1e9), "restitution": powers(1e-4, 1.0),
    "distance": powers(1e-6, 0.5),
}  # fmt: skip
SPRING = st.fixed_dictionaries({"stiffness": powers(1e-3, 1e7), "damping_ratio": st.floats(0.0, 10.0)})
EXTREME_ARGUMENTS = {
    "tool_mass": powers(1e-4, 1e3), "time_weight": powers(1e-3, 1e3), "force_weight": st.floats(0.0, 10.0),
    "control_period": powers(2e-3, 0.15), "reaction_delay": st.floats(0.0, 1.0), "rtol": powers(1e-12, 1e-2),
    "force_noise": st.floats(0.0, 100.0), "coupling": SPRING.map(lambda numbers: {"type": "SpringDamper", **numbers}),
}  # fmt: skip


def check_sensors(env, seen):
    """What the controller sees, (steps, n_obs), agrees with the sensors, the state and earlier readings."""
    task, spec, now, state = env.task, env.observation_spec, env.sensors(), env.episode_state()
    assert not math.isfinite(state.end)
    for name, value in now.items():
        assert type(value) is float
        scaled = np.clip(spec.encode(name, value), spec.scaled_low[spec.index(name)], 1.0)
        assert abs(seen[-1][spec.index(name)] - scaled) <= 1e-6
    assert now["alarm"] == (state.alarm <= now["time"] < state.alarm_over - 1e-9)
    assert now["time_since_alarm"] == (now["time"] - state.alarm if now["alarm"] else 0.0)
    peak = spec.index("force_peak")
    assert seen[-1][peak] >= max(seen[-1][spec.index("force")], seen[len(seen) > 1 and -2][peak]) - 1e-6
    if task.alarm == "force":
        assert state.alarm == state.detection + env.episode_info()["record"]["reaction_delay"]
    elif now["time"] < task.horizon - 1e-9:  # at the horizon, and at the end of a shortened step, two may arrive
        for before in range(1, min(task.past_readings, len(seen) - 1) + 1):
            for name in ("force", "deflection") if task.deflection_sensor else ("force",):
                assert seen[-1][spec.index(f"{name}_{before}")] == seen[-1 - before][spec.index(name)]


@pytest.mark.filterwarnings("ignore:SpringDamper.stroke")
@settings(STORM, max_examples=50)
@given(
    rows_of_tasks(count=1),
    st.fixed_dictionaries({}, optional=EXTREME_ARGUMENTS),
    st.fixed_dictionaries({}, optional=EXTREME),
    st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)), min_size=1, max_size=8),
)
def test_episode_of_any_arguments_is_finite_and_consistent(rows, extreme, scenario, actions):
    options = rows[0] | extreme | {"max_episode_steps": None}
    env = gym.make(ID, **options)

    def checked():
        for action in cycle(actions):
            check_sensors(env.unwrapped, controller.seen)
            yield np.resize(action, env.action_space.shape)

    controller = Given(checked())
    observations, rewards, info = play(env, controller, seed=0, scenario=scenario)
    assert all(observation in env.observation_space for observation in observations)
    assert len(rewards) < 1 + (1.2 + 0.15 + 1.0) / options.get("control_period", 0.016) + 2
    assert all_finite({name: value for name, value in info.items() if name not in SLIDE})  # infinite without friction
