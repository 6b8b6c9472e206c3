"""Environments in which hardly anything is drawn, beside those of a set-up."""

from dataclasses import replace

import numpy as np
import pytest
from training import assert_same, interrupted, tiny

from agents.setups import load_setup
from agents.train.beside import Beside, narrowed
from agents.train.ppo import make_environment
from agents.train.run import resume, train
from agents.train.settings import Settings
from impact_gym.sb3 import ImpactVecEnv

ROBUST = load_setup("linear-robust")


def finals(envs, steps=90):
    """Return the infos of the episodes that end, each with its place in the batch."""
    envs.reset()
    infos = [envs.step(np.full((envs.num_envs, 2), 0.2, np.float32))[3] for _ in range(steps)]
    return [(place, info) for step in infos for place, info in enumerate(step) if "record" in info]


def test_each_batch_plays_as_if_it_were_alone():
    others, ranges = {"tool_mass": [0.3, 0.5]}, {"tool_mass": [0.1, 0.2]}
    together = Beside(ImpactVecEnv(3, **ranges), ImpactVecEnv(5, **others))
    together.seed(40)
    first, second = ImpactVecEnv(3, **ranges), ImpactVecEnv(5, **others)
    first.seed(40)
    second.seed(43)
    for batch in (together, first, second):
        batch.reset()
    rng, kept, later = np.random.default_rng(0), None, []
    for step in range(60):
        actions = rng.uniform(-1.0, 1.0, (8, 2)).astype(np.float32)
        seen, rewards, ended, infos = together.step(actions)
        alone = first.step(actions[:3]), second.step(actions[3:])
        for got, parts in zip((seen, rewards, ended), list(zip(*alone, strict=True))[:3], strict=True):
            assert np.array_equal(got, np.concatenate(parts))
        assert [info.get("object_velocity") for info in infos] == [
            info.get("object_velocity") for part in alone for info in part[3]
        ]
        if step == 30:
            kept = together.get_state()
        if step >= 31:
            later.append((actions, seen))
    together.set_state(kept)
    assert all(np.array_equal(together.step(actions)[0], seen) for actions, seen in later)


def test_where_hardly_anything_is_drawn_every_range_is_at_its_nominal_value():
    plain = narrowed(ROBUST.environment, ROBUST.evaluation.nominal)
    envs = ImpactVecEnv(16, **plain)
    envs.seed(1)
    nominal = {"tool_mass": 0.125, "coupling.stiffness": 50.0, "coupling.damping_ratio": 1.0, "reaction_delay": 0.016}
    nominal |= {"alarm_threshold": 1.0, "force_noise": 0.0}
    episodes = finals(envs)
    assert len(episodes) >= 16
    for _, info in episodes:
        assert {name: info["record"][name] for name in nominal} == pytest.approx(nominal, rel=1e-5, abs=1e-5)
        assert info["record"]["robot.stiffness"] == pytest.approx(1e6, rel=1e-5)
    assert len({info["record"]["object_mass"] for _, info in episodes}) == len(episodes)


def test_a_training_has_the_share_of_nominal_environments_that_it_asks_for():
    envs = make_environment(tiny(setup="linear-robust", nominal=0.25))
    envs.seed(3)
    nominal = {place: abs(info["record"]["tool_mass"] - 0.125) < 1e-5 for place, info in finals(envs)}
    assert sorted(place for place, found in nominal.items() if found) == [12, 13, 14, 15]
    assert len(nominal) == 16
    alone = ImpactVecEnv(1, **tiny(setup="linear-robust").training_environment)
    assert envs.observation_space == alone.observation_space


def test_a_training_beside_nominal_environments_goes_on_to_the_same_end(tmp_path):
    settings = tiny(setup="linear-robust", nominal=0.5, steps=1500, checkpoint_every=500, validate_every=500)
    interrupted(settings, tmp_path / "broken", 1)
    resume(tmp_path / "broken")
    assert_same(train(replace(settings, out=tmp_path / "whole")), tmp_path / "broken")


def test_a_share_without_a_nominal_arm_or_of_batches_that_differ_is_refused():
    with pytest.raises(ValueError, match=r"nominal must be 0.*no table \[evaluation.nominal\], got 0.5"):
        Settings("linear-blind", nominal=0.5)
    with pytest.raises(ValueError, match=r"nominal.*at most 1"):
        Settings("linear-robust", nominal=1.5)
    with pytest.raises(ValueError, match="different shapes"):
        Beside(ImpactVecEnv(1), ImpactVecEnv(1, range_noise=0.01))
