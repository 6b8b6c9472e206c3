"""Does it hold? One thing is changed at a time; policy and baselines stay as they were trained and tuned.

Played on the grid that studies share; `outcomes` has what came of each change, the rest says where the policy is worse.
"""

from collections.abc import Iterator, Mapping
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from agents.setups.evaluation import Change
from experiments.lab import grid
from experiments.lab.parts import Heat, HeatMap, Table
from experiments.lab.statistics import Floats
from experiments.lab.study import Cell
from experiments.report.answer import MISSED_TOO_OFTEN
from experiments.report.matchups import PAPER, POLICY, Matchup
from experiments.report.played import Played
from impact_gym.quantities import QUANTITIES
from impact_gym.task import evaluation_sets
from impact_gym.task.task import MISSED_COST

WORDS = {
    "force_noise": "noise of the force sensor",
    "range_noise": "error of the distance estimate",
    "robot": "robot that gives",
    "scenario": "objects beyond the training",
}
"""Changed arguments in plain words, where the quantity has none that a layman reads."""
SHOWN = {"s": ("ms", 1e3), "m": ("mm", 1e3), "%": ("%", 100.0)}  # units and scales, where they are others than given


class Outcome(NamedTuple):
    """One change, and what each contestant did under it; the median seed is the policy."""

    change: Change
    losses: Mapping[str, Floats]  # V_p + w T and what misses cost, m/s
    means: Mapping[str, Mapping[str, Any]]  # of V_p (m/s), T (s) and the loss (m/s), and the number of misses


class Failing(NamedTuple):
    """Where the policy does not hold."""

    worst: str  # in one line: the change under which it fares worst
    details: str  # all changes


class Weakness(NamedTuple):
    """One argument of the environment with which the policy is worse than a rival."""

    loss: float  # m/s, the largest
    mildest: Change  # with which it is worse
    only: bool  # nothing else was tried


def cells(matchup: Matchup, scenarios: Mapping[str, Any]) -> Iterator[Cell]:
    """Return the cells of the grid: paper's rule, rival and policy under each change, at the typical weight."""
    nominal = {**matchup.environment, **matchup.evaluation.nominal}
    places = []
    for change in matchup.changes:
        own = None
        if change.scenarios:
            own = {"set": change.scenarios, "count": min(scenarios["count"], evaluation_sets.load(change.scenarios).count)}
        environment = nominal if change.same else change.environment
        places.append(grid.Place(matchup.name, words(change), environment, own))
    contestants = [grid.Contestant(each.name, each.controller) for each in matchup.rivals]
    return grid.cells(places, contestants, scenarios, [matchup.typical])


def outcomes(played: Played) -> list[Outcome]:
    """Return what came of each change."""
    weight, found = played.matchup.typical, list[Outcome]()
    by_change = played.varied.partition_by("change", as_dict=True) if len(played.varied) else {}
    for change in played.matchup.changes:
        cost = grid.cost(weight, change.environment.get("missed_cost", MISSED_COST)).alias("loss")
        frame = by_change[words(change),].with_columns(cost)
        frame = frame.with_columns(pl.col("contestant").replace(played.matchup.chosen, POLICY))
        means = frame.group_by("contestant", maintain_order=True).agg(
            pl.mean("loss"), V=pl.mean("object_velocity"), T=pl.mean("approach_time"), missed=pl.sum("missed"), of=pl.len()
        )
        rows = {row.pop("contestant"): row for row in means.to_dicts()}
        losses = {name: frame.filter(contestant=name).sort("episode")["loss"].to_numpy() for name in rows}
        found.append(Outcome(change, losses, rows))
    return found


def factor(argument: str) -> str:
    """Return an argument of the environment in plain words."""
    return WORDS.get(argument) or (QUANTITIES[argument].words if argument in QUANTITIES else argument)


def setting(change: Change) -> str:
    """Return the changed value with its unit, or its label."""
    if not np.isfinite(change.value):
        return change.label
    unit = "%" if change.multiple else QUANTITIES[change.argument].unit
    name, scale = SHOWN.get(unit, (unit, 1.0))
    return f"{scale * change.value:g} {name}"


def words(change: Change) -> str:
    """Return a change in words."""
    return f"{factor(change.argument)}: {setting(change)}"


def by_argument(all_outcomes: list[Outcome]) -> list[list[Outcome]]:
    """Return a list for each argument."""
    return [list(group) for _, group in groupby(all_outcomes, lambda outcome: outcome.change.argument)]


def where_it_fails(played: Played) -> Failing:
    """Return with which changes the policy is worse than the paper's rule and than its rival, or misses objects.

    The worst is the one by which it misses most, or else loses most, to the rule before the rival.
    """
    all_outcomes, rival = outcomes(played), played.matchup.rival
    missed = _most_missed(all_outcomes)
    sentences, worse = list[str](), list[tuple[Change, str]]()
    for name, plain in {PAPER: PAPER, rival.name: rival.plain}.items():
        found = [weakness for group in by_argument(all_outcomes) if (weakness := _weakness(group, name))]
        found.sort(key=lambda weakness: -weakness.loss)
        if found:
            sentences.append(f"Worse than the {plain} with {', '.join(map(_with, found))}.")
        worse += [(weakness.mildest, plain) for weakness in found]
    if missed:
        change, misses = missed
        sentences.append(f"It misses {misses} with {factor(change.argument)} at {setting(change)}.")
    if not sentences:
        tried = sum(not outcome.change.same for outcome in all_outcomes)
        return Failing(f"nowhere among {tried} changes, one at a time, is it worse than its rivals.", "")
    argument = missed[0].argument if missed else worse[0][0].argument
    first = [(change, plain) for change, plain in worse if change.argument == argument][:1]
    clauses = [f"{_at(change)}it is worse than the {plain}" for change, plain in first]
    clauses += [f"{_at(missed[0])}it misses {missed[1]}"] if missed else []
    line = ", ".join(clauses)
    return Failing(f"{factor(argument)}. {line[0].upper()}{line[1:]}.", " ".join(sentences))


