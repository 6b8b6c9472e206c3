"""The steps from the paper's rule to the learned policy, and what a report claims of each."""

from dataclasses import astuple

import pytest
from made_up_comparison import played, run

from experiments.report.ablation import links, steps_of, table
from experiments.report.comparisons import BOUND, PAPER, POLICY


@pytest.mark.parametrize(("policy", "profile", "share", "gap"), [
    (run((0.2, 0.4)), run((0.4, 0.6)), 0.2 / 0.7, ""),
    (run((0.2, 0.4)), run((0.5, 0.6), (0.25, 0.2)), None, "50 ms sooner"),
    (run((0.2, 0.4)), run((0.4, 0.4), (0.5, 0.35)), None, "50 ms later"),
    (run((0.2, 0.4), missed=1), run((0.4, 0.6)), None, ""),  # more than one in a hundred
    (run((0.5, 0.7)), run((0.1, 0.3)), None, ""),  # the profile gains more than the policy
    (run((0.3, 0.4), (0.25, 0.2)), run((0.4, 0.6)), None, ""),  # the whole gain is unknown
])  # fmt: skip
def test_steps_claim_only_what_is_read_at_the_rules_time(policy, profile, share, gap):
    results = played()
    results.seeds["seed-0"], results.baselines["profile"] = policy, profile
    results.bound = {BOUND: run((0.1, 0.1), weights=(7.0, 8.0))}  # not searched at the typical weight, so no step
    first, *steps = steps_of(results)
    assert gap in table([first, *steps], {}).rows[2][2]
    shares, less = [step.velocity.share for step in steps], [step.velocity.less for step in steps]
    if share is None:
        assert shares == [None] * 3
    else:
        assert astuple(shares[-1]) == pytest.approx((share,) * 3)
    assert (less == [None] * 3) == (any(step.later for step in steps) or policy.stacked("missed").any())


def test_links_join_the_next_step_without_a_baseline():
    at_rest, place = "the arm's limits", "knowing where objects can stand"
    for names, noise, added in (
        (("profile", "evenly", "constant"), None, [at_rest, place, "the profile's shape", "learning"]),
        (("over", "range", "profile", "constant"), 0.01,
         [at_rest, f"{place} and the profile's shape", "the estimate", "a profile over the estimate", "learning"]),
    ):  # fmt: skip
        assert [link.added for link in links(played(names, range_noise=noise))][1:] == added
    two_of_a_rule = links(played(("profile", "other")))
    assert [link.contestant for link in two_of_a_rule] == [PAPER, "profile", "other", POLICY]


def test_learning_is_compared_with_the_cheapest_baseline():
    results = played(("profile", "filter"))
    for shares, before in (((0.1, 0.2), "filter"), ((0.5, 0.7), "profile")):  # the profile's: 0.4 and 0.6
        results.baselines["filter"] = run(shares)
        assert links(results)[-2].contestant == before
        *_, best, learning = steps_of(results)
        assert learning.loss.less.value == pytest.approx(best.loss.value.value - learning.loss.value.value)
        assert (learning.velocity.share.value < 0.0) == (before == "filter")
