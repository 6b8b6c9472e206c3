"""The report's table of what a limit of force costs."""

from dataclasses import replace

import pytest

from agents.evaluate.play import play
from agents.setups import load_setup
from experiments.report import matchups, shield
from experiments.report.matchups import PAPER
from experiments.report.played import Played, Run

COUNT = 60
RIGID = matchups.of_setup(load_setup("rigid-blind"), {"set": "test", "count": COUNT})


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
    unknown = replace(RIGID, scenarios={"table": {}, "count": COUNT})
    assert not list(shield.shielded(unknown))
    run = run_of(RIGID, RIGID.policy)
    table = shield.table(Played(unknown, seeds={RIGID.chosen: run}, baselines={PAPER: run}))
    assert all("from no ranges that are known" in row[1] for row in table.rows[1:])
