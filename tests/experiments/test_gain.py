"""What the gain is made of: priors that theory knows the answer of, and the page."""

import numpy as np
import pytest
from pages import text_of_a_page_that_stands_on_its_own

from agents.evaluate import ScenarioBatch
from experiments.gain import __main__ as gain
from experiments.gain import priors, worlds
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
    few, made = priors.Effort((0.7, 3.0), scenarios=10, generations=3, tested=20), {}

    def compute(gather):
        played = [{"setup": "linear-blind", "world": world, "contestant": who, "count": 8}
                  for world in ("friction 0.3", "stroke 20 mm") for who in (worlds.RULE, "policy")]  # fmt: skip
        made["worlds"] = [row for each in played for row in rows_of(worlds.played(**each))]
        return made | {"priors": priors.rows(gather, few, priors.PRIORS[3:4])}

    show = lambda tables: gain.shown(made.setdefault("all", tables))  # noqa: E731
    experiment.run("gain", tmp_path, "test", compute, show, processes=0)
    text = text_of_a_page_that_stands_on_its_own(tmp_path, figures=1)
    assert "from knowing where objects can stand" in text
    (line,) = priors.table(made["all"]["priors"])
    assert line["limits"].value + line["place"].value == pytest.approx(line["all"].value, rel=1e-12)
    assert line["velocity"][0].value > line["velocity"][1].value
