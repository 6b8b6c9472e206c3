"""Two causes of a lower V_p than with the paper's rule: the arm's limits, and knowledge of where objects stand.

For each distribution (prior) of the object's distance, the paper's rule is compared with the best constant speed and
the best profile of speed over position. Constant speed and profile have the same limits of the arm and the same choice
of reactions to the alarm. So their difference in V_p comes from knowledge of the prior.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from agents.baselines import BlindProfile, PaperTrapezoid
from agents.baselines.cmaes import minimise
from agents.baselines.profile import ACCELERATION, REACTION, ReactingRule
from agents.baselines.rule import Floats, Parameter
from agents.evaluate.scenario_batch import TEST_SEED, TUNING_SEED, ScenarioBatch
from experiments.lab import grid
from experiments.lab.parts import Section, Table, percent
from experiments.lab.statistics import Comparison, Resamples, estimate
from experiments.lab.study import Cell, Findings, Frames, Measurement, Study
from impact_gym.task import Task
from impact_gym.task.task import VELOCITY_RANGE


class Steady(ReactingRule):
    """Rule with the same speed at every position; during an alarm, the rule reacts like a profile."""

    PARAMETERS = (Parameter("speed", "m/s", 0.01, VELOCITY_RANGE[1], 0.6), ACCELERATION, *REACTION)

    def speed(self, position: Floats) -> Floats:
        """Return the speed (m/s)."""
        return np.broadcast_to(self["speed"], np.shape(position))


class Prior(NamedTuple):
    """Distribution of the object's distance."""

    near: float  # m, least distance from the tool
    far: float  # m, largest distance from the tool, or its 95 % quantile if `memoryless`
    memoryless: bool = False  # whether the distribution is exponential

    @property
    def mean(self) -> float:
        """Mean distance, m; if `memoryless`, the mean of the distance minus `near`."""
        return (self.far - self.near) / np.log(20.0) if self.memoryless else 0.5 * (self.near + self.far)

    @property
    def words(self) -> str:
        """The prior in words."""
        if self.memoryless:
            return f"memoryless, {100 * self.mean:.0f} cm on average"
        return f"{100 * self.near:.3g} to {100 * self.far:.3g} cm"

    def distances(self, seed: int, count: int) -> Floats:
        """Return `count` distances (m) in random order: the quantiles at (k + 0.5) / `count` for k = 0, 1, ..."""
        share = (np.random.default_rng(seed).permutation(count) + 0.5) / count
        away = -np.log1p(-share) / np.log(20.0) if self.memoryless else share
        return self.near + (self.far - self.near) * away


PRIORS = (
    *(Prior(near, near + 0.2) for near in (0.001, 0.05, 0.10, 0.15, 0.20)),
    *(Prior(0.15, 0.15 + width) for width in (0.1, 0.4, 1.0)),
    Prior(0.001, 0.6, memoryless=True),
)
RULES: Mapping[str, Any] = {"rule": PaperTrapezoid, "steady": Steady, "profile": BlindProfile}
WEIGHTS, QUICK_WEIGHTS = (0.7, 1.2, 1.7, 2.4, 3.4, 5.0), (0.7, 3.0)  # time weights, m/s per s
SEARCH = {"scenarios": 200, "generations": 90, "tested": 1000}
QUICK_SEARCH = {"scenarios": 40, "generations": 12, "tested": 100}


def searches(quick: bool, _: Frames) -> Iterable[Cell]:
    """Yield a cell for each prior, rule and time weight (one weight for the paper's rule)."""
    weights, search = (QUICK_WEIGHTS, QUICK_SEARCH) if quick else (WEIGHTS, SEARCH)
    for prior in [PRIORS[k] for k in (0, 3, -1)] if quick else PRIORS:
        for rule in RULES:
            for weight in weights if rule != "rule" else (1.0,):
                arguments = {"prior": list(prior), "rule": rule, "weight": weight, **search}
                yield Cell({**prior._asdict(), "rule": rule}, arguments)


