"""Comparison of assistances: controllers at the arm that correct late commands of an operator."""

import base64
from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np
import polars as pl

from agents.policies import load_ensemble
from agents.setups import load_setup
from experiments.lab import grid
from experiments.lab.parts import Section, Table, percent
from experiments.lab.statistics import Floats, Resamples, estimate, reduction
from experiments.lab.study import Cell, Findings, Frames, Measurement, Study
from experiments.studies import QUESTIONS

COUPLINGS = ("rigid", "spring", "bistable")
DELAYS, TYPICAL = (0.0, 0.05, 0.1, 0.2, 0.4), 0.2  # s, of the round trip
BELIEF = {"place_error": [-0.05, 0.05], "creep": [0.05, 0.15]}
OPERATORS: Mapping[str, Mapping[str, Any]] = {  # no policy was trained with these
    "tracker": {"type": "Tracker", **BELIEF},
    "hand": {"type": "SecondOrderLag", **BELIEF},
    "steady": {"type": "Trapezoid", "speed": [0.1, 0.4]},
}
ASSISTANCE = ALONE, RULE, BRAKE, POLICY = "operator alone", "paper's rule", "local brake", "policy"
BASELINES = {ALONE: "operator-alone", RULE: "paper-trapezoid", BRAKE: "local-brake"}
MEASURES = ("slide", "cost")
LABELS = ("coupling", "delay", "operator", "contestant")
Means = Mapping[tuple[Any, ...], Mapping[str, Floats]]
"""For each combination of LABELS the mean of each of MEASURES, (1 + n,): first of the sample, then of n resamples."""


def assisted(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield a cell for each assistance, and each seed of the policy, with each coupling, operator and delay."""
    delays, operators = ([TYPICAL], ["steady"]) if quick else (DELAYS, OPERATORS)
    scenarios = {"set": "test", "count": 40 if quick else 500}
    for coupling in COUPLINGS:
        setup = load_setup(f"teleop-{coupling}")
        controllers = {(name, 0): {"baseline": baseline} for name, baseline in BASELINES.items()}
        for policy in load_ensemble(setup.name).policies:
            controllers[POLICY, policy.seed] = {"policy": base64.b64encode(policy.to_bytes()).decode()}
        for delay, operator, (who, seed) in product(delays, operators, controllers):
            link = {"delay": 0.5 * delay}  # s, of each channel
            environment = {**setup.environment, "operator": OPERATORS[operator], "uplink": link, "downlink": link}
            labels = dict(zip((*LABELS, "seed"), (coupling, delay, operator, who, seed), strict=True))
            weights = [setup.evaluation.typical]
            yield grid.cell(labels, controllers[who, seed], environment, scenarios, weights, lenient=True)


def means_of(episodes: pl.DataFrame) -> Means:
    """Return the means; all use the same resamples of the scenarios, so they can be compared."""
    resamples = Resamples(episodes["episode"].n_unique())
    return {
        labels: {name: resamples.means(grid.sample(rows, name)) for name in MEASURES}
        for labels, rows in grid.groups(episodes, *LABELS)
    }


def over(means: Means, who: str, measure: str, coupling: str, delays: Iterable[float]) -> Floats:
    """Return the mean over the operators and `delays` (s) for an assistance, (1 + n,)."""
    cells = product([coupling], delays, OPERATORS, [who])
    return np.mean([means[cell][measure] for cell in cells if cell in means], axis=0)


def slides(means: Means) -> Table:
    """Return the table of slides, and of the policy's cost beside the brake's, for each coupling and delay."""
    rows, delays = [], sorted({delay for _, delay, *_ in means})
    shown = {f"{1e3 * delay:.0f} ms": [delay] for delay in delays} | {"mean of all delays": delays}
    for coupling, (name, some) in product(dict.fromkeys(coupling for coupling, *_ in means), shown.items()):
        found = [estimate(100.0 * over(means, who, "slide", coupling, some)) for who in ASSISTANCE]
        less = reduction(*(over(means, who, "cost", coupling, some) for who in (POLICY, BRAKE)))
        rows.append([f"{coupling}, {name}", *(f"{each:.1f}" for each in found), percent(less).replace(" %", "")])
    caption = "Slide of the object by tool and delay (both ways together), mean over three models of operators"
    head = ("tool, delay", *(f"{who} (cm)" for who in ASSISTANCE), "policy costs less than the brake by (%)")
    return Table(caption, head, rows, "teleop-slides")


def by_operator(means: Means) -> Table:
    """Return the table of slides with the brake, for each coupling and operator."""
    rows = dict[str, list[str]]()
    for (coupling, _, operator, who), found in means.items():
        if who == BRAKE:
            rows.setdefault(f"{coupling}, {operator}", []).append(f"{100.0 * found['slide'][0]:.1f}")
    head = ("tool, operator", *(f"{1e3 * delay:.0f} ms (cm)" for delay in dict.fromkeys(key[1] for key in means)))
    caption = "Slide of the object with the local brake by delay (both ways together)"
    return Table(caption, head, [[name, *cells] for name, cells in rows.items()], "teleop-operators")


def analyse(frames: Frames, quick: bool) -> Findings:
    """Compare the assistances."""
    episodes = frames["episodes"]
    means = means_of(episodes)
    found = slides(means)
    text = (
        f"95 % intervals over {episodes['episode'].n_unique()} scenarios on which nothing was tuned or trained, and "
        "over the seeds of each policy. The cost is V_p + w times the time until all is done, w = "
        f"{episodes['weight'][0]:g} m/s per s. No policy was trained with these operators: a tracker of the displayed "
        "object, a pointing hand, a steady speed."
    )
    short = ([cell.partition(" [")[0] for cell in row] for row in found.rows)
    clauses = [f"{tool}: {alone} cm alone, {brake} with the brake, {policy} with the policy"
               for tool, alone, _, brake, policy, _ in short if tool.endswith(f", {1e3 * TYPICAL:.0f} ms")]  # fmt: skip
    answer = f"Slide of the object, mean over the operators: {'; '.join(clauses)}."
    return Findings(answer, [Section("Slides", [text, found, by_operator(means)])])


PLAYED = (*grid.PLAYED, "agents.setups", "impact_gym.teleop")
STUDY = Study("teleop", QUESTIONS["teleop"], [Measurement("episodes", assisted, grid.play, PLAYED)], analyse)
