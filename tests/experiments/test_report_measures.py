"""What the jobs of the report measure: a policy as late as the rule, its reactions, its profile; nothing twice."""

import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from episodes import assert_identical

from agents.evaluate import play as evaluations
from agents.setups import load_setup
from experiments.lab.statistics import Estimate
from experiments.report import answer, matchups, measures
from experiments.report.played import Played, Run
from impact_gym.task import evaluation_sets

AGENTS = Path(matchups.__file__).parents[2] / "agents"
SCENARIOS = {"set": "test", "count": 30}
LINEAR = matchups.of_setup(load_setup("linear-blind"), SCENARIOS)
PAPERS_RULE = {"baseline": "paper-trapezoid"}


@pytest.mark.parametrize("arm", [{}, {"velocity_range": [-0.2, 1.2], "acceleration_range": [1.0, 10.0]}], ids=str)
def test_play_as_late_is_as_late_as_the_rule_on_that_arm_on_the_validation_set_and_nearly_on_the_other(arm):
    scenarios, validation = ({"set": name, "count": 200} for name in ("test", "validation"))
    policy = LINEAR.policy
    late = measures.play_as_late(policy.controller, arm, scenarios, policy.weights)
    ours = evaluations.play(policy.controller, validation, [float(late["weight"][0])], arm)
    chosen, other = (evaluations.play(PAPERS_RULE, each, environment=arm) for each in (validation, scenarios))
    assert ours["approach_time"].mean() == pytest.approx(chosen["approach_time"].mean(), abs=1e-3)
    assert ours["approach_time"].mean() <= chosen["approach_time"].mean()
    assert late["approach_time"].mean() == pytest.approx(other["approach_time"].mean(), rel=0.03)


def test_profile_is_the_flanges():
    profile = measures.profile(PAPERS_RULE, {}, [2.0], 0.36)
    x = profile["position"]
    reached = x < 0.35  # the tool swings ahead of the flange and touches first
    assert profile["velocity"][0][reached] == pytest.approx(np.minimum(np.sqrt(16.0 * x), 1.0)[reached], abs=2e-3)


def test_play_takes_sets_tables_and_ranges_alike():
    frozen = evaluation_sets.load("test")
    table = {name: values[:20].tolist() for name, values in frozen.scenario.items()}
    ranges = {"object_mass": [0.1, 2.5], "contact_stiffness": [1e3, 1e6], "restitution": [0.1, 1.0],
              "distance": [0.15, 0.35]}  # fmt: skip
    same = [{"set": "test"}, {"table": table, "seed": frozen.seed}, {"ranges": ranges, "seed": frozen.seed}]
    noisy = {"range_noise": 0.01}
    first, *rest = (evaluations.play(PAPERS_RULE, {**each, "count": 20}, environment=noisy) for each in same)
    for results in rest:
        assert_identical(first, results)


def test_report_needs_no_more_than_its_extra():
    extras = tomllib.loads((AGENTS.parent / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    names = {
        extra: {re.split("[><=]", requirement)[0].replace("-", "_") for requirement in requirements}
        for extra, requirements in extras.items()
    }
    absent = set().union(*names.values()) - names["report"] - {"packaging"}  # which altair brings
    assert {"torch", "cma", "mujoco", "ray"} <= absent
    program = (
        f"import sys; sys.modules.update(dict.fromkeys({sorted(absent)})); import experiments.report.__main__; "
        "from experiments.report.__main__ import ReportOptions, matchups_of; matchups_of(ReportOptions())"
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=AGENTS.parent)


def test_answer_says_that_a_curve_does_not_reach_the_papers_time():
    matchup = replace(LINEAR, seeds=(replace(LINEAR.policy, weights=(8.0,)),), scenarios={"set": "test", "count": 20})
    played = Played(matchup)
    for runs, contestants in ((played.seeds, matchup.seeds), (played.baselines, matchup.baselines)):
        for each in contestants:
            arrays = evaluations.play(each.controller, matchup.scenarios, each.weights, matchup.environment)
            runs[each.name] = Run(each.weights, arrays)
    played.as_late = played.seeds
    fast = answer.answer(played)
    assert not fast.reached
    assert fast.later < 0.0
    assert "no weight makes its approach as long" in answer.sentence(fast, matchup)
    assert f"{-100 * fast.later:.1f} % sooner" in answer.sentence(fast, matchup)
    assert fast.each == ()
    late = replace(fast, later=0.02)
    assert "no weight makes its approach as short" in answer.sentence(late, matchup)
    assert "2.0 % later" in answer.sentence(late, matchup)
    slow = replace(fast, reached=True, reduction=Estimate(-0.2, -0.3, -0.1), beyond="faster")
    assert "20.0 % [10.0, 30.0] faster" in answer.sentence(slow, matchup)
    assert "nowhere leaves the object as slow" in answer.sentence(slow, matchup)
