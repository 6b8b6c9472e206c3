"""What a report plays: the policy at the rule's time, and the scenarios of choice and bound."""

import pytest

from agents.evaluate.play import pairs, play
from agents.setups import load_setup
from experiments.report import choice, jobs, matchups


@pytest.mark.parametrize("arm", [{}, {"velocity_range": [-0.2, 1.2], "acceleration_range": [1.0, 10.0]}], ids=str)
def test_play_as_late_has_the_rules_mean_time_on_the_validation_set_and_nearly_on_the_test_set(arm):
    scenarios, validation = ({"set": name, "count": 200} for name in ("test", "validation"))
    policy, rule = matchups.of_setup(load_setup("linear-blind"), scenarios).policy, {"baseline": "paper-trapezoid"}
    late = jobs.play_as_late(policy.controller, arm, scenarios, policy.weights)
    ours = play(policy.controller, validation, [float(late["weight"][0])], arm)
    chosen, other = (play(rule, each, environment=arm) for each in (validation, scenarios))
    assert ours["approach_time"].mean() == pytest.approx(chosen["approach_time"].mean(), abs=1e-3)
    assert ours["approach_time"].mean() <= chosen["approach_time"].mean()
    assert late["approach_time"].mean() == pytest.approx(other["approach_time"].mean(), rel=0.03)


@pytest.mark.parametrize(("given", "ranges", "seed"), [
    ({"set": "test", "count": 30}, "train", 60_000_000), ({"set": "hard", "count": 30}, "hard", 60_000_000),
    ({"ranges": "train", "seed": 5, "count": 30}, "train", 60_000_005),
])  # fmt: skip
def test_scenarios_of_the_choice_come_from_the_same_ranges_and_other_seeds(given, ranges, seed):
    drawn = choice.scenarios(given)
    assert (pairs(drawn["ranges"]), drawn["seed"], drawn["count"]) == (pairs(ranges), seed, 2000)
    table = {"table": {"distance": [0.2]}, "seed": 3, "count": 1}
    assert choice.scenarios(table) == table


@pytest.mark.parametrize(("scenarios", "holds_there"), [
    ({"set": "test", "count": 64}, True), ({"set": "test", "count": 63}, False), ({"set": "hard", "count": 64}, False),
    ({"ranges": pairs("test"), "seed": 2_000_000, "count": 64}, True),
    ({"ranges": pairs({"distance": [0.2, 0.4]}), "seed": 2_000_000, "count": 64}, False),
])  # fmt: skip
def test_bound_is_shown_only_for_the_scenarios_that_were_searched(scenarios, holds_there):
    assert (matchups.clairvoyant(load_setup("linear-blind"), scenarios) is not None) == holds_there