def _at(change: Change) -> str:
    return f"at {setting(change)} " if np.isfinite(change.value) else ""


def _with(weakness: Weakness) -> str:
    return factor(weakness.mildest.argument) + ("" if weakness.only else f" ({setting(weakness.mildest)})")


def _weakness(group: list[Outcome], rival: str) -> Weakness | None:
    """Return the weakness among the changes of one argument: where the policy is worse than a rival, if anywhere."""
    losses = [(outcome.change, _loss(outcome, rival)) for outcome in group if not outcome.change.same]
    worse = [change for change, loss in losses if loss > 0.0]
    if not worse:
        return None
    trained = next((outcome.change.value for outcome in group if outcome.change.same), np.nan)
    mildest = min(worse, key=lambda change: np.nan_to_num(abs(change.value - trained)))
    return Weakness(max(loss for _, loss in losses), mildest, len(losses) == 1)


def _loss(outcome: Outcome, rival: str) -> float:
    """Return by how much the policy costs more than a rival, m/s; 0 unless that is above two standard errors."""
    difference = outcome.losses[POLICY] - outcome.losses[rival]
    clear = difference.mean() > 2.0 * difference.std(ddof=1) / np.sqrt(difference.size)
    return float(difference.mean()) if clear else 0.0


def _most_missed(all_outcomes: list[Outcome]) -> tuple[Change, str] | None:
    """Return the change with which most objects are missed, and how many, if they are many."""
    shares = [outcome.means[POLICY]["missed"] / outcome.means[POLICY]["of"] for outcome in all_outcomes]
    if max(shares, default=0.0) <= MISSED_TOO_OFTEN:
        return None
    change, _, means = all_outcomes[int(np.argmax(shares))]
    return change, f"{means[POLICY]['missed']} of {means[POLICY]['of']} objects"


def heat_map(played: Played) -> HeatMap:
    """Return what each contestant costs at worst where one thing is off, against the paper's rule with nothing off."""
    weight, all_outcomes, rival = played.matchup.typical, outcomes(played), played.matchup.rival
    contestants = {PAPER: PAPER, rival.name: rival.label, POLICY: POLICY}
    runs = {PAPER: played.paper, rival.name: played.rival, POLICY: played.policy}
    as_it_is: Mapping[str, Mapping[str, Any]]
    as_it_is = {name: {**run.means(weight), "loss": run.loss(weight).mean(), "of": played.count} for name, run in runs.items()}
    as_it_is = next((outcome.means for outcome in all_outcomes if outcome.change.same), as_it_is)
    measure = as_it_is[PAPER]["loss"]

    def cell(mean: Mapping[str, Any], note: str) -> Heat:
        missed = f"{mean['missed']} of {mean['of']} missed" if mean["missed"] else ""
        return Heat(f"{mean['loss']:.2f}", ", ".join(filter(None, (note, missed))), mean["loss"] / measure)

    rows = [("nothing", "as trained and tuned", [cell(as_it_is[name], "") for name in contestants])]
    for group in by_argument(all_outcomes):
        tried = [setting(outcome.change) for outcome in group if not outcome.change.same]
        if not tried:
            continue
        heats = []
        for name in contestants:
            change, _, means = max(group, key=lambda outcome: outcome.means[name]["loss"])
            note = "unchanged" if change.same else setting(change) if len(tried) > 1 else ""
            heats.append(cell(means[name], note))
        between = f"{len(tried)} tried: {tried[0]} to {tried[-1]}" if len(tried) > 1 else tried[0]
        rows.append((factor(group[0].change.argument), between, heats))
    caption = (
        f"Mean V_p + {weight:g} T (m/s), less is better, where one thing is off: the worst of the settings tried, and "
        f"which that is. Blue is below, orange above what the paper's rule costs with nothing off, {measure:.2f} m/s."
    )
    return HeatMap(caption, ("what is off", *contestants.values()), rows)


def table(played: Played) -> Table:
    """Return loss, V_p, T and misses of each contestant under each change."""
    labels = played.matchup.labels
    rows = [
        {"factor": factor(outcome.change.argument), "to": setting(outcome.change), "who": labels.get(name, name), **mean}
        for outcome in outcomes(played)
        for name, mean in outcome.means.items()
    ]
    columns = {
        "changed": "{factor}", "to": "{to}", "contestant": "{who}", f"V_p + {played.matchup.typical:g} T (m/s)": "{loss:.4f}",
        "V_p (m/s)": "{V:.4f}", "T (s)": "{T:.4f}", "missed": "{missed} of {of}",
    }  # fmt: skip
    caption = (
        "One thing is changed at a time; policy and baselines stay as they were trained and tuned. The alarm is a switch "
        "that noise of the force does not reach, so a baseline that looks at nothing else is the same at any noise. A "
        "stiffer coupling keeps its damping ratio. Hard scenarios lie beyond the training ranges: lighter, stiffer, less "
        "elastic, nearer"
    )
    return Table.of(caption, rows, columns)
