"""What the gain is made of: priors that theory knows the answer of, and shares that add up."""

import numpy as np
import polars as pl
import pytest
from studies import small_run

from agents.evaluate import ScenarioBatch
from experiments.studies import gain


def test_places_are_those_of_the_prior():
    uniform, memoryless = gain.Prior(0.15, 0.35), gain.Prior(0.001, 0.6, memoryless=True)
    assert np.sort(uniform.distances(1, 400)) == pytest.approx(0.15 + 0.2 * (np.arange(400) + 0.5) / 400)
    away = memoryless.distances(1, 100_000) - 0.001
    assert away.mean() == pytest.approx(memoryless.mean, rel=1e-3)
    for gone in (0.1, 0.3):  # what is left is distributed alike, however far one has come
        assert (away[away > gone] - gone).mean() == pytest.approx(memoryless.mean, rel=1e-2)
    assert (away < 0.599).mean() == pytest.approx(0.95, abs=1e-3)


def test_steady_rule_keeps_its_speed_wherever_it_is():
    numbers = [0.4, 15.0, *(parameter.start for parameter in gain.REACTION)]
    played = ScenarioBatch.of("test", 20).play(gain.Steady(numbers))
    ramp = 0.4 / 15.0  # s, in which it gets half as far as at full speed
    assert played.approach_time == pytest.approx(played.scenario["distance"] / 0.4 + ramp / 2, abs=2e-2)


def test_search_prefers_a_gentle_touch_to_none_however_little_time_costs():
    assert not gain.searched((0.15, 0.35), "steady", 0.05, 20, 12, 50)["missed"].any()


@pytest.mark.filterwarnings("ignore:SpringDamper.stroke")
def test_shares_add_up_and_worlds_differ_where_they_should(tmp_path):
    few = {"scenarios": 10, "generations": 3, "tested": 20}
    searches = [cell for cell in gain.searches(True, {}) if cell.labels["near"] == 0.15]
    searches = [cell._replace(arguments=cell.arguments | few) for cell in searches]
    assert len(searches) == 1 + 2 * len(gain.QUICK_WEIGHTS)
    asked = {("linear-blind", world) for world in ("as trained", "friction 0.3", "stroke 20 mm")}
    worlds = [cell for cell in gain.worlds(True, {}) if (cell.labels["setup"], cell.labels["change"]) in asked]
    worlds = [cell._replace(arguments=cell.arguments | {"scenarios": {"set": "test", "count": 8}}) for cell in worlds]
    run = small_run(gain.STUDY, tmp_path, priors=searches, worlds=worlds)
    run.write()
    (line,) = gain.by_prior(run.frames["priors"])
    assert line["limits"].value + line["place"].value == pytest.approx(line["all"].value, rel=1e-12)
    rows = gain.priors_section([line | {"missed": share} for share in (0.01, 0.011)]).parts[0].rows
    assert ["missed" in row[0] for row in rows] == [False, True]
    rule, steady, profile = line["velocity"]
    assert rule.value == pytest.approx(run.frames["priors"].filter(rule="rule")["object_velocity"].mean())
    assert (line["limits"].value, line["profile"].value) == pytest.approx(
        ((rule.value - steady.value) / rule.value, 1.0 - profile.value / steady.value)
    )
    frame, names = run.frames["worlds"], [gain.RULE, gain.PROFILE, gain.POLICY]
    assert frame["contestant"].unique(maintain_order=True).to_list() == names
    assert frame.filter(pl.col("slide").is_null())["change"].unique().sort().to_list() == ["as trained", "stroke 20 mm"]
    table = {(row["world"], row["contestant"]): row for row in gain.by_world(frame)}
    for who in names:
        assert table["as trained", who]["slides (cm)"] == "-" != table["friction 0.3", who]["slides (cm)"]
        trained, ends = (frame.filter(change=world, contestant=who) for world in ("as trained", "stroke 20 mm"))
        assert not trained["object_velocity"].equals(ends["object_velocity"])
