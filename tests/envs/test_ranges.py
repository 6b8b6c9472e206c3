"""Numbers of a set-up given as ranges: what is drawn, and that nothing else changes."""

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, Given, action_table, play, scene
from tasks import EVERYTHING_DRAWN

import impact_gym as ig
from agents.baselines.profile import ConstantDeceleration
from impact_gym.envs.render_history import History
from impact_gym.task import ObservationSpec, Task


def test_history_of_pictures_shows_what_the_episode_drew():
    env = gym.make(ID, record_trace=True, **EVERYTHING_DRAWN["spring"])
    info = play(env, Given(action_table(0, 200, 1, lean=(0.0, 0.6))[:, 0]), seed=1).info
    history = History(env.unwrapped.trace(), info, env.unwrapped._batch.task, ended=True)
    assert history.threshold == info["record"]["alarm_threshold"]
    assert history.task.coupling.stiffness == info["record"]["coupling.stiffness"]
    reduced = 1.0 / (1.0 / info["record"]["tool_mass"] + 1.0 / info["record"]["object_mass"])
    assert history.reduced_mass == pytest.approx(reduced, rel=1e-15)


def test_ranges_of_no_width_are_numbers():
    spring = {"type": "SpringDamper", "stiffness": [60.0, 60.0]}
    narrow = Task(tool_mass=(0.2, 0.2), coupling=spring, force_noise=(1, 1))
    assert narrow == Task(tool_mass=0.2, coupling=ig.SpringDamper(60.0), force_noise=1.0)


def records(envs):
    """What was drawn for the episodes of each row, one after the other."""
    drawn = [[] for _ in range(envs.num_envs)]
    envs.reset(seed=3)
    for action in action_table(4, 150, envs.num_envs, lean=(0.0, 0.6)):
        infos = envs.step(action)[4]
        for row in np.flatnonzero(infos.get("_record", [])):
            drawn[row].append({name: column[row] for name, column in infos["record"].items() if name[0] != "_"})
    return drawn


def test_number_that_is_drawn_leaves_everything_else_as_it_is():
    drawn, plain = gym.make_vec(ID, num_envs=8, tool_mass=(0.1, 0.2)), gym.make_vec(ID, num_envs=8)
    both = list(zip(records(drawn), records(plain), strict=True))
    assert min(len(some) for some, _ in both) > 1
    for some, other in both:  # another tool ends its episodes at other times: compare as many as there are
        for with_mass, without in zip(some, other, strict=False):
            assert 0.1 <= with_mass.pop("tool_mass") < 0.2
            assert with_mass == without


@pytest.mark.parametrize("alarm", ["force", "reading"])
def test_critic_sees_all_that_an_actor_sees_first_and_nothing_twice(alarm):
    options = EVERYTHING_DRAWN["spring"] | {"alarm": alarm}
    actor, critic = (ObservationSpec(Task(**options, privileged=privileged)) for privileged in (False, True))
    assert critic.ids[critic.actor] == actor.ids
    assert critic.ids[critic.critic] == critic.ids
    assert len(set(critic.ids)) == len(critic)
    assert ("time_since_touch" in critic) is (alarm == "reading")


def test_slower_arm_maps_its_actions_to_its_own_ranges():
    options = {"velocity_range": (0.0, 1.0), "acceleration_range": (2.0, 8.0), "record_trace": True}
    env = gym.make(ID, **options)
    env.reset(seed=2, options={"scenario": {"distance": 0.35}})
    observation = env.step(np.array([1.0, 1.0], np.float32))[0]
    assert observation[1] == pytest.approx(2.0 * 8.0 * 0.016 - 1.0, abs=1e-6)  # of 0 to 1 m/s
    for action in ([-1.0, -1.0], [0.0, 0.0], [1.0, 1.0]):
        env.step(np.array(action, np.float32))
    trace = env.unwrapped.trace()
    ends = np.interp(0.016 * np.arange(1, 5), trace.time, trace.command_velocity)
    assert ends == pytest.approx(0.016 * np.array([8.0, 6.0, 11.0, 19.0]), rel=1e-9)


SCENARIO = {"object_mass": 0.5, "contact_stiffness": 3e4, "restitution": 0.4, "distance": 0.3}


def test_paper_rule_at_the_papers_limits_is_the_corner_of_the_action_space():
    class Corner:
        def predict(self, observation, state=None):
            return np.array([1.0 if observation[3] == 0.0 else -1.0, 1.0], np.float32), state

    env = gym.make(ID, velocity_range=(0.0, 1.0), acceleration_range=(1.0, 8.0))
    info = play(env, Corner(), scenario=SCENARIO).info
    outcome = ig.simulate(scene(SCENARIO), ig.Trapezoid(1.0, 8.0, ig.Brake(1.0, 0.016)), 3.0)
    assert info["object_velocity"] == pytest.approx(outcome.object_velocity, abs=1e-9)
    assert info["approach_time"] == pytest.approx(outcome.contacts[0].start, abs=1e-9)


def test_baseline_commands_what_it_means_on_an_arm_of_other_ranges():
    results = []
    for options in ({}, {"velocity_range": (-1.0, 2.0), "acceleration_range": (0.5, 20.0)}):
        rule = ConstantDeceleration([parameter.start for parameter in ConstantDeceleration.PARAMETERS])
        info = play(gym.make(ID, **options), rule.for_environment(options), scenario=SCENARIO).info
        results.append([info["object_velocity"], info["approach_time"], info["peak_force"]])
    assert results[0] == pytest.approx(results[1], rel=1e-4)  # actions and observations are of single precision
