"""Every assistance behind every operator, coupling and delay: how far the object slides, and when it is done."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.baselines import LocalBrake, OperatorAlone, PaperTrapezoid, load_baseline
from agents.evaluate import ScenarioBatch
from agents.jobs import Result
from agents.policies import load_ensemble
from agents.setups import load_setup
from experiments.lab.comparison import Comparison, Front
from experiments.lab.player import films
from experiments.lab.statistics import Resamples, estimate
from experiments.lab.tables import Gather, Row, result_of, solver_and
from impact_gym.operators import FIFTH_GENERATION

COUPLINGS = ("rigid", "spring", "bistable")
DELAYS = (0.0, 0.05, 0.1, 0.2, 0.4)  # s, there and back
BELIEF = {"place_error": [-0.05, 0.05], "creep": [0.05, 0.15]}
TRAINED = "reach"
OPERATORS: Mapping[str, Mapping[str, Any]] = {
    TRAINED: {"type": "Reach", **BELIEF},
    "tracker": {"type": "Tracker", **BELIEF},
    "hand": {"type": "SecondOrderLag", **BELIEF},
    "steady": {"type": "Trapezoid", "speed": [0.1, 0.4]},
}
"""The first is the family that policies were trained with and rules tuned for; the others are held out."""
ALONE, GAIN, BRAKE, POLICY = "operator alone", "tuned gain", "local brake", "policy"
MEASURES = ("object_velocity", "slide", "touch_time", "done_time", "taken", "missed")
SHUFFLED = ", beliefs shuffled"


def contestants(coupling: str, weight: float) -> dict[str, list[Any]]:
    """Return who assists, for a time weight (m/s per s): one controller, or one for each seed."""
    name = f"teleop-{coupling}"
    policies: list[Any] = list(load_ensemble(name).policies)
    return {
        ALONE: [OperatorAlone()],
        GAIN: [load_baseline(f"{name}-gain", weight)],
        "paper's rule": [PaperTrapezoid()],
        BRAKE: [LocalBrake()],
        "speed limit": [load_baseline(f"{name}-limit", weight)],
        POLICY: policies,
    }


def played(coupling: str, delay: float, operator: str, count: int, channel: str = "") -> Result:
    """Return a row for each contestant: means over scenarios and seeds with intervals, and beside the tuned gain.

    A contestant is compared with the tuned gain at the mean time at which that is done, along its own trade-off.
    """
    setup = load_setup(f"teleop-{coupling}")
    environment = _environment(coupling, operator, FIFTH_GENERATION[channel] if channel else {"delay": 0.5 * delay})
    resamples, fronts, rows = Resamples(count), dict[str, Front](), []
    no_change: dict[str, NDArray[np.float64]] = {}
    found: dict[str, dict[float, dict[str, NDArray[Any]]]] = {}
    for weight in setup.evaluation.weights:
        options = {"threads": 1, "quiet": True, "lenient": True, **environment}
        stage = ScenarioBatch.of("test", count, time_weight=[weight], **options)
        distance = stage.play(OperatorAlone()).scenario["distance"]
        elsewhere = {"operator.place_error": np.random.default_rng(0).permutation(distance) - distance}
        for who, controllers in contestants(coupling, weight).items():
            records = {who: no_change} | ({who + SHUFFLED: elsewhere} if operator == TRAINED and not channel else {})
            for name, record in records.items():
                episodes = [stage.play(_placed(each, environment), record) for each in controllers]
                values = {each: np.array([getattr(run, each) for run in episodes], np.float64) for each in MEASURES}
                found.setdefault(name, {})[weight] = values
    typical = setup.evaluation.typical
    for who, by_weight in found.items():
        means = {name: np.stack([resamples.means(by_weight[w][name]) for w in by_weight], 1) for name in MEASURES}
        fronts[who] = means["done_time"], means["slide"]
    place_of = list(setup.evaluation.weights).index(typical)
    gain = tuple(each[:, place_of : place_of + 1] for each in fronts[GAIN])
    for who, by_weight in found.items():
        values, row = by_weight[typical], {"coupling": coupling, "delay": delay, "operator": operator}
        row |= {"channel": channel, "contestant": who, "median_slide": float(np.median(values["slide"]))}
        for name in MEASURES:
            row |= _spread(name, estimate(resamples.means(values[name])))
        row |= _spread("less_slide", Comparison.of_fronts(fronts[who], (gain[0], gain[1])).less)
        rows.append(row)
    return result_of(rows)


def _environment(coupling: str, operator: str, link: Any) -> dict[str, Any]:
    """Return the environment of a cell, both channels alike."""
    setup = load_setup(f"teleop-{coupling}")
    return {**setup.environment, "operator": OPERATORS[operator], "uplink": link, "downlink": link}


def _placed(controller: Any, environment: Mapping[str, Any]) -> Any:
    """Return a rule for an environment, a policy as it is."""
    return controller.for_environment(environment) if hasattr(controller, "for_environment") else controller


def _spread(name: str, value: Any) -> dict[str, float]:
    """Return an estimate as columns."""
    return {name: value.value, f"{name}_low": value.low, f"{name}_high": value.high}


def rows(gather: Gather, count: int, delays: Sequence[float], operators: Sequence[str]) -> list[Row]:
    """Return a row for each contestant in each cell, and over the channels of 5G."""
    cells = [{"coupling": c, "delay": d, "operator": o, "count": count}
             for c in COUPLINGS for d in delays for o in operators]  # fmt: skip
    cells += [{"coupling": c, "delay": 2.0 * _mean(name), "operator": TRAINED, "count": count, "channel": name}
              for c in COUPLINGS for name in FIFTH_GENERATION]  # fmt: skip
    return gather("cells", played, cells, solver_and("experiments.teleop", "agents"))


def _mean(channel: str) -> float:
    """Return the mean delay of a channel of 5G, s."""
    return float(channel[3:-2]) / 1e3


def worse(found: Sequence[Row]) -> list[Row]:
    """Return where an assistance lets the object slide further than the tuned gain does, by its interval."""
    compared = [row for row in found if row["contestant"] not in (GAIN, ALONE) and SHUFFLED not in row["contestant"]]
    return [row for row in compared if row["less_slide_high"] < 0.0]


def watched(coupling: str, count: int) -> dict[str, Any]:
    """Return films of an operator alone and with a local brake, 100 ms away: a typical scenario, the worst of each."""
    environment = _environment(coupling, TRAINED, {"delay": 0.1})
    players: dict[str, Any] = {ALONE: OperatorAlone(), BRAKE: LocalBrake()}
    players = {name: player.for_environment(environment) for name, player in players.items()}
    stage = ScenarioBatch.of("test", count, threads=1, quiet=True, **environment)
    played = {name: stage.play(player) for name, player in players.items()}
    alone, brake = (np.asarray(played[name].slide) for name in (ALONE, BRAKE))
    numbers = {
        "Alone, it slides the median way": int(np.argsort(alone)[count // 2]),
        "Alone, it slides farthest": int(np.argmax(alone)),
        "With the brake, it slides farthest": int(np.argmax(brake)),
        "The brake helps least": int(np.argmin(alone - brake)),
    }
    return films(players, numbers, played, environment=environment)
