"""The first screen: the answer without intervals, and the trade-off."""

from typing import Any

import altair as alt
import numpy as np
import polars as pl

from experiments.lab.statistics import estimate
from experiments.report.answer import Answer, in_words
from experiments.report.figures import Figure, chart_of, looks_of
from experiments.report.matchups import IMITATES, PAPER, POLICY
from experiments.report.played import MISSED_TOO_OFTEN, Played
from impact_gym.task.task import VELOCITY_RANGE

WIDTH, HEIGHT = 400, 270  # pixels; on a phone the chart is scaled to 0.85 or more


def at_rule_time(answer: Answer, played: Played) -> str:
    """Return the policy's gain at the paper's mean approach time, or the weight at which it would take that time."""
    if answer.missed > MISSED_TOO_OFTEN * answer.episodes:
        return (f"The learned policy misses {answer.missed:,} of {answer.episodes:,} objects, so nothing is claimed "
                "for it at the time of the paper's rule.")  # fmt: skip
    slower, rival = _less(answer.reduction.value), ""
    if answer.rival_reduction:
        rival = f", with the {played.matchup.rival.plain} {_less(answer.rival_reduction.value)}"
    if answer.reached:
        text = (
            f"At the mean approach time of the paper's rule the object leaves {slower} with the learned policy{rival}."
        )
    else:
        more, largest = ("more", "largest") if answer.later > 0.0 else ("less", "smallest")
        needed = f"; a weight of about {answer.needed:.2g} would match the rule's time" if answer.needed > 0.0 else ""
        text = (
            f"Even at its {largest} time weight the learned policy takes {100 * abs(answer.later):.0f} % {more} time "
            f"than the paper's rule{needed}. At that {largest} weight the object leaves {slower}{rival}."
        )
    imitates = " The policy's training began by imitating a tuned profile." if IMITATES in played.matchup.note else ""
    return text + imitates


def _less(share: float) -> str:
    return f"{100 * abs(share):.0f} % {'slower' if share >= 0.0 else 'faster'}"


def assisted(played: Played, intervals: bool = False) -> str:
    """Return the slide of the object and the time until all is done, for each assistance of an operator."""
    weight, plain = played.matchup.typical, {each.name: each.plain for each in played.matchup.baselines}
    contestants = {f"the {POLICY}": list(played.seeds.values())}
    contestants |= {plain[name]: [run] for name, run in played.baselines.items()}
    parts = []
    for name, runs in contestants.items():
        slide, done = (np.array([getattr(run.at(weight), what) for run in runs]) for what in ("slide", "done_time"))
        estimates = (estimate(played.resamples.means(values)) for values in (100.0 * slide, done))  # cm, s
        length, time = (f"{each:.2f}" if intervals else f"{each.value:.1f}" for each in estimates)
        parts.append(f"{length} cm and {time} s with {name}")
    return (
        f"Slide of the object and time until all is done, at a time weight of {weight:g} m/s per s: {'; '.join(parts)}."
    )


def chart(answer: Answer, played: Played) -> Figure:
    """Return the chart of the paper's rule, the best tuned baseline and the policy, each labelled in place."""
    rival = played.matchup.rival.plain
    runs = {POLICY: played.policy, PAPER: played.paper, rival: played.rival}  # a sole baseline, the rule, is the rival
    data = pl.DataFrame([
        {"contestant": name, "w": weight, **run.means(weight)} for name, run in runs.items() for weight in run.weights
    ])  # fmt: skip
    looks, axis = looks_of(data), alt.Axis(tickCount=5)
    title = f"mean time until {played.matchup.until} (s)"
    horizontal = alt.X("T:Q", title=title, scale=alt.Scale(zero=False, nice=True), axis=axis)
    vertical = alt.Y("V:Q", title=None, scale=alt.Scale(zero=True), axis=axis)
    base = chart_of(data).encode(horizontal, vertical, looks.colour.legend(None))
    size = alt.condition(alt.datum.contestant == PAPER, alt.value(170), alt.value(45))
    lines = base.mark_line(strokeWidth=2.5).encode(looks.dash.legend(None), order="w:Q")
    marks = base.mark_point().encode(looks.shape.legend(None), size=size)

    def label(text: str, x: float, y: float, contestant: str, **placing: Any) -> alt.Chart:
        point = pl.DataFrame([{"text": text, "T": x, "V": y, "contestant": contestant}])
        return chart_of(point).mark_text(fontSize=13, fontWeight=600, **placing).encode(
            horizontal, vertical, looks.colour.legend(None), text="text:N"
        )  # fmt: skip

    paper = played.paper.means(played.matchup.typical)
    learned, tuned = played.policy.front, played.rival.front
    points = [*learned, *tuned, *played.paper.front]
    (earliest, _), (latest, _) = min(points), max(points)
    left = paper["T"] > 0.5 * (earliest + latest)  # the side with more room
    placing = {"align": "right", "dx": -12} if left else {"align": "left", "dx": 12}
    layers = [lines, marks, label(PAPER, paper["T"], paper["V"], PAPER, **placing)]
    low = learned[-1][1] < 0.12 * max(velocity for _, velocity in points)  # no room above the axis
    layers.append(label(POLICY, *learned[-1], POLICY, align="right", dy=-12 if low else 20))
    if rival != PAPER:
        last = tuned[-1][0] > 0.3 * earliest + 0.7 * latest  # no room for a label on the right
        offset: dict[str, Any] = {"align": "right", "dy": -24} if last else {"align": "left", "dx": 8, "dy": -8}
        layers.append(label(rival, *tuned[-1], rival, **offset))
    if answer.reached and answer.reduction.value > 0.0:
        gain_at = pl.DataFrame([{"T": paper["T"], "V": paper["V"], "to": answer.velocity.value}])
        middle = 0.5 * (paper["V"] + answer.velocity.value)
        gain = label(_less(answer.reduction.value), paper["T"], middle, POLICY, align="left", dx=6)
        layers = [chart_of(gain_at).mark_rule(strokeDash=[2, 3]).encode(horizontal, vertical, y2="to:Q"), gain, *layers]
    fastest = played.matchup.environment.get("velocity_range", VELOCITY_RANGE)[1]
    tuning = "" if rival == PAPER else f", and for which the {rival} is tuned"
    caption = ("Down and left is better: gentler and sooner. Along each line the time weight falls from left to right. "
               f"Each mark is one time weight, which the policy observes{tuning}. The rule of the paper, Tommasino et "
               f"al. 2020, moves at {min(1.0, fastest):g} m/s and brakes at the alarm.")  # fmt: skip
    heading = "Final speed of the object, V_p (m/s)"
    return Figure(
        played.matchup.name, "answer", heading, caption, in_words(played), alt.layer(*layers), data, HEIGHT, WIDTH
    )
