"""One scenario played by the paper's rule, the learned policy and a person: films side by side, and a chart."""

from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np

from agents.evaluate.scenario_batch import TEST_SEED, ScenarioBatch
from agents.setups import load_setup
from experiments.lab import player
from experiments.lab.player.films import COLUMNS, Run, scene_of
from experiments.play.assistance import assistance, environment_of, record_of, usual
from experiments.play.tries import Live, Try, replayed
from impact_gym.render.film import History
from impact_gym.task import Task

SECONDS = 10.0  # length of the first film
FIRST_FILM_SEED, REFERENCES = TEST_SEED + 11, 100


@cache
def rivals(setup: str) -> Mapping[str, str]:
    """Return the assistances with which a scripted operator is compared with a person, where a set-up has them."""
    found = {"paper's rule": "rule"}
    with suppress(ValueError):  # no policy was trained for it
        assistance("policy", load_setup(setup))
        found["learned policy"] = "policy"
    return found


def scripted(setup: str, kind: str, seed: int, record: Mapping[str, float]) -> Try:
    """Return a try of the set-up's operator with an assistance, in the scenario of a seed."""
    operator = dict(load_setup(setup).environment["operator"])
    return Live(Try(setup, kind, seed, dict(record), operator)).finished()


def rivals_of(this: Try) -> dict[str, Try]:
    """Return rule and policy in the scenario of a try, by name."""
    return {name: scripted(this.setup, kind, this.seed, this.record) for name, kind in rivals(this.setup).items()}


def film(this: Try, who: str = "you", seconds: float | None = None) -> str:
    """Return the slow-motion player of a try beside rule and policy; `seconds` is the length of the film."""
    again = {name: replayed(each) for name, each in {**rivals_of(this), who: this}.items()}
    runs = {name: Run(History(*each, ended=True), each[1]) for name, each in again.items()}
    scene = {"label": "one scenario for all", "number": 0, **scene_of(runs)}
    if seconds is not None:
        ends = [start for start, _ in scene["clock"][1:]] + [scene["end"]]
        whole = sum((end - start) * slower for (start, slower), end in zip(scene["clock"], ends, strict=True))
        scene["clock"] = [[start, float(f"{slower * seconds / whole:.3g}")] for start, slower in scene["clock"]]
    return player.fragment({"contestants": list(runs), "columns": list(COLUMNS), "scenes": [scene]})


def first_film(setup: str, latest: Try | None) -> str:
    """Return the film shown before anything is played: the latest try, or one of the set-up's operator."""
    who = "you" if latest else "person (scripted)"
    this = latest or scripted(setup, "none", FIRST_FILM_SEED, record_of(usual(load_setup(setup))))
    return film(this, who, SECONDS)


@cache
def reference(setup: str) -> list[dict[str, Any]]:
    """Return the points of rule and policy on the chart: means over scenarios, with the set-up's operator."""
    made, points = load_setup(setup), []
    task = Task(**{**environment_of(made), "operator": made.environment["operator"], "rtol": 1e-6})
    batch = ScenarioBatch(TEST_SEED, REFERENCES, task, threads=1, quiet=True, lenient=True)
    for name, kind in {**rivals(setup), "scripted, alone": "none"}.items():
        played = batch.play(assistance(kind, made), record_of(usual(made)))
        points.append({"who": name, **{key: float(np.mean(getattr(played, key))) for key in ("done_time", "slide")}})
    return points
