"""Sentences, tables and the ablation of the report for a synthetic result, whose numbers follow by hand."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from made_up_matchup import COUNT, PAPER_TIME, SPEEDS, played, run

from agents.setups import load_setup
from experiments.report import answer, choice, holds, tables
from experiments.report.ablation import gains, links, sentence, steps_of, table
from experiments.report.matchups import BOUND, PAPER, POLICY
from experiments.report.played import Run

TOLERANCE_OF_TWO = 26.26  # one-sided 95/95 factor (M. G. Natrella, NBS Handbook 91, table A-7)


def summary(results):
    result = answer.answer(results)
    return result, answer.sentence(result, results.matchup), answer.at_rule_time(result, results)


def test_answer_is_read_where_the_papers_rule_is():
    result, sentence, headline = summary(played())
    for share, expected in ((result.reduction, 0.7), (result.sooner, 1.0 / 3.0), (result.rival_reduction, 0.5)):
        assert (share.value, share.low, share.high) == pytest.approx((expected,) * 3)  # what all share cancels
    assert result.improvement.value == pytest.approx(1.0)
    assert (result.missed, result.episodes) == (0, 2 * COUNT)
    assert result.velocity.value == pytest.approx(0.3 * SPEEDS.mean())
    for said in ("70.0 % [70.0, 70.0] slower", "at least 33.3 % [33.3, 33.3] less time", "50.0 % [50.0, 50.0] slower."):
        assert said in sentence
    assert "70 % slower with the learned policy, with the tuned profile 50 % slower" in headline
    curved = replace(played(), seeds={"seed-0": run((0.2, 0.3, 0.4), (0.5, 0.31, 0.29), (1.0, 2.0, 4.0))})
    assert answer.answer(curved).needed == pytest.approx(8**0.5)  # at 0.3 s, halfway from 2 to 4 on a log scale


def test_of_controllers_that_cannot_be_told_apart_the_simplest_is_taken():
    results = played(("profile", "constant", "local-brake"))
    everyone = (*results.matchup.baselines, results.matchup.policy)
    order = [each.name for each in sorted(everyone, key=choice.simplicity)]
    assert order == [PAPER, "local-brake", "constant", "profile", "seed-0"]
    noise = np.random.default_rng(1).normal(0.0, 0.1, 400)
    for gain, name in ((0.0, "profile"), (0.005, "profile"), (0.03, "policy")):  # m/s; standard error 0.1 / 20 m/s
        costs = {"rule": np.full(400, 2.0), "profile": np.ones(400), "policy": 1.0 - gain + noise - noise.mean()}
        assert choice.simplest(costs) == name


def test_choice_is_made_on_scenarios_of_its_own_and_judged_on_those_of_the_report():
    results = played()
    losses = {PAPER: 1.0 * SPEEDS + 0.6, "profile": 0.6 * SPEEDS + 0.4, "seed-0": 0.4 * SPEEDS + 0.4}  # w = 2
    found = choice.choice(results)
    assert (found.controller, found.time_weight, found.missed) == ("seed-0", 2.0, 0)
    assert found.cost.value == pytest.approx(losses["seed-0"].mean())
    assert found.below_rule.value == pytest.approx(1.0 - losses["seed-0"].mean() / losses[PAPER].mean())
    assert found.above["profile"].value == pytest.approx(losses["profile"].mean() / losses["seed-0"].mean() - 1.0)
    assert f"learned policy. It costs V_p + 2 T = {losses['seed-0'].mean():.3f} m/s" in found.sentence
    assert [row[2] == "best choice" for row in choice.table(found, results).rows] == [False, False, False, True]
    results.choosing["seed-0"] = results.choosing["profile"]  # no better where the choice is made
    assert choice.choice(results).controller == "profile"
    results.choosing = dict.fromkeys(results.choosing, results.paper)
    assert choice.choice(results).controller == PAPER


@pytest.mark.parametrize(("shares", "times", "said", "headline"), [
    ((0.2, 0.4), (0.3, 0.2), "80.0 % [80.0, 80.0] slower at the paper's", "leaves 80 % slower with"),  # just as late
    ((0.2, 0.4), (0.27, 0.2), "it takes 10.0 % less time, and the object leaves 80.0 %",
     "a weight of about 0.74 would match the rule's time. At that smallest weight the object leaves 80 % slower"),
    ((0.2, 0.4), (0.5, 0.33), "it takes 10.0 % more time, and the object leaves 60.0 % [60.0, 60.0] slower",
     "a weight of about 2.3 would match the rule's time. At that largest weight the object leaves 60 % slower"),
    ((1.2, 1.4), (0.4, 0.2), "30.0 % [30.0, 30.0] faster at the paper's", "leaves 30 % faster with the learned policy"),
    ((0.8, 1.4), (0.4, 0.2), "the approach takes 11.1 % [11.1, 11.1] more time", "leaves 10 % faster"),
])  # fmt: skip
def test_answer_says_what_a_curve_does_not_reach(shares, times, said, headline):
    results = played()
    results.seeds["seed-0"] = run(shares, times)
    result, long, short = summary(results)
    assert said in long
    assert headline in short
    assert result.reached == len(result.each) == (times[1] <= PAPER_TIME <= times[0])
    assert tables.answered(result, results).rows[3][1] in long or result.beyond == "faster"
    for soonest, late in ((0.301, True), (0.299, False)):  # s; at first later at every weight
        results.baselines["profile"] = run((0.4, 0.6), (0.5, soonest))
        result, long, _ = summary(results)
        assert (result.rival_reduction is None, "best tuned baseline" not in long) == (late, late)


@pytest.mark.parametrize(("missing", "claimed"), [(3, True), (4, False)])
def test_answer_counts_a_miss_as_no_win_and_claims_nothing_for_more_than_one_in_a_hundred(missing, claimed):
    results = played(seeds=((0.2, 0.4),) * 5)  # 600 episodes
    for k in range(missing):
        results.seeds[f"seed-{k}"] = run((0.2, 0.4), missed=1)
    results.as_late["seed-0"] = run((0.3,), (PAPER_TIME,), (1.4,), missed=6)
    results.as_late["seed-1"] = run((1.0,), (PAPER_TIME,), (1.4,))  # nobody is slower
    result, sentence, headline = summary(results)
    assert result.improvement.value == pytest.approx((3.0 + (1.0 - 6 / COUNT) + 0.5) / 5.0)
    assert result.missed == 2 * missing
    for text in (sentence, headline):
        assert ("nothing is claimed" in text) == (not claimed)
        assert ("slower" in text) == claimed
    assert f"{2 * missing} of 600 objects" in sentence


def test_tolerance_bound_follows_from_the_scatter_of_seeds():
    results = played(seeds=((0.2, 0.4), (0.21, 0.41)))
    result, sentence, _ = summary(results)
    assert (result.reduction.value, *result.each) == pytest.approx((0.695, 0.7, 0.69))
    bound = 69.5 - TOLERANCE_OF_TWO * np.std([70.0, 69.0], ddof=1)
    assert f"(95 % of trainings: at least {bound:.1f} %)" in sentence
    for worse in (run((1.8, 2.0)), run((0.2, 0.4), (0.299, 0.2))):  # no gain in the mean; too soon for the rule's time
        assert "95 % of trainings" not in summary(replace(results, seeds=results.seeds | {"seed-1": worse}))[1]
    losses = np.array([0.2, 0.21]) * SPEEDS.mean() + 1.0 * 0.4
    worst = losses.mean() + TOLERANCE_OF_TWO * losses.std(ddof=1)
    most, reached = tables.by_weight(results).rows[0][5].split(", ")
    assert float(most) == pytest.approx(worst, abs=2e-4)
    assert reached == f"{losses.max():.4f}"


def test_measures_are_means_over_the_same_scenarios():
    results = played()
    results.travelled = {"seed-0": Run((2.0,), {"before": np.full((1, 9), 0.01), "in_all": np.full((1, 9), 0.02)})}
    table = tables.measures(results)
    rows = {row[0]: dict(zip(table.head, row, strict=True)) for row in table.rows}
    row = rows["learned policy, w = 2"]
    assert row["T (s)"] == "0.2000"
    assert row["V_p (m/s)"].startswith(f"{0.4 * SPEEDS.mean():.3f} [")
    assert row["V_p, mean of the worst 5 %"] == f"{0.4 * np.sort(SPEEDS)[-3:].mean():.3f}"
    assert row["impulse (N s)"] == f"{0.4 * (SPEEDS**2).mean():.4f}"  # here the masses are the speeds
    assert row["deflection (mm): 95 % before the touch, largest"] == "10, 20"
    assert rows[PAPER]["deflection (mm): 95 % before the touch, largest"] == "-"


ALTERNATING = np.tile([0.0, 1.0], 50)
TWO_ERRORS = 2.0 * ALTERNATING.std(ddof=1) / 10.0  # of the mean of 100


@pytest.mark.parametrize(("surplus", "missed", "worst", "details"), [
    (0.999, 1, "it is not worse than its rivals under any of 2 single changes.", ""),
    (0.999, 2, "tool mass. At 0.3 kg it misses 2 of 100 objects.",
     "It misses 2 of 100 objects with tool mass at 0.3 kg."),
    (1.001, 2, "tool mass. At 0.2 kg it is worse than the tuned profile, at 0.3 kg it misses 2 of 100 objects.",
     "Worse than the tuned profile with tool mass (0.2 kg). It misses 2 of 100 objects with tool mass at 0.3 kg."),
])  # fmt: skip
def test_where_it_fails_needs_two_standard_errors_or_more_than_one_miss_in_a_hundred(surplus, missed, worst, details):
    results = played(varied={"tool_mass": [0.125, 0.2, 0.3]})
    usual, more = {PAPER: 9.0, "profile": 1.0, "seed-0": 2.0}, surplus * TWO_ERRORS  # where nothing is off, no matter
    noisy = 1.0 + ALTERNATING - ALTERNATING.mean() + more
    losses = {"tool mass: 0.125 kg": usual, "tool mass: 0.2 kg": usual | {"seed-0": noisy},
              "tool mass: 0.3 kg": usual | {"seed-0": 0.5}}  # fmt: skip
    for cell in holds.cells(results.matchup, {"set": "test", "count": 100}):
        change, name = cell.labels["change"], cell.labels["contestant"]
        episodes, velocity = np.arange(100), np.broadcast_to(losses[change][name], 100)
        missing = (episodes < missed) & (name == "seed-0") & (change == list(losses)[-1])
        rows = {"episode": episodes, "object_velocity": velocity, "approach_time": np.zeros(100), "missed": missing}
        results.varied.append((cell.labels, pl.DataFrame(rows | {"cost": velocity + 2.0 * missing})))
    assert holds.where_it_fails(results, "seed-0") == ("the learned policy", worst, details)
    (what, _, cells), (_, tried, at_worst) = holds.heat_map(results).rows
    assert (what, tried) == ("nothing", "2 tried: 0.2 kg to 0.3 kg")
    assert [cell.value for cell in cells] == ["9.00", "1.00", "2.00"]
    assert [cell.ratio for cell in cells] == pytest.approx([1.0, 1.0 / 9.0, 2.0 / 9.0])
    assert (at_worst[2].value, at_worst[2].note) == ("2.00", "unchanged")
    last = ("tool mass", "0.3 kg", POLICY, f"{0.5 + 0.02 * missed:.4f}", "0.5000", "0.0000", f"{missed} of 100")
    assert tuple(holds.table(results).rows[-1]) == last  # a miss costs 2 m/s


def test_report_of_an_operator_gives_slide_and_done_time_of_each_assistance():
    results = played(("local-brake",), **load_setup("teleop-rigid").environment)
    for k, runs in enumerate((results.seeds, results.baselines)):
        for name, each in runs.items():
            more = {"slide": 0.1 * (k + 1), "done_time": 2.0 + k, "touch_time": 1.0, "taken": 0.5}
            runs[name] = run((1.0,) * len(each.weights), (3.0,) * len(each.weights), each.weights, **more)
    results.as_late = {"seed-0": replace(results.policy, weights=(2.0,))}
    text = answer.assisted(results)
    assert "10.0 cm and 2.0 s with the learned policy" in text
    assert "20.0 cm and 3.0 s with the local brake" in text
    table = tables.measures(results)
    row = dict(zip(table.head, table.rows[-2], strict=True))
    assert (row["slide (m)"], row["until the touch (s)"], row["taken"]) == ("0.100", "1.000", "0.500")


PLACE = "knowing where objects can stand and the profile's shape"


def test_steps_gain_the_difference_to_the_step_before():
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
    (run((0.5, 0.7)), run((0.1, 0.3)), ["", "", ""], None, ""),  # the profile gains more than the policy
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
     ["the arm's limits", PLACE, "the estimate", "a profile over the estimate", "learning"]),
])  # fmt: skip
def test_links_join_the_next_step_without_a_baseline(names, noise, added):
    results = played(names, range_noise=noise)
    assert [link.added for link in links(results)][1:] == added
    assert bool(sentence(steps_of(results))) == (len(added) > 1)
    alone = steps_of(played(()))[-1].velocity.value  # the other contestants change no number of the policy
    assert steps_of(results)[-1].velocity.value == alone
