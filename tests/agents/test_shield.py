"""The shield: no contact force above its limit, whoever commands, and little below it where the object is the worst."""

from itertools import product

import gymnasium as gym
import numpy as np
import pytest
from scenes import log_uniform, scene

import impact_gym as ig
from agents import load_policy, load_setup
from agents.baselines import PaperTrapezoid, Shield
from agents.baselines.permitted import fastest_on_a_spring, permitted, poles
from agents.evaluate import Stage
from agents.evaluate.play import play
from impact_gym.envs.evaluation_sets import EvaluationSet
from impact_gym.envs.scenario import FIELDS
from impact_gym.envs.task import Task

BLIND = ("linear-blind", "rigid-blind", "bistable-blind")
WORST = {"object_mass": [2.5], "contact_stiffness": [1e6], "restitution": [0.1, 1.0]}


def environment(name):
    return dict(load_setup(name).environment)


def worst_objects(name, count=40):
    """A stage of the heaviest and stiffest objects, all over the distances."""
    table = np.array(list(product(*WORST.values(), np.linspace(0.15, 0.35, count)))).T
    frozen = EvaluationSet(0, dict(zip(FIELDS, table, strict=True)), "")
    return Stage(0, 2 * count, frozen=frozen, **environment(name))


class BangBang:
    """Commands at random, from one end of what an arm can do to the other, each for a while."""

    def __init__(self, periods):
        self.random, self.periods, self.asked = np.random.default_rng(periods), periods, 0

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        if self.asked % self.periods == 0:
            self.action = self.random.choice([-1.0, -0.5, 0.0, 1.0], (len(observation), 2))
        self.asked += 1
        return self.action, state


@pytest.mark.parametrize(("name", "limit"), [*product(BLIND, (50.0, 100.0)), ("linear-blind", 20.0)])
def test_with_the_shield_no_scenario_of_2000_exceeds_the_limit(name, limit):
    stage = Stage.of("test", **environment(name))
    policy = load_policy(name)
    for controller in (Shield(environment(name), limit), Shield(environment(name), limit, policy)):
        assert stage.play(controller).peak_force.max() <= limit


@pytest.mark.parametrize("name", BLIND)
def test_without_it_the_policies_exceed_a_limit_that_it_keeps(name):
    assert Stage.of("test", **environment(name)).play(load_policy(name)).peak_force.max() > 80.0


@pytest.mark.parametrize(("name", "limit"), list(product((*BLIND, "bistable-paper"), (20.0, 100.0))))
def test_the_worst_object_is_struck_with_nearly_the_limit_and_never_more(name, limit):
    peak = worst_objects(name).play(Shield(environment(name), limit)).peak_force.max()
    assert 0.84 * limit < peak <= limit


@pytest.mark.parametrize(("name", "periods"), list(product((*BLIND, "bistable-paper"), (1, 2, 5))))
def test_commands_from_one_end_to_the_other_do_not_get_past_it(name, periods):
    shielded = Shield(environment(name), 60.0, BangBang(periods))
    assert worst_objects(name).play(shielded).peak_force.max() <= 60.0


@pytest.mark.parametrize("name", BLIND)
def test_where_nothing_is_too_fast_the_approach_is_the_controllers_own(name):
    stage = Stage.of("test", 200, **environment(name))
    own, shielded = stage.play(PaperTrapezoid()), stage.play(Shield(environment(name), 1000.0, PaperTrapezoid()))
    assert np.array_equal(own.approach_time, shielded.approach_time)


def test_a_lower_limit_costs_time_and_never_saves_any():
    stage = Stage.of("test", 200, **environment("linear-blind"))
    times = [stage.play(Shield(environment("linear-blind"), limit)).approach_time for limit in (25.0, 50.0, 100.0)]
    assert np.all(times[0] >= times[1])
    assert np.all(times[1] >= times[2])
    assert times[0].mean() > times[2].mean() + 0.2


def test_one_episode_of_gymnasium_is_a_row_of_a_batch():
    settings = environment("linear-blind")
    env, shield = gym.make("ImpactApproach-v0", **settings), Shield(settings, 50.0)
    observation, _ = env.reset(seed=3)
    state, ended, info = None, False, {}
    while not ended:
        action, state = shield.predict(observation, state)
        observation, _, ended, _, info = env.step(action)
    assert info["peak_force"] == Stage(3, 1, scenario="train", **settings).play(shield).peak_force[0]


def test_a_job_can_name_a_shield_around_another_controller():
    named = {"shield": 50.0, "scenario": "test", "of": {"shipped": "rigid-blind"}}
    found = play(named, {"set": "test", "count": 20}, environment=environment("rigid-blind"))
    shielded = Shield(environment("rigid-blind"), 50.0, load_policy("rigid-blind"))
    assert np.array_equal(
        found["peak_force"][0], Stage.of("test", 20, **environment("rigid-blind")).play(shielded).peak_force
    )


def test_a_tool_on_a_spring_hits_no_faster_later_if_the_flange_stops_in_time():
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
        assert all(one.approach_velocity <= first.approach_velocity for one in others)
    assert later > 100


def test_a_tool_that_swings_may_hit_harder_the_second_time_which_is_why_it_is_refused():
    met = scene(1e6, 1.0, ig.SpringDamper(50.0, 0.05), m_p=2.5, distance=8.0)
    first, second, *_ = ig.simulate(met, ig.Trapezoid(0.5, 1.0), 20.0).contacts
    assert second.approach_velocity > 1.2 * first.approach_velocity


@pytest.mark.parametrize(
    ("name", "change", "limit", "told"),
    [
        ("rigid-blind", {}, 0.0, "limit must be finite and above 0 N"),
        ("bistable-blind", {}, 4.0, r"limit must be finite and above 5\.\d+ N"),
        ("bistable-blind", {}, 5.11, "limit must permit more than the .* m/s .* got 5.11 N"),
        ("linear-blind", {"coupling": ig.SpringDamper(50.0, 0.5)}, 50.0, "damping_ratio must be at least 1 .* got 0.5"),
        ("linear-blind", {"reaction_delay": 0.06}, 50.0, "reaction_delay must be below 0.0500. s"),
        ("linear-blind", {"tool_mass": (0.1, 0.2)}, 50.0, "a known tool .* got tool_mass drawn"),
        ("rigid-blind", {"robot": ig.Robot(5.0, 1e5, 50.0)}, 50.0, "a rigid robot .* got Robot"),
        ("bistable-blind", {"tool_mass": 0.8}, 50.0, "coupling must hold a tool of 0.8 kg against"),
    ],
)
def test_what_it_cannot_promise_it_refuses(name, change, limit, told):
    with pytest.raises(ValueError, match=told):
        permitted(Task(**{**environment(name), **change}), limit)


def test_a_mechanism_whose_stop_swings_is_refused():
    with pytest.raises(ValueError, match="stop_damping_ratio must be at least 1"):
        permitted(Task(coupling=ig.Bistable(1400.0, front_stop=0.001, stop_damping_ratio=0.3)), 50.0)


def test_an_episode_that_goes_on_without_its_state_is_refused():
    settings = environment("linear-blind")
    env, shield = gym.make("ImpactApproach-v0", **settings), Shield(settings, 50.0)
    action, _ = shield.predict(env.reset(seed=1)[0])
    with pytest.raises(ValueError, match="state must be what the last call returned"):
        shield.predict(env.step(action)[0])
