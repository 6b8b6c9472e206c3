"""Films of two contestants, for the tests of what they show and of the page that shows them."""

import numpy as np

from agents import load_policy
from agents.baselines import PaperTrapezoid
from agents.evaluate.scenario_batch import ScenarioBatch
from experiments.lab.player import choose, films
from experiments.lab.player.films import COLUMNS
from impact_gym.task import evaluation_sets

CONTESTANTS = {"the paper's <b>rule</b>": PaperTrapezoid(), "learned </script> policy": load_policy("linear-blind")}
COUPLINGS = {"spring": {}, "rigid": {"coupling": {"type": "Rigid"}}, "bistable": {"coupling": {"type": "Bistable"}}}
TEST_SET = evaluation_sets.load("test")


def judged_films(count=40, **environment):
    batch = ScenarioBatch.of("test", count, time_weight=[2.0], quiet=True, **environment)
    played = {name: batch.play(controller) for name, controller in CONTESTANTS.items()}
    numbers = choose(*played.values())
    return films(CONTESTANTS, numbers, played, frozen=TEST_SET, environment=environment), played


def columns(run):
    return dict(zip(COLUMNS, map(np.array, run["rows"]), strict=True))
