"""Where the policy does not hold: the one line of the first screen, the heat map, and the list of all comparisons."""

from itertools import chain

import numpy as np

from experiments.report.answer import MISSED_TOO_OFTEN
from experiments.report.figures import Heat, HeatMap
from experiments.report.matchups import PAPER, POLICY
from experiments.report.results import Played, Run
from experiments.report.robustness import Varied, factor, setting, varied


def where_it_fails(played: Played) -> str:
    """Return in one line with which changes the policy is worse than the paper's rule and than its rival, or misses."""
    found, count = varied(played), 0
    said = []
    for rival, called in _rivals(played):
        lost = []
        for of_one in found:
            worse = [change for change, runs in of_one if not change.same and _loss(played, runs, rival) > 0.0]
            count += sum(not change.same for change, _ in of_one)
            if worse:
                own = next((change.value for change, _ in of_one if change.same), np.nan)
                mildest = min(worse, key=lambda change: np.nan_to_num(abs(change.value - own)))
                lost.append(f"{factor(mildest.argument)} ({setting(mildest)})")
        if lost:
            said.append(f"It loses to the {called} from here on: {', '.join(lost)}.")
    if not said:
        said.append(f"It loses in none of {count} comparisons with one thing off at a time.")
    return " ".join([*said, _missing(played, found)]).strip()


def _missing(played: Played, found: list[Varied]) -> str:
    """Say where most objects are missed, if they are many."""
    weight, changed = played.matchup.typical, list(chain.from_iterable(found))
    if not changed:
        return ""
    change, runs = max(changed, key=lambda one: one[1][POLICY].at(weight).missed.mean())
    missed = runs[POLICY].at(weight).missed
    if missed.mean() <= MISSED_TOO_OFTEN:
        return ""
    return f"It misses {missed.sum()} of {missed.size} objects with {factor(change.argument)} at {setting(change)}."


def heat_map(played: Played) -> HeatMap:
    """Return what each contestant costs at worst where one thing is off, against the paper's rule with nothing off."""
    weight, found = played.matchup.typical, varied(played)
    contestants = dict(reversed([(POLICY, POLICY), *_rivals(played)]))
    as_it_is = {PAPER: played.paper, played.matchup.rival.name: played.rival, POLICY: played.policy}
    as_it_is = next((runs for change, runs in chain.from_iterable(found) if change.same), as_it_is)
    measure = as_it_is[PAPER].means(weight)["loss"]

    def cell(runs: Run, note: str) -> Heat:
        mean = runs.means(weight)
        missed = f"{mean['missed']} of {runs['missed'].shape[1]} missed" if mean["missed"] else ""
        return Heat(f"{mean['loss']:.2f}", ", ".join(filter(None, (note, missed))), mean["loss"] / measure)

    rows = [("nothing", "", [cell(as_it_is[name], "") for name in contestants])]
    for of_one in found:
        cells = []
        for name in contestants:
            change, runs = max(of_one, key=lambda one: one[1][name].means(weight)["loss"])
            cells.append(cell(runs[name], "unchanged" if change.same else setting(change)))
        tried = [setting(change) for change, _ in of_one if not change.same]
        if tried:
            rows.append((factor(of_one[0][0].argument), f"{len(tried)} tried: {tried[0]} to {tried[-1]}"
                         if len(tried) > 1 else tried[0], cells))  # fmt: skip
    caption = (
        f"Mean V_p + {weight:g} T (m/s), less is better, where one thing is off: the worst of the settings tried, and "
        f"which that is. Blue is below, orange above what the paper's rule costs with nothing off, {measure:.2f} m/s."
    )
    return HeatMap(caption, ("what is off", *contestants.values()), rows)


def weak_points(played: Played) -> list[str]:
    """Return sentences on where the policy loses to its rival or to the paper's rule, or misses objects."""
    found = list(chain.from_iterable(varied(played)))
    asked = [(change, runs) for change, runs in found if not change.same]
    said = []
    for rival, called in reversed(_rivals(played)):
        lost = [
            f"{factor(change.argument)} {setting(change)} (by {loss:.3f} m/s)"
            for change, runs in asked
            if (loss := _loss(played, runs, rival)) > 0.0
        ]
        said.append(f"worse than the {called} at {', '.join(lost)}" if lost else f"nowhere worse than the {called}")
    missing = [
        f"{count} of {runs[POLICY]['missed'].shape[1]} at {factor(change.argument)} {setting(change)}"
        for change, runs in found
        if (count := runs[POLICY].means(played.matchup.typical)["missed"])
    ]
    rule = f"{len(asked) * len(said)} comparisons of the median seed, worse by more than two standard errors: "
    return [rule + "; ".join(said) + ".", *([f"It misses {'; '.join(missing)}."] if missing else [])]


def _rivals(played: Played) -> list[tuple[str, str]]:
    """Return the names of the paper's rule and of the baseline to beat, and what they are called."""
    rival = played.matchup.rival
    return list(dict.fromkeys([(PAPER, PAPER), (rival.name, rival.label)]))


def _loss(played: Played, runs: dict[str, Run], rival: str) -> float:
    """Return by how much the policy costs more than a rival, m/s; 0 unless that is above two standard errors."""
    weight = played.matchup.typical
    difference = runs[POLICY].loss(weight) - runs[rival].loss(weight)
    clear = difference.mean() > 2.0 * difference.std(ddof=1) / np.sqrt(difference.size)
    return float(difference.mean()) if clear else 0.0
