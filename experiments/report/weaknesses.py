"""Where the policy does not hold: the one line of the first screen, the heat map, and the list of all comparisons."""

from itertools import chain
from typing import NamedTuple

import numpy as np

from agents.setups.evaluation import Change
from experiments.report.answer import MISSED_TOO_OFTEN
from experiments.report.matchups import PAPER, POLICY
from experiments.report.played import Played, Run
from experiments.report.robustness import Varied, factor, setting, varied
from experiments.report.tables import Heat, HeatMap


class Failing(NamedTuple):
    """Where the policy does not hold."""

    worst: str  # in one line: the change under which it fares worst
    details: str  # all changes


class Weakness(NamedTuple):
    """One argument of the environment with which the policy is worse than a rival."""

    loss: float  # m/s, the largest
    mildest: Change  # with which it is worse
    only: bool  # nothing else was tried


def where_it_fails(played: Played) -> Failing:
    """Return with which changes the policy is worse than the paper's rule and than its rival, or misses objects.

    The worst is the one by which it misses most, or else loses most, to the rule before the rival.
    """
    by_argument, missed, rival = varied(played), _most_missed(played), played.matchup.rival
    sentences, worse = list[str](), list[tuple[Change, str]]()
    for name, plain in {PAPER: PAPER, rival.name: rival.plain}.items():
        weaknesses = [weakness for changes in by_argument if (weakness := _weakness(played, changes, name))]
        weaknesses.sort(key=lambda weakness: -weakness.loss)
        if weaknesses:
            sentences.append(f"Worse than the {plain} with {', '.join(map(_with, weaknesses))}.")
        worse += [(weakness.mildest, plain) for weakness in weaknesses]
    if missed:
        change, misses = missed
        sentences.append(f"It misses {misses} with {factor(change.argument)} at {setting(change)}.")
    if not sentences:
        tried = sum(not change.same for change, _ in chain.from_iterable(by_argument))
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


def _weakness(played: Played, changes: Varied, rival: str) -> Weakness | None:
    """Return the weakness among the changes of one argument: where the policy is worse than a rival, if anywhere."""
    losses = [(change, _loss(played, runs, rival)) for change, runs in changes if not change.same]
    worse = [change for change, loss in losses if loss > 0.0]
    if not worse:
        return None
    trained = next((change.value for change, _ in changes if change.same), np.nan)
    mildest = min(worse, key=lambda change: np.nan_to_num(abs(change.value - trained)))
    return Weakness(max(loss for _, loss in losses), mildest, len(losses) == 1)


def _most_missed(played: Played) -> tuple[Change, str] | None:
    """Return the change with which most objects are missed, and how many, if they are many."""
    weight, changes = played.matchup.typical, list(chain.from_iterable(varied(played)))
    if not changes:
        return None
    change, runs = max(changes, key=lambda changed: changed[1][POLICY].at(weight).missed.mean())
    missed = runs[POLICY].at(weight).missed
    return (change, f"{missed.sum()} of {missed.size} objects") if missed.mean() > MISSED_TOO_OFTEN else None


def heat_map(played: Played) -> HeatMap:
    """Return what each contestant costs at worst where one thing is off, against the paper's rule with nothing off."""
    weight, by_argument = played.matchup.typical, varied(played)
    rival = played.matchup.rival
    contestants = {PAPER: PAPER, rival.name: rival.label, POLICY: POLICY}
    as_it_is = {PAPER: played.paper, rival.name: played.rival, POLICY: played.policy}
    as_it_is = next((runs for change, runs in chain.from_iterable(by_argument) if change.same), as_it_is)
    measure = as_it_is[PAPER].means(weight)["loss"]

    def cell(runs: Run, note: str) -> Heat:
        mean = runs.means(weight)
        missed = f"{mean['missed']} of {runs['missed'].shape[1]} missed" if mean["missed"] else ""
        return Heat(f"{mean['loss']:.2f}", ", ".join(filter(None, (note, missed))), mean["loss"] / measure)

    rows = [("nothing", "as trained and tuned", [cell(as_it_is[name], "") for name in contestants])]
    for changes in by_argument:
        tried = [setting(change) for change, _ in changes if not change.same]
        if not tried:
            continue
        cells = []
        for name in contestants:
            change, runs = max(changes, key=lambda changed: changed[1][name].means(weight)["loss"])
            cells.append(cell(runs[name], "unchanged" if change.same else setting(change) if len(tried) > 1 else ""))
        between = f"{len(tried)} tried: {tried[0]} to {tried[-1]}" if len(tried) > 1 else tried[0]
        rows.append((factor(changes[0][0].argument), between, cells))
    caption = (
        f"Mean V_p + {weight:g} T (m/s), less is better, where one thing is off: the worst of the settings tried, and "
        f"which that is. Blue is below, orange above what the paper's rule costs with nothing off, {measure:.2f} m/s."
    )
    return HeatMap(caption, ("what is off", *contestants.values()), rows)


def _loss(played: Played, runs: dict[str, Run], rival: str) -> float:
    """Return by how much the policy costs more than a rival, m/s; 0 unless that is above two standard errors."""
    weight = played.matchup.typical
    difference = runs[POLICY].loss(weight) - runs[rival].loss(weight)
    clear = difference.mean() > 2.0 * difference.std(ddof=1) / np.sqrt(difference.size)
    return float(difference.mean()) if clear else 0.0
