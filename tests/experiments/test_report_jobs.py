"""What a report plays: refusals, scenarios of choice and bound, and measurements against closed forms."""

import pytest

from agents.evaluate.play import pairs, play
from agents.setups import load_setup
from experiments.report import choice, jobs, matchups
from experiments.report.__main__ import ReportOptions, write


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


RULES = """
idle = 3
class Crooked:
    def predict(self, observation, **more):
        return observation, None
"""
OURS = {"policy": ("linear-blind",)}


@pytest.mark.parametrize(("wanted", "message"), [
    *[(OURS | {"baseline": names}, message) for names, message in (
        (("my_rules:idle",), "no controller"), (("nowhere:x",), "no controller"), (("my_rules",), "module:object"),
        (("my_rules:Crooked",), "must return actions"),
        (("blind-profile", "blind-profile"), "each baseline once"), (("paper-trapezoid",), "always included"),
        (("blind-profil",), "'blind-profil': blind-profile[?]"),
    )],
    *[(OURS | {"scenarios": text}, message) for text, message in (
        ('{"tool": 1}', "tool"), ('{"ranges": {"mass": 1}}', "mass"), ("{", "not read"),
        ('{"environment": {"time_weight": 3}}', "leave out.*time_weight"),
        ('{"environment": [1]}', "environment must be a mapping"),
    )],
    ({"policy": ("linear-ranged",), "scenarios": '{"environment": {"range_noise": null}}'}, "network takes 9.*has 8"),
    ({"scenarios": '{"environment": {"tool_mass": 1.0}}'}, "--policy"),
    ({"scenarios": "nowhere"}, "nowhere"),
    ({"policy": ("linear-blind", "agents/policies/linear-blind.npz")}, "two policies"),
    ({"count": 2001}, "at most 2000"),
    ({"count": 1}, r"count.*at least 2"),
    ({"processes": -1}, r"processes.*at least 0"),
    ({"baseline": ("ranged",)}, "baseline needs --policy"),
    ({"setups": ("linear-blind",), **OURS}, "not both"),
    ({"out": "my_rules.py", "force": True}, r"out must be a folder.*my_rules.py is a file"),
    ({"out": "my_rules.py/out"}, r"out must be a folder.*my_rules.py is a file"),
    ({"out": ".", "force": True}, "out must be a new or empty folder"),
])  # fmt: skip
def test_report_refuses_before_playing(wanted, message, tmp_path, monkeypatch):
    (tmp_path / "my_rules.py").write_text(RULES)
    monkeypatch.syspath_prepend(tmp_path)
    if wanted.get("scenarios", "").startswith("{"):
        (tmp_path / "mine.json").write_text(wanted["scenarios"])
        wanted = {**wanted, "scenarios": str(tmp_path / "mine.json")}
    with pytest.raises(ValueError, match=message):
        write(ReportOptions(**{**wanted, "out": tmp_path / wanted.get("out", "out")}))
    assert not (tmp_path / "out").exists()
