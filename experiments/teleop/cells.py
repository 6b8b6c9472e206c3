"""Every assistance behind every operator, coupling and delay: how far the object slides, and when it is done."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.baselines import ConstantGain, LocalBrake, OperatorAlone, PaperTrapezoid, load_baseline
from agents.evaluate import ScenarioBatch
from agents.jobs import Result
from agents.policies import load_ensemble
from agents.setups import load_setup
from experiments.lab.player import films
from experiments.lab.statistics import Estimate, Floats, Resamples, along, estimate
from experiments.lab.tables import Gather, Row, result_of, solver_and
from impact_gym.operators import FIFTH_GENERATION

COUPLINGS = ("rigid", "spring", "bistable")
DELAYS = (0.0, 0.05, 0.1, 0.2, 0.4)  # s, there and back
BELIEF = {"place_error": [-0.05, 0.05], "creep": [0.05, 0.15]}
WAY, RECORDINGS, APART = 0.9, 8, 8.0  # m, of each recording; how many; s, between their starts


def recordings() -> dict[str, Any]:
    """Return recordings that no training saw: every one of eight speeds at random, with two hesitations."""
    rng, times, velocities = np.random.default_rng(0), list[float](), list[float]()
    for begin in APART * np.arange(RECORDINGS):
        speeds = np.concatenate([[0.0], rng.uniform(0.1, 0.45, 8), [0.0]])
        speeds[rng.choice(np.arange(2, 8), 2, replace=False)] = 0.03
        times += (begin + WAY / speeds.sum() * np.arange(len(speeds))).tolist()
        velocities += speeds.tolist()
    return {"type": "Replay", "time": times, "velocity": velocities, "length": APART, "recording": [0, RECORDINGS]}


REACH, SEEN = "reach", "training's recordings"
HELD_OUT: Mapping[str, Mapping[str, Any]] = {
    "tracker": {"type": "Tracker", **BELIEF},
    "hand": {"type": "SecondOrderLag", **BELIEF},
    "steady": {"type": "Trapezoid", "speed": [0.1, 0.4]},
    "recordings": recordings(),
}
"""Operators that no policy was trained with and no rule tuned for; those of the set-ups come before them."""
OPERATORS = (REACH, SEEN, *HELD_OUT)
ALONE, RULE, BRAKE, LIMIT, POLICY = "operator alone", "paper's rule", "local brake", "speed limit", "policy"
GAINS = np.linspace(0.3, 1.0, 8)
MEASURES = ("object_velocity", "slide", "done_time", "taken", "missed")
SHUFFLED = ", beliefs shuffled"
RIVALS = {"gain": "constant gains", "brake": f"the {BRAKE}", "limit": f"the {LIMIT}"}
"""Whom contestants are compared with, by columns of their rows."""


def contestants(coupling: str, weight: float) -> dict[str, list[Any]]:
    """Return who assists, for a time weight (m/s per s): one controller, or one for each seed."""
    name = f"teleop-{coupling}"
    return {
        ALONE: [OperatorAlone()],
        RULE: [PaperTrapezoid()],
        BRAKE: [LocalBrake()],
        LIMIT: [load_baseline(f"{name}-limit", weight)],
        POLICY: list(load_ensemble(name).policies),
    }


def played(coupling: str, delay: float, operator: str, count: int, channel: str = "") -> Result:
    """Return a row for each contestant: means over scenarios and seeds with intervals, and beside its rivals.

    Its slide is compared with that of the constant gains at the mean time at which it is done itself, along the line
    through all of them, its cost with that of the best of them.
    """
    weight, link = _typical(coupling), FIFTH_GENERATION[channel] if channel else {"delay": 0.5 * delay}
    environment, resamples = _environment(coupling, operator, link), Resamples(count)
    options = {"threads": 1, "quiet": True, "lenient": True, **environment}
    stage = ScenarioBatch.of("test", count, time_weight=[weight], **options)

    def measured(controllers: Sequence[Any], record: Mapping[str, ArrayLike] | None = None) -> dict[str, Floats]:
        runs = [stage.play(_placed(each, environment), record) for each in controllers]
        values = {name: np.array([getattr(run, name) for run in runs], np.float64) for name in MEASURES}
        return values | {"cost": np.array([run.loss(weight) for run in runs])}

    everybody = contestants(coupling, weight)
    found = {who: measured(controllers) for who, controllers in everybody.items()}
    gains = [*(measured([ConstantGain([gain, 20.0])]) for gain in GAINS[:-1]), found[ALONE]]
    if operator == REACH and not channel:
        distance = stage.play(OperatorAlone()).scenario["distance"]
        elsewhere = {"operator.place_error": np.random.default_rng(0).permutation(distance) - distance}
        found |= {who + SHUFFLED: measured(everybody[who], elsewhere) for who in (ALONE, BRAKE, POLICY)}
    means = {who: {name: resamples.means(values[name]) for name in values} for who, values in found.items()}
    times, slides, costs = (np.stack([resamples.means(gain[name]) for gain in gains], 1)
                            for name in ("done_time", "slide", "cost"))  # fmt: skip
    medians = np.array([[np.median(gain["slide"]) for gain in gains]])
    rows = []
    for who, mine in means.items():
        row: Row = {"coupling": coupling, "delay": delay, "operator": operator, "channel": channel, "contestant": who}
        row |= {"scenarios": count, "weight": weight, "median_slide": float(np.median(found[who]["slide"]))}
        row["median_ratio"] = row["median_slide"] / float(along(times[:1], medians, mine["done_time"][:1])[0])
        for name, values in mine.items():
            row |= _spread(name, estimate(values))
        front = {"slide": along(times, slides, mine["done_time"]), "cost": costs[:, int(costs[0].argmin())]}
        for rival, theirs in {"gain": front, "brake": means[BRAKE], "limit": means[LIMIT]}.items():
            for name in ("slide", "cost"):
                less = np.full(2, np.nan) if SHUFFLED in who else theirs[name] - mine[name]
                row |= _spread(f"{rival}_{name}", estimate(less))
        rows.append(row)
    return result_of(rows)


def _typical(coupling: str) -> float:
    """Return the time weight, m/s per s."""
    return load_setup(f"teleop-{coupling}").evaluation.typical


def _environment(coupling: str, operator: str, link: Any) -> dict[str, Any]:
    """Return the environment of a cell, both channels alike."""
    setup = load_setup(f"teleop-{coupling}")
    others = {SEEN: setup.mixed[0][1]["operator"], **HELD_OUT}
    who = others.get(operator, setup.environment["operator"])
    return {**setup.environment, "operator": who, "uplink": link, "downlink": link}


def _placed(controller: Any, environment: Mapping[str, Any]) -> Any:
    """Return a rule for an environment, a policy as it is."""
    return controller.for_environment(environment) if hasattr(controller, "for_environment") else controller


def _spread(name: str, value: Estimate) -> dict[str, float]:
    """Return an estimate as columns."""
    return {name: value.value, f"{name}_low": value.low, f"{name}_high": value.high}


def rows(gather: Gather, count: int, delays: Sequence[float], operators: Sequence[str]) -> list[Row]:
    """Return a row for each contestant in each cell, and over the channels of 5G."""
    cells = [{"coupling": c, "delay": d, "operator": o, "count": count}
             for c in COUPLINGS for d in delays for o in operators]  # fmt: skip
    cells += [{"coupling": c, "delay": 2e-3 * float(name[3:-2]), "operator": REACH, "count": count, "channel": name}
              for c in COUPLINGS for name in FIFTH_GENERATION]  # fmt: skip
    sources = "experiments.teleop.cells", "agents", "impact_gym.operators", "impact_gym.task", "impact_gym.envs"
    return gather("cells", played, cells, solver_and(*sources))


def watched(coupling: str, count: int) -> dict[str, Any]:
    """Return films of an operator alone and with a local brake, 100 ms away: a typical scenario, the worst of each."""
    environment = _environment(coupling, REACH, {"delay": 0.1})
    players: dict[str, Any] = {ALONE: OperatorAlone(), BRAKE: LocalBrake()}
    players = {name: player.for_environment(environment) for name, player in players.items()}
    stage = ScenarioBatch.of("test", count, threads=1, quiet=True, **environment)
    results = {name: stage.play(player) for name, player in players.items()}
    slides: list[NDArray[np.float64]] = [np.asarray(results[name].slide) for name in (ALONE, BRAKE)]
    alone, brake = slides
    numbers = {
        "Alone, it slides the median way": int(np.argsort(alone)[count // 2]),
        "Alone, it slides farthest": int(np.argmax(alone)),
        "With the brake, it slides farthest": int(np.argmax(brake)),
        "The brake helps least": int(np.argmin(alone - brake)),
    }
    return films(players, numbers, results, environment=environment)