def searched(
    prior: Sequence[Any], rule: str, weight: float, scenarios: int, generations: int, tested: int, population: int = 16
) -> pl.DataFrame:
    """Optimise a rule, except the paper's, on tuning scenarios; return its results in test scenarios."""
    place, kind = Prior(*prior), RULES[rule]
    horizon = 1.2 if place.far < 0.5 else 6.0  # s

    def played(numbers: Any, seed: int, count: int, copies: int, rtol: float) -> Any:
        made = kind() if rule == "rule" else kind.of(np.repeat(numbers, count, axis=0))
        task = Task(scenario={"distance": (place.near, place.far)}, horizon=horizon)
        batch: Any = {"copies": copies, "time_weight": [weight] * copies, "threads": 1}
        stage = ScenarioBatch(seed, count, task.changed({"rtol": rtol}), lenient=True, **batch)
        distances = np.tile(place.distances(seed, count), copies)
        return stage.play(made.for_task(task), {"distance": distances})

    def losses(candidates: Floats) -> Floats:
        episodes = played(candidates[:, 0], TUNING_SEED, scenarios, population, 1e-5)
        return episodes.loss(weight).reshape(population, scenarios).mean(axis=1)[:, None]

    best = None if rule == "rule" else minimise(losses, kind.PARAMETERS, 1, population, generations, 1).parameters
    episodes = played(best, TEST_SEED, tested, 1, 1e-8)
    names = ("object_velocity", "approach_time", "missed")
    columns = {"weight": np.full(tested, weight), "episode": np.arange(tested), "seed": np.zeros(tested, int)}
    return pl.DataFrame(columns | {name: getattr(episodes, name) for name in names})


def by_prior(frame: pl.DataFrame) -> list[dict[str, Any]]:
    """Return a row for each prior: V_p of each rule at the mean approach time of the paper's rule, with intervals."""
    lines = []
    for prior, rows in grid.groups(frame, "near", "far", "memoryless"):
        of_rule = dict(grid.groups(rows, "rule"))
        resamples = Resamples(len(of_rule[("rule",)]))
        fronts = [grid.front_of(of_rule[(name,)], resamples) for name in RULES]
        rule, steady, profile = (Comparison.of_fronts(each, fronts[0]).ours for each in fronts)
        missed = max(np.mean(found["missed"].to_numpy()) for found in of_rule.values())
        shares = {"limits": (rule - steady) / rule, "place": (steady - profile) / rule, "all": 1.0 - profile / rule}
        line: dict[str, Any] = {"prior": Prior(*prior), "time": fronts[0][0][0, 0], "missed": missed}
        line["velocity"] = list(map(estimate, (rule, steady, profile)))
        line |= {name: estimate(share) for name, share in shares.items()}
        lines.append(line | {"profile": Comparison(profile, steady).reduction})
    return lines


def priors_section(lines: Sequence[Mapping[str, Any]]) -> Section:
    """Return the section on the gain from knowledge of the prior."""
    rows = [
        (
            line["prior"].words + (f" ({100 * line['missed']:.0f} % missed)" if line["missed"] > 0.01 else ""),
            f"{line['time']:.3f}",
            *(f"{each:.3f}" for each in line["velocity"]),
            *(percent(line[name], 0) for name in ("limits", "place", "profile")),
        )
        for line in lines
    ]
    head = ("objects stand", "T of the rule (s)", "V_p of the rule (m/s)", "best constant speed", "best profile",
            "from the limits", "from knowing where", "profile below constant speed")  # fmt: skip
    caption = "At the mean approach time of the paper's rule; from limits, from knowing where: shares of the rule's V_p"
    text = (
        "Constant speed and profile have the same limits, 1.5 m/s and 20 m/s^2, and the same choice of reactions; only "
        "the profile may be faster where no object can stand. 95 % intervals over scenarios that no search has used."
    )
    return Section("Knowing where", [Table(caption, head, rows), text], key="priors")


def analyse(frames: Frames, _: bool) -> Findings:
    """Compare the rules for each prior."""
    lines = by_prior(frames["priors"])
    known = next((line for line in lines if line["prior"].near == 0.15), lines[-1])
    answer = (
        f"With objects {known['prior'].words} away and no learning, V_p is {percent(known['all'], 0)} below that "
        f"of the paper's rule at the same approach time: {percent(known['limits'], 0)} of the rule's V_p come from "
        f"the arm's limits and a better reaction, {percent(known['place'], 0)} from knowing where objects can be."
    )
    return Findings(answer, [priors_section(lines)])


STUDY = Study(
    "gain",
    "What causes the gain over the paper's rule?",
    (Measurement("priors", searches, searched, ("impact_gym", "agents.baselines", "agents.evaluate")),),
    analyse,
    packages=("cma",),
)
