"""The jobs of the report: functions of plain data that play a controller and return arrays or a frame."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.baselines import PaperTrapezoid
from agents.evaluate import Travel
from agents.evaluate.controllers import controller_of
from agents.evaluate.play import play, scenario_batch_of
from agents.policies import Controller
from experiments.lab import grid
from experiments.lab.player.films import play as replay

Arrays = dict[str, NDArray[Any]]
JSON = Mapping[str, Any]
HALVINGS = 9  # of the range of weights, in its logarithm: to 1 %
CALIBRATION_SCENARIOS = 500  # to find a weight on, or as many as are then played


def measured(measure: str, arguments: JSON) -> Any:
    """Return the result of one of MEASURES, arrays or a frame: one function for all jobs of a report."""
    return MEASURES[measure](**arguments)


def play_as_late(controller: JSON, environment: JSON, scenarios: JSON, weights: Sequence[float]) -> Arrays:
    """Return the results (1, scenarios) at the weight whose mean approach takes as long as that of the paper's rule.

    That weight is found by bisection within the ends of `weights`, on `calibration_scenarios`. It is returned as
    `weight` (1,).
    """
    choosing = calibration_scenarios(scenarios)

    def mean_time(weight: float, player: Controller) -> float:
        return float(scenario_batch_of(choosing, weight, environment).play(player).approach_time.mean())

    low, high = weights[0], weights[-1]
    target = mean_time(low, PaperTrapezoid().for_environment(environment))
    for _ in range(HALVINGS if high > low else 0):
        middle = math.sqrt(low * high)
        if mean_time(middle, controller_of(controller, middle, environment)) > target:
            low = middle
        else:
            high = middle
    return play(controller, scenarios, [high], environment) | {"weight": np.array([high])}


def calibration_scenarios(scenarios: JSON) -> dict[str, Any]:
    """Return scenarios to choose a weight on: the validation set for a shipped one, the same ranges with another seed.

    For a table of scenarios there are no others, and it is these.
    """
    count = min(CALIBRATION_SCENARIOS, scenarios["count"])
    if "set" in scenarios:
        return {"set": "validation", "count": count}
    if "ranges" in scenarios:
        return {**scenarios, "seed": scenarios["seed"] + 50_000_000, "count": count}
    return dict(scenarios)


def travelled(controller: JSON, environment: JSON, scenarios: JSON, weights: Sequence[float]) -> Arrays:
    """Return how far the tool gets from its place on the flange, m: before the first touch, and in all (1, scenarios).

    It is played at the only one of `weights`.
    """
    (weight,) = weights
    batch = scenario_batch_of(scenarios, weight, environment)
    travel = Travel(batch.count)
    batch.play(controller_of(controller, weight, environment), watch=travel)
    return {"before": travel.deflection[None], "in_all": travel.stroke[None]}


def profile(controller: JSON, environment: JSON, weights: Sequence[float], distance: float) -> Arrays:
    """Return the flange's velocity (weights, k) over even positions (k,) up to an object at `distance` (m).

    A distance estimate, where there is one, is right.
    """
    record = {"object_mass": 0.5, "contact_stiffness": 3e4, "restitution": 0.5, "distance": distance}
    if environment.get("range_noise") is not None:
        record["distance_estimate"] = distance
    position = np.linspace(0.0, distance, 141)
    curves = []
    for weight in weights:
        player, options = controller_of(controller, weight, environment), {**environment, "time_weight": weight}
        run = replay(player, seed=0, number=0, record=record, options=options)
        approach = run.history.time <= run.info["approach_time"] + 1e-12
        place, velocity = (run.history.columns[f"flange_{name}"][approach] for name in ("position", "velocity"))
        forward = np.flatnonzero(place >= np.maximum.accumulate(place))  # a flange may step back
        curves.append(np.interp(position, place[forward], velocity[forward], right=np.nan))
    return {"position": position, "velocity": np.array(curves)}


MEASURES: Mapping[str, Callable[..., Any]] = {
    "play": play, "play as late": play_as_late, "travelled": travelled, "profile": profile, "holds": grid.play,
}  # fmt: skip
"""What a job may do, by name."""
