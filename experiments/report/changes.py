"""Changes of one argument of a matchup's environment, for results without a new training or tuning."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from agents.setups.evaluation import Change, variants
from experiments.report.matchups import Matchup
from impact_gym.quantities import QUANTITIES
from impact_gym.task import evaluation_sets

WORDS = {  # plain names of some arguments; `factor` names all arguments
    "force_noise": "noise of the force sensor",
    "range_noise": "error of the distance estimate",
    "robot": "compliant robot",
    "scenario": "objects outside the training ranges",
}
SHOWN = {"s": ("ms", 1e3), "m": ("mm", 1e3), "%": ("%", 100.0)}  # for some units: the printed unit, and the factor


def changes(
    matchup: Matchup, scenarios: Mapping[str, Any]
) -> Iterator[tuple[dict[str, Any], Mapping[str, Any], Mapping[str, Any]]]:
    """Yield labels, environment and scenarios of each change."""
    for change in variants(matchup.evaluation, matchup.environment):
        played = scenarios
        if change.scenarios:
            there = evaluation_sets.load(change.scenarios).count
            played = {"set": change.scenarios, "count": min(scenarios["count"], there)}
        nominal = {**matchup.environment, **matchup.evaluation.nominal}
        environment = nominal if change.same else change.environment
        labels = {
            "change": f"{factor(change.argument)}: {setting(change)}",
            "factor": factor(change.argument, environment.get("alarm") == "reading"), "setting": setting(change),
            "same": change.same, "value": change.value,
        }  # fmt: skip
        yield labels, environment, played


def factor(argument: str, by_reading: bool = False) -> str:
    """Return the plain name of an argument; `by_reading`: whether readings of the force sensor raise the alarm."""
    words = WORDS.get(argument) or (QUANTITIES[argument].words if argument in QUANTITIES else argument)
    alarm = "which raises the alarm" if by_reading else "the alarm is a switch without noise"
    return f"{words} ({alarm})" if argument == "force_noise" else words


def setting(change: Change) -> str:
    """Return the changed value with its unit; if the value is not a number, the change's label."""
    if not np.isfinite(change.value):
        return change.label
    unit = "%" if change.multiple else QUANTITIES[change.argument].unit
    name, scale = SHOWN.get(unit, (unit, 1.0))
    return f"{scale * change.value:g} {name}"
