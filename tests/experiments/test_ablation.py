"""The ablation: steps add up, intervals agree with a plain bootstrap, and nothing is claimed at different times."""

import numpy as np
import pytest
from contest import COUNT, PAPER_TIME, SPEEDS, played, run

from experiments.report.ablation import gains, links, sentence, steps_of, table
from experiments.report.matchups import BOUND, PAPER
from experiments.report.played import Run

PLACE = "knowing where objects can stand and the profile's shape"


def test_steps_steps_gain_the_difference_to_the_step_before():
    first, *steps = steps_of(played())
    mean = SPEEDS.mean()
    assert (first.contestant, first.velocity.less, first.velocity.share) == (PAPER, None, None)
    assert [step.added for step in steps] == ["the arm's limits", PLACE, "learning"]
    assert [step.contestant for step in steps] == ["constant", "profile", "learned policy"]
    assert first.loss.value.value == pytest.approx(mean + 2.0 * PAPER_TIME)
    for step, share, less, cost in zip(steps, (0.7, 0.5, 0.3), (0.3, 0.2, 0.2), (0.2, 0.0, 0.0), strict=True):
        assert step.velocity.value.value == pytest.approx(share * mean)
        assert step.velocity.less.value == pytest.approx(less * mean)
        gain = step.velocity.share
        assert (gain.value, gain.low, gain.high) == pytest.approx((less / 0.7,) * 3)  # what all share cancels
        assert step.loss.value.value == pytest.approx((share + 0.1) * mean + 2.0 * 0.2)  # at w = 2, after 0.2 s
        assert step.loss.less.value == pytest.approx(0.2 * mean + cost)
    text = sentence([first, *steps])
    for words in ("42.9 % [42.9, 42.9] from the arm's limits", "28.6 % [28.6, 28.6] from learning"):
        assert words in text


def test_gains_add_up_to_the_whole_in_every_resample():
    rng = np.random.default_rng(1)
    for resample in rng.uniform([1.0, 0.1, 0.1, 0.1, 0.1], [2.0, 1.0, 1.0, 1.0, 1.0], (50, 5)):
        values = [np.array(pair) for pair in zip((1.0, 0.8, 0.5, 0.4, 0.3), resample, strict=True)]
        steps = gains(values, policy=3)[1:4]  # of one resample the interval is that resample
        assert sum(step.less.low for step in steps) == pytest.approx(resample[0] - resample[3])
        for side in ("value", "low", "high"):
            assert sum(getattr(step.share, side) for step in steps) == pytest.approx(1.0)


def test_steps_intervals_match_a_plain_bootstrap_over_seeds_and_scenarios():
    rng, seeds = np.random.default_rng(2), 6
    results = played(seeds=((0.2, 0.4),) * seeds)
    for contestant in [*results.seeds.values(), *results.baselines.values()]:
        for name in ("object_velocity", "approach_time"):
            contestant.arrays[name] *= rng.uniform(0.9, 1.1) * rng.uniform(0.8, 1.2, contestant[name].shape)
    results.paper.arrays["approach_time"] *= rng.uniform(0.2, 1.8, COUNT)  # so that it matters when the fronts are read

    def resampled(scenarios, chosen):
        def mean(runs, name):
            return np.mean([run[name][:, scenarios].mean(axis=1) for run in runs], axis=0)

        time = mean([results.paper], "approach_time")[0]
        contestants = [[results.paper], [results.baselines["constant"]], [results.baselines["profile"]], chosen]
        velocities = []
        for runs in contestants:
            line = sorted(zip(mean(runs, "approach_time"), mean(runs, "object_velocity"), strict=True))
            velocities.append(np.interp(time, *zip(*line, strict=True)))
        less = -np.diff(velocities)
        return less, less / (velocities[0] - velocities[-1])

    def drawn(units):  # one less than there are, as in `Resamples`
        return rng.choice(units, units - 1)

    all_seeds = list(results.seeds.values())
    plain = [resampled(drawn(COUNT), [all_seeds[k] for k in drawn(seeds)]) for _ in range(4000)]
    for place, part in enumerate(("less", "share")):
        low, high = np.percentile([resample[place] for resample in plain], [2.5, 97.5], axis=0)
        for step, *ends in zip(steps_of(results)[1:], low, high, strict=True):
            interval = getattr(step.velocity, part)
            assert (interval.low, interval.high) == pytest.approx(ends, abs=0.08 * (ends[1] - ends[0]))
    exact = resampled(np.arange(COUNT), all_seeds)[0]
    assert [step.velocity.less.value for step in steps_of(results)[1:]] == pytest.approx(exact)


