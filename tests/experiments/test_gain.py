"""What the gain is made of: priors that theory knows the answer of, and the page."""

import numpy as np
import pytest
from pages import text_of_a_page_that_stands_on_its_own

from agents.evaluate import ScenarioBatch
from experiments.gain import __main__ as gain
from experiments.gain import blind, priors, worlds
from experiments.lab import experiment
from experiments.lab.tables import rows_of


def test_places_are_those_of_the_prior():
    uniform, memoryless = priors.Prior(0.15, 0.35), priors.Prior(0.001, 0.6, memoryless=True)
    assert np.sort(uniform.distances(1, 400)) == pytest.approx(0.15 + 0.2 * (np.arange(400) + 0.5) / 400)
    away = memoryless.distances(1, 100_000) - 0.001
    assert away.mean() == pytest.approx(memoryless.mean, rel=1e-3)
    for gone in (0.1, 0.3):  # what is left is distributed alike, however far one has come
        assert (away[away > gone] - gone).mean() == pytest.approx(memoryless.mean, rel=1e-2)
    assert (away < 0.599).mean() == pytest.approx(0.95, abs=1e-3)


def test_steady_rule_keeps_its_speed_wherever_it_is():
    numbers = [0.4, 15.0, *(parameter.start for parameter in priors.REACTION)]
    played = ScenarioBatch.of("test", 20).play(priors.Steady(numbers))
    ramp = 0.4 / 15.0  # s, in which it gets half as far as at full speed
    assert played.approach_time == pytest.approx(played.scenario["distance"] / 0.4 + ramp / 2, abs=2e-2)


@pytest.mark.filterwarnings("ignore:SpringDamper.stroke")
def test_page_says_shares_that_add_up(tmp_path):
    few, made = priors.Effort((0.7, 3.0), scenarios=10, generations=3, tested=20, seeds=2, steps=40_000), {}

    def compute(gather):
        played = [{"setup": "linear-blind", "world": world, "contestant": who, "count": 8}
                  for world in ("friction 0.3", "stroke 20 mm") for who in (worlds.RULE, "policy")]  # fmt: skip
        made["worlds"] = [row for each in played for row in rows_of(worlds.played(**each))]
        effort = blind.Effort(scenarios=10, corners=1, generations=2)
        bound = blind.rows(gather, effort, ["linear-blind"])
        return made | {"priors": priors.rows(gather, few, priors.PRIORS[3:4]), "blind": bound}

    show = lambda tables: gain.shown(made.setdefault("all", tables))  # noqa: E731
    experiment.run("gain", tmp_path, "test", compute, show, processes=0)
    text = text_of_a_page_that_stands_on_its_own(tmp_path, figures=1)
    assert "from knowing where objects can stand" in text
    assert "profile above it" in text
    (line,) = priors.table(made["all"]["priors"])
    assert line["limits"].value + line["place"].value == pytest.approx(line["all"].value, rel=1e-12)
    assert line["velocity"][0].value > line["velocity"][1].value
    policies = [row for row in made["all"]["priors"] if row["rule"] == "policy"]
    assert len(policies) == 2 * (2 + len(priors.WEIGHTS)) * 20  # seeds, weights and scenarios
    assert line["learning"].value == pytest.approx(1.0 - line["velocity"][3].value / line["velocity"][2].value)


def test_nobody_blind_is_below_the_bound_and_finer_corners_only_lower_it():
    few = {"scenarios": 15, "corners": 2, "generations": 4}
    for setup in blind.BINS:
        found = rows_of(blind.searched(setup, blind.BINS[setup], 2.0, **few))
        found += [row for who in (blind.RULE, blind.PROFILE, "seed 0", "seed 1")
                  for row in rows_of(blind.played(setup, 2.0, few["scenarios"], who))]  # fmt: skip
        (line,) = blind.table(found)
        coarse, fine = line["bounds"]
        assert fine <= coarse + 1e-6 < line["least"]  # searched at a larger tolerance than judged
        assert all(above.value > 0.0 for above in line["above"])


def test_shared_motion_ends_with_the_first_reading_and_does_not_begin_again():
    rule = blind.shared(blind.KNOTS)([0.3] * len(blind.KNOTS) + [20.0, -0.5, -0.5, -0.5, -0.5, 20.0])
    seen, state, low = np.zeros((2, len(rule.spec)), np.float32), None, -1.0  # -0.5 m/s
    seen[:, rule.spec.index("velocity")] = rule.spec.encode("velocity", np.full(2, 0.3))
    for force in (0.0, 1e-3, 0.0):
        seen[1, rule.spec.index("force")] = rule.spec.encode("force", force)
        actions, state = rule.predict(seen, state)
        assert actions[0, 0] == pytest.approx(low + 0.8, abs=1e-6)  # 0.3 m/s of -0.5 to 1.5
        assert actions[1, 0] == pytest.approx(low if np.isfinite(state[1]) else low + 0.8, abs=1e-6)
    assert np.isfinite(state).tolist() == [False, True]
