"""The shield: no contact force above its limit, whoever commands, and little below it where the object is the worst."""

from itertools import product

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID
from scenes import log_uniform, scene

import impact_gym as ig
from agents import load_setup
from agents.baselines import PaperTrapezoid, Shield
from agents.baselines.permitted import fastest_on_a_spring, poles
from agents.evaluate import ScenarioBatch
from impact_gym.task import Task
from impact_gym.task.evaluation_sets import EvaluationSet
from impact_gym.task.scenario import FIELDS

BLIND = ("linear-blind", "rigid-blind", "bistable-blind")
ENVIRONMENTS = {name: dict(load_setup(name).environment) for name in (*BLIND, "bistable-paper")}
LINEAR = ENVIRONMENTS["linear-blind"]
WORST = {"object_mass": [2.5], "contact_stiffness": [1e6], "restitution": [0.1, 1.0]}


def worst_objects(name, count=40):
    """A batch of the heaviest and stiffest objects, all over the distances."""
    table = np.array(list(product(*WORST.values(), np.linspace(0.15, 0.35, count)))).T
    frozen = EvaluationSet(0, dict(zip(FIELDS, table, strict=True)))
    return ScenarioBatch(0, 2 * count, frozen=frozen, **ENVIRONMENTS[name])


class BangBang:
    """Commands at random, from one end of what an arm can do to the other, each for a while."""

    def __init__(self, periods):
        self.random, self.periods, self.calls = np.random.default_rng(periods), periods, 0

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        if self.calls % self.periods == 0:
            self.action = self.random.choice([-1.0, -0.5, 0.0, 1.0], (len(observation), 2))
        self.calls += 1
        return self.action, state


@pytest.mark.parametrize(("name", "limit"), list(product(ENVIRONMENTS, (20.0, 100.0))))
def test_shield_lets_the_worst_object_have_nearly_the_limit_and_never_more(name, limit):
    peak = worst_objects(name).play(Shield(ENVIRONMENTS[name], limit)).peak_force.max()
    assert 0.84 * limit < peak <= limit


@pytest.mark.parametrize(("name", "periods"), list(product(ENVIRONMENTS, (1, 2, 5))))
def test_shield_keeps_the_limit_against_commands_from_one_end_to_the_other(name, periods):
    shield = Shield(ENVIRONMENTS[name], 60.0, BangBang(periods))
    assert worst_objects(name).play(shield).peak_force.max() <= 60.0


@pytest.mark.parametrize("name", BLIND)
def test_shield_leaves_alone_what_is_slow_enough(name):
    batch = ScenarioBatch.of("test", 50, **ENVIRONMENTS[name])
    shield = Shield(ENVIRONMENTS[name], 1000.0, PaperTrapezoid())
    assert np.array_equal(batch.play(PaperTrapezoid()).approach_time, batch.play(shield).approach_time)


def test_shield_needs_its_state_and_plays_an_episode_of_gymnasium_as_a_row_of_a_batch():
    env, shield = gym.make(ID, **LINEAR), Shield(LINEAR, 50.0)
    observation, _ = env.reset(seed=3)
    state, ended, info = None, False, {}
    while not ended:
        action, state = shield.predict(observation, state)
        observation, _, ended, _, info = env.step(action)
        if not ended:
            with pytest.raises(ValueError, match="state must be what the last call returned"):
                shield.predict(observation)
    assert info["peak_force"] == ScenarioBatch(3, 1, scenario="train", **LINEAR).play(shield).peak_force[0]


def test_fastest_on_a_spring_lets_later_contacts_be_no_faster():
    random, later = np.random.default_rng(3), 0
    for _ in range(300):
        coupling = ig.SpringDamper(log_uniform(random, 10.0, 500.0), random.uniform(1.0, 3.0))
        delay = random.uniform(0.0, 0.9) / poles(coupling, 0.125)[0]
        task = Task(coupling=coupling, reaction_delay=delay)
        speed = min(fastest_on_a_spring(task, poles(coupling, 0.125)[0]), 1.5)
        met = scene(1e6, random.uniform(0.1, 1.0), coupling, m_p=log_uniform(random, 0.1, 2.5), distance=8.0)
        motion = ig.Trapezoid(speed, 20.0, ig.Brake(1.0, delay))
        first, *others = ig.simulate(met, motion, 8.0 / speed + 2.0).contacts
        later += len(others)
        assert all(contact.approach_velocity <= first.approach_velocity for contact in others)
    assert later > 100