def test_steps_compares_the_clairvoyant_on_its_searched_scenarios():
    results = played(seeds=((0.2, 0.4), (0.1, 0.3)))
    results.bound = run((0.05, 0.15), count=20)
    *_, policy, knows = steps_of(results)
    assert (policy.scenarios, knows.scenarios, knows.contestant) == (COUNT, 20, BOUND)
    subset_mean = SPEEDS[:20].mean()
    assert knows.velocity.value.value == pytest.approx(0.1 * subset_mean)
    assert knows.velocity.less.value == pytest.approx((0.25 - 0.1) * subset_mean)
    assert knows.velocity.share.value == pytest.approx(0.15 / 0.75)
    results.bound = Run((7.0, 8.0), results.bound.arrays)
    assert steps_of(results)[-1].contestant == policy.contestant  # not searched at the typical weight


@pytest.mark.parametrize(("policy", "profile", "limits", "said", "gap"), [
    (run((0.2, 0.4)), run((0.5, 0.6), (0.25, 0.2)), ["", "at least ", "at most "], "at least 28.6 %", "50 ms sooner"),
    (run((0.2, 0.4)), run((0.4, 0.5), (0.5, 0.35)), ["", "", ""], "V_p + 2 T", "50 ms later"),
    (run((0.2, 0.4), missed=1), run((0.4, 0.6)), ["", "", ""], None, ""),  # more than one in a hundred
    (run((0.9, 1.1)), run((0.4, 0.6)), ["", "", ""], None, ""),  # nothing is gained
    (run((0.3, 0.4), (0.25, 0.2)), run((0.4, 0.6)), ["", "", "at least "], None, ""),  # the whole gain is unknown
])  # fmt: skip
def test_steps_claim_only_what_is_read_at_the_papers_time(policy, profile, limits, said, gap):
    results = played()
    results.seeds["seed-0"], results.baselines["profile"] = policy, profile
    first, *steps = steps_of(results)
    assert [step.limit for step in steps] == limits
    assert gap in table([first, *steps], {}).rows[2][2]
    shares, text = [step.velocity.share for step in steps], sentence([first, *steps])
    if said is None:
        assert (shares, text) == ([None] * 3, "")
    else:
        assert said in text
        assert (shares == [None] * 3) == ("later" in gap) == ([step.velocity.less for step in steps] == [None] * 3)


@pytest.mark.parametrize(("names", "noise", "added"), [
    ((), None, [f"the arm's limits and {PLACE} and learning"]),
    (("profile",), None, [f"the arm's limits and {PLACE}", "learning"]),
    (("profile", "evenly", "constant"), None,
     ["the arm's limits", "knowing where objects can stand", "the profile's shape", "learning"]),
    (("profile", "constant"), 0.01, ["the arm's limits", PLACE, "the estimate and learning"]),
    (("over", "range", "profile", "constant"), 0.01,
     ["the arm's limits", PLACE, "the estimate", "a profile over it", "learning"]),
])  # fmt: skip
def test_links_join_the_next_step_without_a_baseline(names, noise, added):
    results = played(names, range_noise=noise)
    assert [link.added for link in links(results)][1:] == added
    assert bool(sentence(steps_of(results))) == (len(added) > 1)
    alone = steps_of(played(()))[-1].velocity.value  # the other contestants change no number of the policy
    assert steps_of(results)[-1].velocity.value == alone
