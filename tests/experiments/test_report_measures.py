"""What the jobs of the report measure: a policy as late as the rule, its profile, bars, what a limit of force costs."""

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
from agents.evaluate.play import play
from agents.setups import load_setup
from agents.setups.evaluation import Evaluation
from experiments.lab.statistics import Estimate
from experiments.report import answer, differences, first_screen, matchups, measures, shield
from experiments.report.bars import Bar, bars, table
from experiments.report.matchups import PAPER, Contestant, Matchup
from experiments.report.played import Played, Run
from impact_gym.task import evaluation_sets
from impact_gym.task.scenario import FIELDS

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


def test_report_of_an_operator_tells_of_slide_and_of_when_all_is_done_with_each_assistance():
    setup = load_setup("teleop-rigid")
    matchup = replace(matchups.of_setup(setup, {"set": "test", "count": 12}), evaluation=setup.evaluation)
    played = Played(matchup)
    for contestant in (*matchup.baselines, matchup.policy):
        arrays = play(contestant.controller, matchup.scenarios, [matchup.typical], matchup.environment)
        where = played.seeds if contestant is matchup.policy else played.baselines
        where[contestant.name] = Run((matchup.typical,), arrays)
    played.as_late[matchup.chosen] = played.policy
    alone, text = played.baselines["operator-alone"], first_screen.assisted(played)
    assert f"{100 * alone['slide'].mean():.1f} cm and {alone['done_time'].mean():.1f} s with the operator alone" in text
    assert all(f"with {name}" in text for name in ("the learned policy", PAPER, "the local brake"))
    table = differences.measures(played)
    rows = {row[0]: dict(zip(table.head, row, strict=True)) for row in table.rows}
    row = rows["the operator alone (operator-alone)"]
    assert row["slide (m)"] == f"{alone['slide'].mean():.3f}"
    assert float(row["until the touch (s)"]) < float(row["T (s)"]) == pytest.approx(alone["done_time"].mean(), abs=1e-4)
    assert matchup.until == "all is done"
    assert LINEAR.until == "the touch"


def test_profile_is_the_flanges():
    profile = measures.profile(PAPERS_RULE, {}, [2.0], 0.36)
    x = profile["position"]
    reached = x < 0.35  # the tool swings ahead of the flange and touches first
    assert profile["velocity"][0][reached] == pytest.approx(np.minimum(np.sqrt(16.0 * x), 1.0)[reached], abs=2e-3)


def test_tool_lags_behind_the_rule_as_a_critically_damped_spring_does():
    """At 8 m/s^2 for 0.125 s, then none: it lags most a little later; every object stands beyond that."""
    a, omega, ramp = 8.0, 20.0, 0.125
    lag, rate = a / omega**2 * (1.0 - (1.0 + omega * ramp) * np.exp(-omega * ramp)), a * ramp * np.exp(-omega * ramp)
    later = rate / omega / (rate + omega * lag)  # s
    most = (lag + (rate + omega * lag) * later) * np.exp(-omega * later)
    travelled = measures.travelled(PAPERS_RULE, LINEAR.environment, SCENARIOS, 2.0)
    assert travelled["before"] == pytest.approx(most, rel=5e-3)  # watched four times in a control step
    assert (travelled["in_all"] > travelled["before"]).any()


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


COUNT, WEIGHTS = 400, (1.0, 4.0)
RNG = np.random.default_rng(0)
SPEEDS = RNG.uniform(0.5, 5.0, COUNT)


def run(share, weights, missed=0):
    """A contestant whose V_p is a `share` of the same objects' speeds, and whose approach takes 0.3 s."""
    shape = (len(weights), COUNT)
    missing = np.zeros(shape, bool)
    missing[0, :missed] = True
    results = {"object_velocity": np.broadcast_to(share * SPEEDS, shape), "approach_time": np.full(shape, 0.3)}
    others = dict.fromkeys(("peak_force", "contact_count", *FIELDS), np.ones(shape))
    return Run(weights, {**results, **others, "missed": missing})


def played(name, late, evaluation, shares=(1.1, 0.8, 0.95)):
    """Three seeds, the middle one chosen, against the paper's rule and two tuned baselines."""
    seeds = tuple(Contestant(f"seed-{k}", {}, WEIGHTS, "") for k in range(3))
    rivals = [Contestant(PAPER, {}, (2.0,), ""), *(Contestant(rival, {}, WEIGHTS, "") for rival in ("slow", "slower"))]
    results = Played(Matchup(name, {}, seeds, "seed-1", tuple(rivals), {}, {}, "", evaluation))
    results.baselines = {PAPER: run(1.0, (2.0,)), "slow": run(0.9, WEIGHTS), "slower": run(0.85, WEIGHTS)}
    results.seeds = {f"seed-{k}": run(share, WEIGHTS, missed=k) for k, share in enumerate(shares)}
    results.as_late = {f"seed-{k}": run(late * share, (2.0,)) for k, share in enumerate(shares)}
    return results


def test_bars_compare_with_rule_and_best_baseline_and_count_misses():
    results = played("one", 0.5, Evaluation(weights=WEIGHTS, at_most=0.42))
    first, *ratios, missed = bars(results, [results])
    assert first.reached == pytest.approx({"seed-0": 0.55, "seed-1": 0.4, "seed-2": 0.475})
    assert (first.interval.low, first.interval.high) == pytest.approx((0.4, 0.4))  # pairs leave nothing open
    assert first.verdict == "met"
    for bar, weight in zip(ratios, WEIGHTS, strict=True):
        assert bar.what == f"V_p + w T over that of slower, w = {weight:g}"
        expected = (0.95 * SPEEDS.mean() + 0.3 * weight) / (0.85 * SPEEDS.mean() + 0.3 * weight)
        late = 2.0 * 2 / COUNT if weight == 1.0 else 0.0  # what two misses cost
        assert bar.reached["seed-2"] == pytest.approx(expected + late / (0.85 * SPEEDS.mean() + 0.3 * weight))
    assert missed.reached == {"seed-0": 0.0, "seed-1": 1.0, "seed-2": 2.0}
    assert missed.verdict == "missed"
    rows = table([first, *ratios, missed]).rows
    assert rows[0] == (first.what, "0.42", "0.400 [0.400, 0.400]", "0.4, 0.475, 0.55", "1 of 3", "met")
    assert rows[-1][1:] == ("0", "1", "0, 1, 2", "1 of 3", "missed")


