"""What was to be reached, and what was: a row for each bar, with every seed against it. Less is better."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np

from experiments.lab.statistics import Estimate, Floats, Resamples, estimate
from experiments.report.figures import Table, plain
from experiments.report.results import Played

RULE = "paper-trapezoid"


@dataclass(frozen=True)
class Bar:
    """What was to be reached, and what each seed reached."""

    what: str
    at_most: float
    chosen: str  # the median seed by validation score
    interval: Estimate | None  # of that one
    reached: Mapping[str, float]  # by seed

    @property
    def verdict(self) -> str:
        """Whether the median seed meets it, and whether its interval leaves that open."""
        met = "met" if self.reached[self.chosen] <= self.at_most else "missed"
        open_still = self.interval is not None and self.interval.low <= self.at_most < self.interval.high
        return f"{met}, within the interval" if open_still else met


def bars(played: Played, others: Sequence[Played]) -> list[Bar]:
    """Return the bars of a matchup; `others` are all of the report, against whose policies some are measured."""
    evaluation, chosen = played.matchup.evaluation, played.matchup.chosen
    found = []
    against = played.paper if evaluation.of == RULE else None
    against = next((one.policy_as_late for one in others if one.matchup.name == evaluation.of), against)
    if evaluation.at_most is not None and against is not None:
        whom = "the paper's rule" if evaluation.of == RULE else f"the policy of {evaluation.of}"
        ours = {name: run["object_velocity"][0] for name, run in played.as_late.items()}
        what = f"V_p over that of {whom}, as late as the paper's rule"
        found.append(_bar(what, evaluation.at_most, chosen, ours, against["object_velocity"][0]))
    tuned = {name: run for name, run in played.baselines.items() if len(run.weights) > 1}
    for weight in played.matchup.weights if tuned else ():
        losses = {name: run.loss(weight) for name, run in tuned.items()}
        best = min(losses, key=lambda name: losses[name].mean())
        ours = {name: run.loss(weight) for name, run in played.seeds.items()}
        found.append(_bar(f"V_p + w T over that of {best}, w = {weight:g}", 1.0, chosen, ours, losses[best]))
    missed = {
        name: float(run["missed"].sum() + played.as_late[name]["missed"].sum()) for name, run in played.seeds.items()
    }
    return [*found, Bar("objects missed, at all weights", 0.0, chosen, None, missed)]


def _bar(what: str, at_most: float, chosen: str, ours: Mapping[str, Floats], theirs: Floats) -> Bar:
    resamples = Resamples(theirs.size)
    means = resamples.means(theirs[None])
    interval = estimate(resamples.means(ours[chosen][None]) / means)
    reached = {name: float(np.mean(one) / np.mean(theirs)) for name, one in ours.items()}
    return Bar(what, at_most, chosen, interval, reached)


def table(found: Sequence[Bar]) -> Table:
    """Return the bars as a table."""
    body = []
    for bar in found:
        values = list(bar.reached.values())
        value = f"{bar.reached[bar.chosen]:g}" if bar.interval is None else plain(bar.interval)
        spread = ", ".join(f"{one:.4g}" for one in (min(values), median(values), max(values)))
        meet = f"{sum(value <= bar.at_most for value in values)} of {len(values)}"
        body.append((bar.what, f"{bar.at_most:g}", value, spread, meet, bar.verdict))
    head = ("what", "at most", "median seed", "seeds: least, middle, most", "seeds that meet it", "")
    caption = "What was to be reached; less is better, 95 % intervals over scenarios"
    return Table(caption, head, tuple(body))
