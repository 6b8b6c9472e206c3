"""Films of each design of a front beside the paper's spring with the paper's rule, in scenarios of the test set."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.evaluate import RESULTS, Episodes
from experiments.design.run import Entry
from experiments.design.search import CONTACT
from experiments.lab.player import films
from impact_gym.task import evaluation_sets
from impact_gym.task.scenario import FIELDS

PAPER = "paper's spring with the paper's rule"
COUNT = 300  # scenarios, the first of the test set, from which those to watch are chosen


def front(paper: Entry, designs: Sequence[Entry], tolerance: float) -> dict[str, Any]:
    """Return films for `experiments.lab.player.fragment`: equally many scenes for each design, one after the other.

    Each number of a design is off by a share `tolerance` at the most, as it was in the study.

    Raises:
        RuntimeError: a replay differs from the study's results.
    """
    frozen, scenes, shown = evaluation_sets.load("test"), [], {}
    for design in designs:
        time = f"{design.mean('approach_time'):.3f} s"
        both = {PAPER: paper, f"designed for {time}": design}
        environments = {name: entry.rig.built(tolerance) for name, entry in both.items()}
        played = {name: episodes(entry) for name, entry in both.items()}
        contacts = {name: CONTACT if entry.rig.pad else () for name, entry in both.items()}
        shown = films(
            {name: entry.rig.controller for name, entry in both.items()},
            {f"{time}: {why}": number for why, number in choice(*played.values()).items()},
            played,
            seed=frozen.seed,
            frozen=None if "scenario" in environments[PAPER] else frozen,
            environments=environments,
            records={name: {key: both[name].results[key] for key in keys} for name, keys in contacts.items()},
        )
        scenes += shown["scenes"]
    return {**shown, "scenes": scenes}


def episodes(entry: Entry) -> Episodes:
    """Return the first COUNT results of an entry."""
    results = {name: entry.results[name] for name in RESULTS}
    return Episodes(**results, scenario={name: entry.results[name] for name in FIELDS}).first(COUNT)


def choice(paper: Episodes, design: Episodes) -> dict[str, int]:
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
