"""What episodes draw; episodes repeated from seed and index, from a record, from an evaluation set; altered states."""

import copy
import re
import shutil
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, action_table, assert_identical, begin, random_actions
from episodes import play as play_with
from refusals import refused
from tasks import EVERYTHING_DRAWN, STEERED_DRAWN

import impact_gym as ig
from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.render.film import History
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import ObservationSpec, Task, evaluation_sets
from impact_gym.task.episodes import RECORD_IDS as RECORD
from impact_gym.task.scenario import FIELDS, NAMED

NOISE = {"range_noise": 0.01, "force_noise": 0.2, "force_bias": 0.1}
OPTIONS = {"time_weight": (0.5, 8.0), "reaction_delay": (0.0, 0.04), **NOISE}


def play(env, seed=None, **options):
    return play_with(env, random_actions(0), seed, **options)


def test_episode_is_repeated_from_its_seed_and_index():
    env = gym.make(ID, **OPTIONS)
    episodes = [play(env, seed) for seed in (11, None, None, None)]
    for k, episode in enumerate(episodes):
        assert_identical(play(gym.make(ID, **OPTIONS), seed=11, episode_index=k), episode)
    assert len({episode.info["scenario"]["object_mass"] for episode in episodes}) == 4


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
    for index in range(3):
        for envs in (plain, drawn):
            envs.reset(seed=3, options={"episode_index": index})
        record = drawn.unwrapped.batch.info()["record"]
        assert np.ptp(record.pop("tool_mass")) > 0.05
        assert_identical(record, plain.unwrapped.batch.info()["record"])


def test_ranges_of_no_width_are_numbers():
    spring = {"type": "SpringDamper", "stiffness": [60.0, 60.0]}
    narrow = Task(tool_mass=(0.2, 0.2), coupling=spring, force_noise=(1, 1))
    assert narrow == Task(tool_mass=0.2, coupling=ig.SpringDamper(60.0), force_noise=1.0)


def test_history_of_pictures_has_the_numbers_that_the_episode_drew():
    env = gym.make(ID, record_trace=True, **EVERYTHING_DRAWN["spring"])
    info = play(env, seed=1).info
    history = History(
        env.unwrapped.trace(), info, Task(**EVERYTHING_DRAWN["spring"]), env.unwrapped.episode_state(), ended=True
    )
    assert history.threshold == info["record"]["alarm_threshold"]
    assert history.task.coupling.stiffness == info["record"]["coupling.stiffness"]
    reduced = 1.0 / (1.0 / info["record"]["tool_mass"] + 1.0 / info["record"]["object_mass"])
    assert history.reduced_mass == pytest.approx(reduced, rel=1e-15)


@pytest.mark.parametrize("alarm", ["force", "reading"])
def test_observation_of_a_critic_begins_with_that_of_the_actor_and_repeats_nothing(alarm):
    options = EVERYTHING_DRAWN["spring"] | {"alarm": alarm}
    actor, critic = (ObservationSpec(Task(**options, privileged=privileged)) for privileged in (False, True))
    assert critic.ids[critic.actor] == actor.ids
    assert critic.ids[critic.critic] == critic.ids
    assert len(set(critic.ids)) == len(critic)
    assert ("time_since_touch" in critic) is (alarm == "reading")


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


@pytest.mark.parametrize(("line", "pattern", "instead"), [
    (-1, "[0-8]", "9"), (-1, r".*\n", ""), (1, "distance", "place"), (0, '"seed": ', '"seed": 7'),
], ids=["digit", "line", "column", "seed"])  # fmt: skip
def test_evaluation_set_that_was_altered_is_refused(tmp_path, line, pattern, instead):
    path = shutil.copy(evaluation_sets.SHIPPED / "hard.csv", tmp_path / "mine.csv")
    assert evaluation_sets.load(path).count == evaluation_sets.load("hard").count
    lines = path.read_text().splitlines(keepends=True)
    lines[line], changes = re.subn(pattern, instead, lines[line], count=1)
    assert changes == 1
    path.write_text("".join(lines))
    refused(lambda: evaluation_sets.load(path), "mine.csv")


def test_scenario_of_a_reset_has_precedence_over_its_record():
    env = gym.make(ID)
    env.reset(options={"record": {"distance": 0.3}, "scenario": {"distance": 0.2}})
    assert env.unwrapped.episode_info()["scenario"]["distance"] == 0.2


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


KINDS = {
    "spring": lambda: gym.make_vec("mo-impact-approach-v0", 3, force_weight=0.01),
    "everything drawn": lambda: ImpactVecEnv(3, **EVERYTHING_DRAWN["mechanism"]),
    "range sensor": lambda: ImpactVecEnv(3, **EVERYTHING_DRAWN["sensor"]),
    "operator": lambda: ImpactVecEnv(3, **STEERED_DRAWN["Reach"]),
}


def running(make):
    """A batch in the middle of an episode, and actions for it."""
    envs = make()
    begin(envs, seed=1)
    actions = action_table(4, 55, 3, task={"operator": envs.action_space.shape[-1] == 3})
    for row in actions[:25]:
        envs.step(row)
    return envs, actions[25:]


def fields(values, path=()):
    """Paths of the arrays in a state and of the fields in arrays of records."""
    if isinstance(values, dict):
        return [found for name, inner in values.items() for found in fields(inner, (*path, name))]
    if isinstance(values, np.ndarray) and values.dtype.names:
        return [found for name in values.dtype.names for found in fields(values[name], (*path, name))]
    return [path] if isinstance(values, np.ndarray) and values.size else []


def corrupted(state, path):
    """Copies of a state with another number in a field, or with another array."""
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
            with pytest.raises(ValueError, match=rf"^(sha256|{path[1]}) of a state must (be|match)"):
                target.set_state(state)
    assert_identical(target.get_state(), good)


@pytest.mark.parametrize("kind", KINDS)
def test_state_with_missing_or_wrong_generators_is_refused_and_one_of_strided_arrays_is_not(kind):
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
