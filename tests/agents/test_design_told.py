"""Designs judged by a policy that is told of them."""

from dataclasses import replace

import numpy as np
import pytest
from policies import made_up_policy

from agents.baselines import PaperTrapezoid
from agents.design import told
from agents.design.__main__ import DesignOptions
from agents.design.free import Free
from agents.design.limits import Limits
from agents.design.search import PENALTY, RTOL
from agents.design.study import MARGIN, run
from agents.design.told import best, environment, flown, told_policy
from agents.evaluate import TUNING_SEED, Stage
from agents.setups import load_setup
from impact_gym.scene import SpringDamper

FREE = (Free("coupling.stiffness", 30.0, 250.0), Free("coupling.damping_ratio", 0.2, 0.9))
START = {"coupling.stiffness": 80.0, "coupling.damping_ratio": 0.5}
TOLD = load_setup("linear-designs").environment


@pytest.fixture
def policy(tmp_path):
    """A policy with random weights that sees what that of linear-designs sees, as a file."""
    return str(made_up_policy(environment={**TOLD, "time_weight": [0.3, 8.0]}).save(tmp_path / "told.npz"))


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(told, "BUDGET", 5 * told.POPULATION)


def test_each_design_is_played_as_an_environment_that_has_it():
    springs = {"coupling.stiffness": np.array([30.0, 70.0]), "coupling.damping_ratio": np.array([0.1, 0.9])}
    found = flown(PaperTrapezoid(), Stage(5, 20, 2, **TOLD), springs, np.array([1.0, 2.0]))
    for k, spring in enumerate((SpringDamper(30.0, 0.1), SpringDamper(70.0, 0.9))):
        alone = Stage(5, 20, coupling=spring).play(PaperTrapezoid())
        assert np.array_equal(found.played.object_velocity[20 * k : 20 * (k + 1)], alone.object_velocity)
        assert found.velocity[k] == pytest.approx(alone.object_velocity.mean(), rel=1e-14)
        assert found.time[k] == pytest.approx(alone.approach_time.mean(), rel=1e-14)


def test_a_policy_knows_which_design_it_flies_and_at_which_weight(policy):
    judge = told_policy(policy, load_setup("linear-blind"), FREE)
    stage = Stage(5, 20, 4, quiet=True, **environment(judge))
    springs = {"coupling.stiffness": np.array([30.0, 250.0, 30.0, 30.0]), "coupling.damping_ratio": np.full(4, 0.5)}
    found = flown(judge, stage, springs, np.array([1.0, 1.0, 5.0, 1.0]))
    assert len(set(found.time.tolist())) == 3
    assert found.time[0] == found.time[3]


def test_a_search_keeps_to_the_ranges_and_says_what_its_design_does(policy, quick):
    judge, scenarios, allowed = told_policy(policy, load_setup("linear-blind"), FREE), 12, 0.25
    arguments = (START, allowed, list(Limits(deflection=0.004)), scenarios)
    found = best(policy, [list(one) for one in FREE], *arguments, seed=3)
    for one, value in zip(FREE, found["design"], strict=True):
        assert one.low <= value <= one.high
    stage = Stage(TUNING_SEED, scenarios, quiet=True, **environment(judge) | {"scenario": "train", "rtol": RTOL})
    design = dict(zip(START, found["design"][:, None], strict=True))
    seen = flown(judge, stage, design, found["weight"])
    late = max(seen.time[0] / allowed - 1.0, 0.0)
    far = max(seen.travel.deflection.max() / 0.004 - 1.0, 0.0)
    assert far > 0.0
    assert found["loss"][0] == pytest.approx(seen.velocity[0] + PENALTY * (late + far), rel=1e-12)
    again = best(policy, [list(one) for one in FREE], *arguments, seed=3)
    assert np.array_equal(again["design"], found["design"])


def test_what_is_not_free_stays_as_it_is(policy, quick, monkeypatch):
    played = []
    monkeypatch.setattr(told, "flown", lambda *arguments: played.append(arguments[2]) or flown(*arguments))
    best(policy, [list(FREE[0])], START, 0.3, list(Limits()), 5, seed=1)
    damping, stiffness = (np.concatenate([one[name] for one in played]) for name in reversed(START))
    assert set(damping.tolist()) == {0.5}
    assert stiffness.std() > 0.0


def test_a_study_takes_its_designs_from_the_policy_and_searches_only_their_controllers(policy, quick, tmp_path):
    few = {"scenarios": 12, "budget": 24, "population": 8, "seeds": 2, "processes": 0, "against": ()}
    free = ("coupling.stiffness=30:250", "coupling.damping_ratio=0.2:0.9")
    options = DesignOptions("linear-blind", free, tmp_path / "out", times=(1.0, 1.3), inner=policy, **few)
    entries = run(options.study())
    designs = [one for one in entries if one.line == "designs"]
    assert [one.share for one in designs] == [1.0, 1.3]
    for one in designs:
        stiffness, damping = one.design.values()
        assert 30.0 <= stiffness <= 250.0
        for name, value in (("stiffness", stiffness), ("damping_ratio", damping)):  # as a search meets it
            off = MARGIN * options.tolerance * value
            assert one.environment["coupling"][name] == pytest.approx([value - off, value + off])
    assert [one.design for one in entries if one.line == "chosen"] == [designs[0].design] * 2
    assert [one.parameters for one in run(options.study())] == [one.parameters for one in entries]


@pytest.mark.parametrize(("changes", "words"), [
    ({"inner": "linear-blind"}, "linear-blind: it is not told of the design"),
    ({"inner": "no-such"}, "no policy 'no-such'"),
    ({"setup": "bistable-blind", "free": ("coupling.stiffness=50:90",)}, "told of a SpringDamper, bistable-blind has"),
    ({"free": ("coupling.stiffness=10:300",)}, "knows coupling.stiffness from 20 to 300, got 10:300"),
    ({"free": ("tool_mass=0.1:0.2",)}, "knows tool_mass as one number, got 0.1:0.2"),
    ({"pad": "memory-foam"}, "knows of no pad"),
], ids=str)  # fmt: skip
def test_a_policy_that_cannot_judge_is_refused_in_a_line(policy, tmp_path, changes, words):
    options = DesignOptions("linear-blind", ("coupling.stiffness=40:100",), tmp_path / "out", inner=policy, against=())
    with pytest.raises((ValueError, FileNotFoundError), match=words):
        replace(options, **changes).study()


def test_a_policy_of_another_arm_is_refused(policy, tmp_path):
    path = tmp_path / "heavy.toml"
    path.write_text("[environment]\ntool_mass = 0.4\nreaction_delay = 0.02\n")
    with pytest.raises(ValueError, match=r"trained for another tool_mass, reaction_delay than .*heavy\.toml has"):
        told_policy(policy, load_setup(path), FREE)
