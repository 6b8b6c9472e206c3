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
    """What was to be reached, and what each seed reached."""

    what: str
    at_most: float
    chosen: str  # the median seed by validation score
    interval: Estimate | None  # of that one
    reached: Mapping[str, float]  # by seed

    @property
    def verdict(self) -> str:
        """Whether the median seed meets it, and whether its interval leaves that open."""
        return verdict(self.reached[self.chosen], self.at_most, self.interval)


def bars(played: Played, others: Sequence[Played]) -> list[Bar]:
    """Return the bars of a matchup; `others` are all of the report, against whose policies some are measured."""
    evaluation, chosen = played.matchup.evaluation, played.matchup.chosen

    def ratio(what: str, at_most: float, ours: Mapping[str, Floats], theirs: Floats) -> Bar:
        reached = {name: float(one.mean() / theirs.mean()) for name, one in ours.items()}
        return Bar(what, at_most, chosen, Comparison.of_means(ours[chosen], theirs).ratio, reached)

    found: list[Bar] = []
    known = {one.matchup.name: (f"the policy of {one.matchup.name}", one.policy_as_late) for one in others}
    known[RULE] = ("the paper's rule", played.paper)
    if evaluation.nominal:
        found += _nominal(played, ratio)
    elif evaluation.at_most is not None and evaluation.of in known:
        whom, against = known[evaluation.of]
        ours = {name: run["object_velocity"][0] for name, run in played.as_late.items()}
        what = f"V_p over that of {whom}, as late as the paper's rule"
        found.append(ratio(what, evaluation.at_most, ours, against["object_velocity"][0]))
    tuned = {name: run for name, run in played.baselines.items() if len(run.weights) > 1}
    for weight in played.matchup.weights if tuned else ():
        losses = {name: run.loss(weight) for name, run in tuned.items()}
        best = min(losses, key=lambda name: losses[name].mean())
        ours = {name: run.loss(weight) for name, run in played.seeds.items()}
        found.append(ratio(f"V_p + w T over that of {best}, w = {weight:g}", 1.0, ours, losses[best]))
    late = played.as_late
    missed = {name: float(run["missed"].sum() + late[name]["missed"].sum()) for name, run in played.seeds.items()}
    return [*found, Bar("objects missed, at all weights", 0.0, chosen, None, missed)]


def _nominal(played: Played, ratio: Callable[[str, float, Mapping[str, Floats], Floats], Bar]) -> Iterator[Bar]:
    """Yield what was to be reached where nothing is drawn, and where one thing alone is off."""
    evaluation, weight = played.matchup.evaluation, played.matchup.typical
    if (measure := played.nominal.get(evaluation.of)) is not None and evaluation.at_most is not None:
        for each in played.matchup.weights:
            ours = {name: played.nominal[name].loss(each) for name in played.seeds}
            what = f"with nothing drawn, alarm as there, V_p + w T over that of {evaluation.of}'s policy, w = {each:g}"
            yield ratio(what, evaluation.at_most, ours, measure.loss(each))
    chosen, worst, missed = played.matchup.chosen, 0.0, 0.0
    for change in played.matchup.changes:
        policy, rule = (played.varied[change.argument, change.label, name] for name in (chosen, PAPER))
        worst = max(worst, float(policy.loss(weight).mean() / rule.loss(weight).mean()))
        missed = max(missed, float(policy.at(weight).missed.mean()))
    where = f"with one thing off at a time, at its worst, w = {weight:g}"
    yield Bar(f"V_p + w T over that of the paper's rule, {where}", 1.0, chosen, None, {chosen: worst})
    yield Bar(f"share of objects missed, {where}", ONE_IN, chosen, None, {chosen: missed})


def table(found: Sequence[Bar]) -> Table:
    """Return the bars as a table."""
    body = []
    for bar in found:
        values = list(bar.reached.values())
        value = f"{bar.reached[bar.chosen]:g}" if bar.interval is None else f"{bar.interval:.3f}"
        spread = ", ".join(f"{one:.4g}" for one in (min(values), median(values), max(values)))
        meet = f"{sum(value <= bar.at_most for value in values)} of {len(values)}"
        body.append((bar.what, f"{bar.at_most:g}", value, spread, meet, bar.verdict))
    head = ("what", "at most", "median seed", "seeds: least, middle, most", "seeds that meet it", "")
    return Table("What was to be reached; less is better, 95 % intervals over scenarios", head, body)
