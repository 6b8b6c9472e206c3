"""The best possible, blind: below it nobody comes who does not know the object before the touch; and who comes near.

Until a sensor says something every deterministic controller that knows no place is one motion, the same for all
objects. So: one shared motion, and for each object the reaction that is best for it, from the first reading on that is
not zero; both are searched on the very scenarios they are judged by, so that whoever was made on others stays above.
Where the distance is estimated, a motion for each of a few bins of the estimate, counted from it. What remains of
the bound's own error is that of its corners, which are doubled, and that of the search.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from agents.baselines import PaperTrapezoid, load_baseline
from agents.baselines.cmaes import minimise
from agents.baselines.profile import ACCELERATION, AHEAD, KNOTS, REACTION, ReactingRule
from agents.baselines.rule import Floats, Parameter, View, interpolate
from agents.baselines.detector import OwnAlarmView
from agents.evaluate import ScenarioBatch
from agents.jobs import Result
from agents.policies import load_ensemble
from agents.setups import load_setup
from experiments.lab.comparison import Comparison
from experiments.lab.statistics import estimate
from experiments.lab.tables import Gather, Row, result_of, solver_and
from impact_gym.task.task import VELOCITY_RANGE

BINS = {"linear-blind": 1, "linear-ranged": 10}  # of the estimate
WEIGHTS = (0.7, 2.0)  # m/s per s
BETWEEN = (0.84, 1.4, 2.8)  # m/s per s, for which no profile was tuned
SPREADS = (0.1, 0.03)  # of the first candidates, a standard deviation as a share of each parameter's range
SEARCH_RTOL, OF_REACTIONS = 1e-5, 30
RULE, PROFILE = "rule", "profile"


class Effort(NamedTuple):
    """Of the searches for the bound."""

    scenarios: int = 500
    corners: int = 3  # how many numbers of them, each about twice the one before
    generations: int = 80  # for each of SPREADS


class Shared(ReactingRule):
    """A motion over the flange's position, counted from the estimate if there is one; then a reaction to any force."""

    places: Floats  # m, of the corners

    def see(self, view: View, state: Any, episode_start: Any) -> tuple[View, Any]:
        """Return a view with the alarm raised by the first reading, and when that came, s."""
        before = np.full(np.shape(view["time"]), np.inf) if state is None else state
        raised = np.where(view["force"] > 0.0, np.minimum(before, view["time"]), before)
        return OwnAlarmView(view, raised), raised

    def position(self, view: View) -> Floats:
        """Return the flange's position (m), counted from the estimated distance where there is one."""
        return view["position"] if self.task.range_noise is None else -view["distance_estimate"]

    def speed(self, position: Floats) -> Floats:
        """Return the broken line's speed (m/s) at `position` (m)."""
        return interpolate(self.places, self.columns("speed 0", len(self.places)), position)


def shared(places: Floats) -> type[Shared]:
    """Return the motions with these corners (m)."""
    speeds = (Parameter(f"speed {each}", "m/s", 0.01, VELOCITY_RANGE[1], 0.6) for each in range(len(places)))
    return type("Shared", (Shared,), {"PARAMETERS": (*speeds, ACCELERATION, *REACTION), "places": places})


class Noting(PaperTrapezoid):
    """The paper's rule, which notes the estimates of the distance."""

    def see(self, view: View, state: Any, episode_start: Any) -> tuple[View, Any]:
        """Return what it is given, after a note."""
        self.estimates = view["position"] + view["distance_estimate"]  # which counts from the flange
        return view, state


