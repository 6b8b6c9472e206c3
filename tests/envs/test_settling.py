"""V_p is what the object keeps, however long that takes to be known; where it is not known, the status says so."""

import numpy as np
import pytest
from episodes import ROBOT, action_table
from front_ends import FRONT_ENDS, Singles, trails

import impact_gym as ig
from agents.baselines import ConstantSpeed
from agents.evaluate import ScenarioBatch
from experiments import reference

SEED, SOFT = 7, {"contact_stiffness": (1.0, 100.0), "object_mass": (1.0, 5.0)}
HEAVY = {"contact_stiffness": (1.0, 1e4), "object_mass": (10.0, 1e4)}
SETTLE = [  # for seconds, all of them
    (ig.SpringDamper(5.0, 0.0), None, {}, 2000),
    (ig.SpringDamper(50.0, 0.003), None, {}, 2000),
    (ig.SpringDamper(50.0, 1.0), None, SOFT, 500),
    (ig.SpringDamper(2.0, 0.1), None, {"object_mass": (5.0, 10.0)}, 500),
    (ig.SpringDamper(50.0, 0.0), ROBOT, {}, 100),
    (ig.Bistable(), None, SOFT, 100),
]
DO_NOT_SETTLE = [  # some of them
    (ig.Rigid(), None, HEAVY, 400),
    (ig.SpringDamper(2.0, 0.1), None, HEAVY, 400),
    (ig.SpringDamper(50.0, 0.01), ROBOT, HEAVY, 60),
    (ig.Bistable(), None, HEAVY, 60),
]
RULE, MOTION = ConstantSpeed(1.0, 8.0), ig.Trapezoid(1.0, 8.0, ig.Brake(threshold=1e-3))


def played(coupling, robot, scenario, count):
    """Episodes of the paper's rule, what has not settled as missed; and what `simulate` finds of them in 60 s."""
    task = {"coupling": coupling, "robot": robot, "scenario": scenario, "alarm_threshold": 1e-3}
    episodes = ScenarioBatch(SEED, count, lenient=True, **task).play(RULE)
    assert (episodes.contact_count > 0).all()
    scene = ig.Scene(ig.Tool(0.125), ig.Object(1.0, 1.0), ig.Contact(1.0, 1.0), coupling, robot)
    paths = ("object.mass", "contact.stiffness", "contact.restitution", "object.distance")
    columns = dict(zip(paths, episodes.scenario.values(), strict=True))
    return episodes, ig.sweep(scene, MOTION, columns, duration=60.0)


@pytest.mark.parametrize("family", [*SETTLE, *DO_NOT_SETTLE], ids=str)
def test_velocity_that_counts_as_settled_is_that_of_a_minute_later(family):
    episodes, later = played(*family)
    settled, gap = ~episodes.missed, np.abs(episodes.object_velocity - later.object_velocity)
    assert gap[settled].max() < 1e-7
    assert np.array_equal(episodes.contact_count[settled], later.contact_count[settled])
    assert settled.any()
    assert settled.all() == (family in SETTLE)
    assert family in SETTLE or gap[~settled].max() > 1e-4


@pytest.mark.parametrize("family", [SETTLE[2], SETTLE[3]], ids=str)
def test_velocity_of_a_heavy_soft_object_is_that_of_the_independent_solver(family):
    episodes, _ = played(*family)
    for row in range(2):
        mass, stiffness, restitution, distance = (float(values[row]) for values in episodes.scenario.values())
        contact, target = ig.Contact(stiffness, restitution), ig.Object(mass, distance)
        slow = reference.simulate(ig.Scene(ig.Tool(0.125), target, contact, family[0]), MOTION, 12.0)
        assert slow.object_velocity == pytest.approx(episodes.object_velocity[row], abs=1e-8)


@pytest.mark.parametrize("front", [Singles, *FRONT_ENDS.values()], ids=["single", *FRONT_ENDS])
def test_every_front_end_says_what_has_not_settled(front):
    task = {"scenario": {"object_mass": 1e4}, "coupling": ig.SpringDamper(2.0)}
    for trail in trails(front([task] * 2), action_table(1, 60, 2), SEED):
        _, _, terminated, truncated, info = next(met for met in trail if isinstance(met, list) and met[4])
        assert (terminated, truncated) == (True, False)
        assert info["status"].startswith("not settled")
        assert 0.0 < info["object_velocity"] == -info["reward_terms"]["velocity"]
        assert info["reward_terms"]["missed"] == 0.0
    with pytest.raises(RuntimeError, match=f"scenario seeded {SEED}: not settled"):
        ScenarioBatch(SEED, 2, **task).play(RULE)
