"""Films of each design of a front beside the paper's spring with the paper's rule, in scenarios of the test set."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from agents.baselines.rule import Floats, Rule
from agents.baselines.tuned import RULES
from agents.design.free import as_built, designed
from agents.design.pads import on_pad
from agents.evaluate import RESULTS, Episodes, Stage
from experiments.lab.player import films
from impact_gym.envs import evaluation_sets

PAPER = "paper's spring with the paper's rule"
COUNT = 300  # scenarios, the first of the test set, from which those to watch are chosen
CONTACT = ("contact_stiffness", "restitution")

Told = tuple[Mapping[str, Any], Mapping[str, np.ndarray[Any, Any]]]
"""An entry as `agents.design` tells of it, and what it did on the test set, an array for each result."""


class Contestant(NamedTuple):
    """One design with its controller, and what the study says of its first scenarios."""

    controller: Rule
    environment: dict[str, Any]
    episodes: Episodes
    contact: dict[str, Floats]  # of each scenario with a pad; nothing without


def front(paper: Told, designs: Sequence[Told], tolerance: float) -> dict[str, Any]:
    """Return films for `experiments.lab.player.fragment`: as many scenes for each design, one design after the other.

    Each number of a design is off by a share `tolerance` at the most, as it was in the study.

    Raises:
        RuntimeError: a replay differs from what the study says.
    """
    frozen, scenes = evaluation_sets.load("test"), []
    for told in designs:
        time = f"{told[1]['approach_time'].mean():.3f} s"
        both = {PAPER: contestant(*paper, tolerance), f"designed for {time}": contestant(*told, tolerance)}
        episodes = {name: one.episodes for name, one in both.items()}
        shown = films(
            {name: one.controller for name, one in both.items()},
            {f"{time}: {why}": number for why, number in chosen(*episodes.values()).items()},
            episodes,
            seed=frozen.seed,
            frozen=None if "scenario" in both[PAPER].environment else frozen,
            environments={name: one.environment for name, one in both.items()},
            records={name: one.contact for name, one in both.items()},
        )
        scenes += shown["scenes"]
    return {**shown, "scenes": scenes}


def contestant(entry: Mapping[str, Any], results: Mapping[str, np.ndarray[Any, Any]], tolerance: float) -> Contestant:
    """Return an entry of a study as it was played."""
    environment = designed(entry["environment"], as_built(entry["design"], tolerance))
    controller = RULES[entry["rule"]].of(entry["parameters"]).for_environment(entry["environment"])
    scenario = Stage.of("test", COUNT, threads=1, **environment).play(controller).scenario
    pair = [scenario[name] for name in CONTACT]
    contact = dict(zip(CONTACT, on_pad(entry["pad"], *pair), strict=True)) if entry["pad"] else {}
    judged = {name: results[name][:COUNT] for name in RESULTS}
    return Contestant(controller, environment, Episodes(**judged, scenario=scenario), contact)


def chosen(paper: Episodes, design: Episodes) -> dict[str, int]:
    """Return the scenarios to watch: a typical one, and those where the design gains most and least on the paper's."""
    both = ~(paper.missed.astype(np.bool_) | design.missed.astype(np.bool_))
    touched = np.flatnonzero(both) if both.any() else np.arange(len(both))
    velocity = design.object_velocity[touched]
    gain = paper.object_velocity[touched] - velocity
    return {
        "a typical scenario, V_p is the median": int(touched[np.argsort(velocity, kind="stable")[len(touched) // 2]]),
        "where it gains most": int(touched[gain.argmax()]),
        "where it gains least": int(touched[gain.argmin()]),
    }
