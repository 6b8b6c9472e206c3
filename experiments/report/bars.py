"""Targets and results: a row for each bar, with every seed against it. Less is better."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from experiments.lab.comparison import Comparison, verdict
from experiments.lab.statistics import Estimate, Floats
from experiments.report.matchups import PAPER, RULE
from experiments.report.played import Played
from experiments.report.tables import Table

ONE_IN = 1 / 500  # objects that may be missed where one thing is off


@dataclass(frozen=True)
class Bar:
    """A target, and the result of each seed."""

    what: str
    at_most: float
    chosen: str  # the median seed by validation score
    interval: Estimate | None  # of the median seed
    reached: Mapping[str, float]  # by seed

    @property
    def verdict(self) -> str:
        """Whether the median seed meets the bar, and whether its interval leaves that open."""
        return verdict(self.reached[self.chosen], self.at_most, self.interval)


def bars(played: Played, all_played: Sequence[Played]) -> list[Bar]:
    """Return the bars of a matchup; some are measured against policies of other matchups of the report."""
    evaluation, chosen = played.matchup.evaluation, played.matchup.chosen

    def ratio(what: str, at_most: float, ours: Mapping[str, Floats], theirs: Floats) -> Bar:
        reached = {name: float(loss.mean() / theirs.mean()) for name, loss in ours.items()}
        return Bar(what, at_most, chosen, Comparison.of_means(ours[chosen], theirs).ratio, reached)

    targets: list[Bar] = []
    measures = {
        other.matchup.name: (f"the policy of {other.matchup.name}", other.policy_as_late) for other in all_played
    }
    measures[RULE] = ("the paper's rule", played.paper)
    if evaluation.nominal:
        targets += _nominal(played, ratio)
    elif evaluation.at_most is not None and evaluation.of in measures:
        policy, against = measures[evaluation.of]
        ours = {name: run["object_velocity"][0] for name, run in played.as_late.items()}
        what = f"V_p over that of {policy}, as late as the paper's rule"
        targets.append(ratio(what, evaluation.at_most, ours, against["object_velocity"][0]))
    tuned = {name: run for name, run in played.baselines.items() if len(run.weights) > 1}
    for weight in played.matchup.weights if tuned else ():
        losses = {name: run.loss(weight) for name, run in tuned.items()}
        best = min(losses, key=lambda name: losses[name].mean())
        ours = {name: run.loss(weight) for name, run in played.seeds.items()}
        targets.append(ratio(f"V_p + w T over that of {best}, w = {weight:g}", 1.0, ours, losses[best]))
    as_late = played.as_late
    missed = {name: float(run["missed"].sum() + as_late[name]["missed"].sum()) for name, run in played.seeds.items()}
    return [*targets, Bar("objects missed, at all weights", 0.0, chosen, None, missed)]


def _nominal(played: Played, ratio: Callable[[str, float, Mapping[str, Floats], Floats], Bar]) -> Iterator[Bar]:
    """Yield the bars where nothing is drawn, and where one thing alone is off."""
    evaluation, typical = played.matchup.evaluation, played.matchup.typical
    if (measure := played.nominal.get(evaluation.of)) is not None and evaluation.at_most is not None:
        for weight in played.matchup.weights:
            ours = {name: played.nominal[name].loss(weight) for name in played.seeds}
            what = f"V_p + w T over that of {evaluation.of}'s policy, w = {weight:g}"
            yield ratio(f"with nothing drawn, alarm as there, {what}", evaluation.at_most, ours, measure.loss(weight))
    chosen, worst, missed = played.matchup.chosen, 0.0, 0.0
    for change in played.matchup.changes:
        policy, rule = (played.varied[change.argument, change.label, name] for name in (chosen, PAPER))
        worst = max(worst, float(policy.loss(typical).mean() / rule.loss(typical).mean()))
        missed = max(missed, float(policy.at(typical).missed.mean()))
    condition = f"with one thing off at a time, at its worst, w = {typical:g}"
    yield Bar(f"V_p + w T over that of the paper's rule, {condition}", 1.0, chosen, None, {chosen: worst})
    yield Bar(f"share of objects missed, {condition}", ONE_IN, chosen, None, {chosen: missed})


def table(targets: Sequence[Bar]) -> Table:
    """Return the bars as a table."""
    body = []
    for bar in targets:
        values = list(bar.reached.values())
        median_seed = f"{bar.reached[bar.chosen]:g}" if bar.interval is None else f"{bar.interval:.3f}"
        spread = ", ".join(f"{value:.4g}" for value in (min(values), median(values), max(values)))
        meet = f"{sum(value <= bar.at_most for value in values)} of {len(values)}"
        body.append((bar.what, f"{bar.at_most:g}", median_seed, spread, meet, bar.verdict))
    head = ("what", "at most", "median seed", "seeds: least, middle, most", "seeds that meet it", "")
    return Table("Targets and results; less is better, 95 % intervals over scenarios", head, body)
