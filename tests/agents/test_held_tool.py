"""What a training charges for a tool that moves further against the flange than it may."""

import numpy as np
import pytest

from agents.setups import load_setup
from agents.train.held_tool import PRICE, HeldTool
from agents.train.settings import Settings, default_settings
from impact_gym.sb3 import ImpactVecEnv

SEEN = {"deflection_sensor": True, "reaction_delay": 0.0}  # the observation then has it as it is at each control step
DEFLECTION = 8


def rewards_and_deflections(envs, steps=120, push=0.4):
    """Return rewards, ends of episodes and deflections (m) before each step and after it (steps, envs)."""
    envs.seed(5)
    seen, rng, told = envs.reset(), np.random.default_rng(1), []
    for _ in range(steps):
        before = seen
        seen, rewards, ended, infos = envs.step(rng.uniform(-0.5, push, (envs.num_envs, 2)).astype(np.float32))
        touched = [bool(info.get("contact_count", 0)) for info in infos]
        told.append((rewards, ended, 0.05 * before[:, DEFLECTION], touched))
    return [np.array(column) for column in zip(*told, strict=True)]


@pytest.mark.parametrize("limit", [0.003, 0.006])
def test_an_episode_is_charged_for_the_farthest_that_its_tool_moved_before_the_touch(limit):
    plain, _, _, _ = rewards_and_deflections(ImpactVecEnv(40, **SEEN))
    charged, ended, deflections, _ = rewards_and_deflections(HeldTool(ImpactVecEnv(40, **SEEN), limit))
    contacts = ImpactVecEnv(40, **SEEN)
    contacts.seed(5)
    contacts.reset()
    rng, free = np.random.default_rng(1), []
    for _ in range(len(plain)):
        free.append(contacts.envs.batch.chains["contacts"] == 0)
        contacts.step(rng.uniform(-0.5, 0.4, (40, 2)).astype(np.float32))
    charges, beyond = plain - charged, 0
    for row in range(40):
        ends = np.flatnonzero(ended[:, row])
        for first, last in zip([0, *(ends[:-1] + 1)], ends, strict=True):
            flown = deflections[first : last + 1, row][np.array(free)[first : last + 1, row]]
            farthest = np.abs(flown).max()
            charge = PRICE * max(farthest / limit - 1.0, 0.0)
            assert charges[first : last + 1, row].sum() == pytest.approx(charge, abs=2e-5)
            beyond += charge > 0.0
    assert beyond > 20


def test_a_tool_that_stays_within_the_limit_costs_nothing():
    plain, ended, _, touched = rewards_and_deflections(ImpactVecEnv(16, **SEEN))
    held = rewards_and_deflections(HeldTool(ImpactVecEnv(16, **SEEN), 1.0))[0]
    assert np.array_equal(plain, held)
    assert ended.any()
    assert touched.any()


def test_it_goes_on_from_its_state_as_if_nothing_had_happened():
    rng = np.random.default_rng(2)
    actions = rng.uniform(-0.5, 1.0, (90, 8, 2)).astype(np.float32)
    first, second = HeldTool(ImpactVecEnv(8), 0.005), HeldTool(ImpactVecEnv(8), 0.005)
    first.seed(7)
    first.reset()
    for each in actions[:45]:
        first.step(each)
    second.reset()
    second.set_state(first.get_state())
    charged = [(first.step(each)[1], second.step(each)[1]) for each in actions[45:]]
    assert all(np.array_equal(one, other) for one, other in charged)
    assert min(one.min() for one, _ in charged) < -0.1  # some are


def test_the_set_up_of_all_springs_keeps_its_tool_within_less_than_designs_may():
    assert default_settings("linear-designs").deflection < 0.05
    assert load_setup("linear-designs").environment["holder_told"]


@pytest.mark.parametrize(("options", "words"), [
    ({"deflection": 0.0}, "deflection must be finite and above 0 m"),
    ({"deflection": float("nan")}, "deflection must be finite"),
], ids=str)  # fmt: skip
def test_a_limit_that_is_none_is_refused(options, words):
    with pytest.raises(ValueError, match=words):
        Settings(**options)


def test_what_is_told_by_its_range_cannot_be_trained_beside_a_narrower_one(tmp_path):
    path = tmp_path / "told.toml"
    path.write_text(
        '[environment]\ntool_mass = [0.1, 0.2]\ncoupling = { type = "SpringDamper", stiffness = [40.0, 60.0] }\n'
        "holder_told = true\n[evaluation.nominal]\ntool_mass = 0.125\n"
    )
    with pytest.raises(ValueError, match="nominal must be 0 where holder_told"):
        Settings(setup=str(path), nominal=0.5)