def searched(
    setup: str, bins: int, weight: float, scenarios: int, corners: int, generations: int, population: int = 16
) -> Result:
    """Return what the bound is in each of the first test scenarios with the usual corners, with twice as many, ..."""
    environment = dict(load_setup(setup).environment)
    stage = ScenarioBatch.of(
        "test", scenarios, copies=population, time_weight=[weight] * population, threads=1, lenient=True,
        **{**environment, "rtol": SEARCH_RTOL},
    )  # fmt: skip
    exact = ScenarioBatch.of("test", scenarios, time_weight=[weight], threads=1, **environment)
    tuned: Any = load_baseline(load_setup(setup).against[0], weight)
    of_bin = np.zeros(scenarios, np.int64)
    if bins > 1:
        exact.play(noting := Noting().for_environment(environment))
        of_bin = np.argsort(np.argsort(noting.estimates)) * bins // scenarios
    per_bin = np.bincount(of_bin)
    places = AHEAD if bins > 1 else KNOTS
    kind, motion = shared(places), np.tile(tuned.parameters[: -len(REACTION)], (bins, 1))
    reaction = np.tile(tuned.parameters[-len(REACTION) :], (scenarios, 1))

    def losses(motions: Floats, reactions: Floats, stage: ScenarioBatch = stage) -> Floats:
        """Losses (n, scenarios) of motions (n, bins, k) with reactions (n, scenarios, k)."""
        numbers = np.concatenate([motions[:, of_bin], reactions], axis=2)
        rule = kind.of(numbers.reshape(-1, numbers.shape[2])).for_environment(environment)
        return stage.play(rule).loss(weight).reshape(len(numbers), scenarios)

    def of_reactions(candidates: Floats) -> Floats:
        return losses(np.tile(motion, (population, 1, 1)), candidates)

    def of_motions(candidates: Floats) -> Floats:
        each = losses(candidates, np.tile(reaction, (population, 1, 1)))
        return np.array([np.bincount(of_bin, row) / per_bin for row in each])

    rows = []
    for doubled in range(corners):
        if doubled:
            between = np.insert(places, range(1, len(places)), 0.5 * (places[1:] + places[:-1]))
            speeds = [np.interp(between, places, each[:-1]) for each in motion]
            places, motion = between, np.column_stack([speeds, motion[:, -1]])
            kind = shared(places)
        best = minimise(of_reactions, REACTION, scenarios, population, OF_REACTIONS, doubled, reaction, SPREADS[0])
        reaction, usual = best.parameters, kind.PARAMETERS[: -len(REACTION)]
        for spread in SPREADS:
            motion = minimise(of_motions, usual, bins, population, generations, doubled, motion, spread).parameters
        costs = losses(motion[None], reaction[None], exact)[0]
        asked = {"setup": setup, "weight": weight, "contestant": f"{len(places)} corners"}
        rows += [asked | {"scenario": place, "loss": cost} for place, cost in enumerate(costs.tolist())]
    return result_of(rows)


def played(setup: str, weight: float, count: int, contestant: str) -> Result:
    """Return what a rule, a profile or the policy of a seed comes to in each of the first test scenarios."""
    made = load_setup(setup)
    of_policy: Any = load_ensemble(setup)[int(contestant.removeprefix("seed "))] if "seed" in contestant else None
    controller: Any = of_policy or (PaperTrapezoid() if contestant == RULE else load_baseline(made.against[0], weight))
    stage = ScenarioBatch.of("test", count, time_weight=[weight], threads=1, **made.environment)
    losses = stage.play(controller).loss(weight).tolist()
    asked = {"setup": setup, "weight": weight, "contestant": contestant}
    return result_of([asked | {"scenario": place, "loss": loss} for place, loss in enumerate(losses)])


def rows(gather: Gather, effort: Effort, setups: Sequence[str] = tuple(BINS)) -> list[Row]:
    """Return a row for each scenario of the bound, and of whom it bounds."""
    depends = solver_and("experiments.gain", "agents")
    bounds = [
        {"setup": setup, "bins": BINS[setup], "weight": weight, **effort._asdict()}
        for setup in setups for weight in WEIGHTS
    ]  # fmt: skip
    contestants = [
        {"setup": setup, "weight": weight, "count": effort.scenarios, "contestant": contestant}
        for setup in setups
        for contestant in (RULE, PROFILE, *(f"seed {policy.seed}" for policy in load_ensemble(setup).policies))
        for weight in (*WEIGHTS, *BETWEEN)
    ]
    return [*gather("blind bound", searched, bounds, depends), *gather("blind", played, contestants, depends)]


def table(found: Sequence[Row]) -> list[dict[str, Any]]:
    """Return for each set-up and weight the bound by its corners, and by how much rule, profile and policies exceed it.

    At the weights BETWEEN there is no bound; policies are there compared with the profile.
    """
    losses: dict[tuple[str, float], dict[str, list[float]]] = {}
    for row in found:
        of_pair = losses.setdefault((row["setup"], row["weight"]), {})
        of_pair.setdefault(row["contestant"], []).append(row["loss"])
    lines = []
    for (setup, weight), each in sorted(losses.items()):
        bounds = [np.array(values) for name, values in each.items() if "corners" in name]
        seeds = np.array([values for name, values in each.items() if name.startswith("seed")])
        below, profile = bounds[-1] if bounds else None, np.array(each[PROFILE])
        line: dict[str, Any] = {"setup": setup, "weight": weight, "bounds": [bound.mean() for bound in bounds]}
        line["means"] = [float(np.mean(values)) for values in (each[RULE], profile, seeds)]
        line["least"] = min(seeds.mean(axis=1).min(), profile.mean())
        line["policy"] = Comparison.of_means(seeds, profile).reduction
        pairs = [Comparison.of_means(own, below) for own in (np.array(each[RULE]), profile, seeds) if below is not None]
        line["above"] = [estimate(pair.ours / pair.theirs - 1.0) for pair in pairs]
        lines.append(line)
    return lines