def test_bars_compare_with_another_set_up_only_if_it_is_played():
    measure = played("other", 0.5, Evaluation())
    results = played("one", 0.25, Evaluation(weights=WEIGHTS, at_most=1.0, of="other"))
    first = bars(results, [measure, results])[0]
    assert first.what.startswith("V_p over that of the policy of other")
    assert first.reached["seed-1"] == pytest.approx(0.5)
    assert bars(results, [results])[0].what.startswith("V_p + w T")  # alone there is nothing to measure it against


def test_bars_of_nominal_set_ups_compare_with_another_arm_and_under_changes_with_the_rule():
    evaluation = Evaluation(weights=WEIGHTS, at_most=1.02, of="linear-blind", nominal={"tool_mass": 0.2},
                            varied={"tool_mass": [0.1, 0.2, 0.3]})  # fmt: skip
    results = played("one", 0.5, evaluation)
    results.nominal = {f"seed-{k}": run(share, WEIGHTS) for k, share in enumerate((0.6, 0.51, 0.5))}
    results.nominal["linear-blind"] = run(0.5, WEIGHTS)
    for label, share, missed in (("0.1", 0.3, 0), ("0.2", 0.5, 2), ("0.3", 1.2, 1)):
        results.varied["tool_mass", label, "seed-1"] = run(share, (2.0,), missed)
        results.varied["tool_mass", label, PAPER] = run(1.0, (2.0,))
    first, second, rule, missed, *_ = bars(results, [results])
    for bar, weight in ((first, 1.0), (second, 4.0)):
        assert f"linear-blind's policy, w = {weight:g}" in bar.what
        base = SPEEDS.mean()
        assert bar.reached["seed-0"] == pytest.approx((0.6 * base + 0.3 * weight) / (0.5 * base + 0.3 * weight))
        assert bar.at_most == 1.02
    penalty = 2.0 * 1 / COUNT  # what a miss costs
    expected = (1.2 * SPEEDS.mean() + 0.3 + penalty) / (SPEEDS.mean() + 0.3)  # w = 1, of theirs the nearest to 2
    assert rule.reached == {"seed-1": pytest.approx(expected)}
    assert (rule.at_most, rule.verdict) == (1.0, "missed")
    assert missed.reached == {"seed-1": 2 / COUNT}
    assert (missed.at_most, missed.verdict) == (1 / 500, "missed")


@pytest.mark.parametrize(("interval", "verdict"), [
    ((0.9, 0.8, 0.95), "met"),
    ((0.99, 0.98, 1.01), "met, within the interval"),
    ((1.01, 0.99, 1.02), "missed, within the interval"),
    ((1.1, 1.05, 1.2), "missed"),
])  # fmt: skip
def test_verdict_says_what_the_interval_leaves_open(interval, verdict):
    assert Bar("a ratio", 1.0, "seed-0", Estimate(*interval), {"seed-0": interval[0]}).verdict == verdict


RIGID = matchups.of_setup(load_setup("rigid-blind"), {"set": "test", "count": 60})


def run_of(matchup, contestant):
    played = play(contestant.controller, matchup.scenarios, [matchup.typical], matchup.environment)
    return Run((matchup.typical,), played)


def played_of(matchup):
    unshielded = run_of(matchup, matchup.policy)
    shields = {(limit, contestant.name): run_of(matchup, contestant) for limit, contestant in shield.shielded(matchup)}
    return Played(matchup, seeds={matchup.chosen: unshielded}, baselines={PAPER: unshielded}, shielded=shields)


def test_shield_table_keeps_forces_below_the_limit_and_counts_those_without_it():
    played = played_of(RIGID)
    unshielded, *rows = shield.table(played).rows
    forces = played.policy["peak_force"][0]
    assert float(unshielded[3]) == pytest.approx(forces.max(), abs=0.05)
    assert len(rows) == 2 * len(shield.LIMITS)
    for limit, _, _, largest, above_limit, *_ in rows:
        assert float(largest) <= float(limit)
        assert above_limit.split(", ")[0] == "0"
    without = [row[4] for row in rows if row[2] == matchups.POLICY]
    assert without == [f"0, {(forces > limit).sum()} without it" for limit in shield.LIMITS]
    assert (forces > shield.LIMITS[0]).any()


def test_shield_is_left_out_with_a_reason():
    robot = {"type": "Robot", "mass": 5.0, "stiffness": 1e5, "damping": 50.0}
    compliant = replace(RIGID, environment={**RIGID.environment, "robot": robot})
    assert not list(shield.shielded(compliant))
    assert all("a rigid robot" in reason for reason in shield.speeds(compliant).values())
    unknown = replace(RIGID, scenarios={"table": {}, "count": 60})
    assert not list(shield.shielded(unknown))
    run = run_of(RIGID, RIGID.policy)
    table = shield.table(Played(unknown, seeds={RIGID.chosen: run}, baselines={PAPER: run}))
    assert all("from no ranges that are known" in row[1] for row in table.rows[1:])
