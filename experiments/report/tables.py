"""Tables of the report: the answer with its intervals, and results of each contestant in the same scenarios."""

import numpy as np

from experiments.lab.parts import Table, percent
from experiments.lab.statistics import Comparison, estimate, tolerated
from experiments.report.answer import Answer, at_least
from experiments.report.matchups import PAPER, POLICY
from experiments.report.played import Played


def answered(answer: Answer, played: Played) -> Table:
    """Return the answer with its intervals."""
    rival = "-" if answer.rival_reduction is None else percent(answer.rival_reduction)
    sooner = {"": "", "slower": "at least ", "faster": "(not reached) "}[answer.beyond] + percent(answer.sooner)
    reduction = percent(answer.reduction) + ("" if answer.reached else " (at the nearest time it reaches)")
    body = [
        ("V_p lower at the paper's approach time", reduction),
        ("95 % of trainings: at least", at_least(answer)),
        (f"V_p lower there, {played.matchup.rival.plain}", rival),
        ("less approach time at the paper's V_p", sooner),
        ("V_p at the paper's approach time (m/s)", f"{answer.velocity:.3f}"),
        ("share of scenarios with a lower V_p", percent(answer.improvement)),
        ("objects missed, at all weights", f"{answer.missed} of {answer.episodes:,}"),
    ]
    policies = f"{len(played.seeds)} trainings" if len(played.seeds) > 1 else "One policy"
    caption = f"{policies} against the paper's rule in {played.count:,} scenarios, 95 % intervals; a miss is not lower"
    return Table(caption, ("what", POLICY), body)


def at_one_time(played: Played) -> Table:
    """Return mean and 95th percentile of T, V_p and peak force of each contestant.

    Each contestant plays at the weight whose mean approach time is nearest to the rule's. With friction the table also
    has the time at which object and tool rest.
    """
    goal, labels = played.paper.front[0][0], played.matchup.labels
    contestants = {labels[name]: run for name, run in played.baselines.items()} | {
        POLICY: played.as_late[played.matchup.chosen]
    }
    columns = {"T (s)": "approach_time", "V_p (m/s)": "object_velocity", "peak force (N)": "peak_force"}
    columns |= {} if played.paper.at(played.paper.weights[0]).rest_time is None else {"at rest (s)": "rest_time"}
    body = []
    for label, run in contestants.items():
        weight = min(run.weights, key=lambda each: abs(run.means(each)["T"] - goal))
        values = [getattr(run.at(weight), field) for field in columns.values()]
        numbers = [f"{each.mean():.3g}, {np.percentile(each, 95.0):.3g}" for each in values]
        body.append((label, f"{weight:.3g}", *numbers, str(int(run.at(weight).missed.sum()))))
    caption = f"Mean, 95th percentile of {played.count:,} scenarios; a missed object counts as V_p = 0"
    return Table(caption, ("contestant", "w (m/s per s)", *columns, "missed"), body)


def by_weight(played: Played) -> Table:
    """Return V_p + w T of policy, rival and clairvoyant search at each weight, and the tolerance bound of trainings."""
    body = []
    for weight in played.matchup.weights:
        ours, theirs, chosen = played.losses(weight), played.rival.loss(weight), played.policy.loss(weight)
        median, recipe = (Comparison.of_means(loss, theirs).ratio for loss in (chosen, ours))
        by_seed, gap = ours.mean(axis=1), "-"
        if played.bound is not None and weight in played.bound.weights:
            bound = played.bound.loss(weight)
            gaps = [Comparison.of_means(bound, loss[..., : bound.size]).less for loss in (ours, theirs)]
            gap = ", ".join(f"{estimate:.3f}" for estimate in gaps)
        next_one = f"{-tolerated(-by_seed):.4f}, {by_seed.max():.4f}" if by_seed.size > 1 else "-"
        body.append((f"{weight:g}", f"{chosen.mean():.4f}", f"{theirs.mean():.4f}", f"{median:.4f}", f"{recipe:.4f}",
                     next_one, gap))  # fmt: skip
    head = ("time weight (m/s per s)", "median seed (m/s)", f"{played.matchup.rival.label} (m/s)", "ratio, median seed",
            "ratio, all seeds", "95 % of trainings at most, worst seed (m/s)",
            "above the clairvoyant search: policy, baseline (m/s)")  # fmt: skip
    return Table("V_p + w T against the best baseline, tuned for each weight; below 1 the policy is better", head, body)


def measures(played: Played) -> Table:
    """Return times, velocities, forces and impulses of each contestant in the same scenarios."""
    matchup, weight, as_late = played.matchup, played.matchup.typical, played.as_late[played.matchup.chosen]
    runs = {PAPER: (PAPER, played.paper.at(weight))}
    if matchup.rival.name != PAPER:
        runs[f"{matchup.rival.label}, w = {weight:g}"] = matchup.rival.name, played.rival.at(weight)
    if matchup.operated:
        fixed = {name: run for name, run in played.baselines.items() if len(run.weights) == 1}
        runs |= {matchup.labels[name]: (name, run.at(weight)) for name, run in fixed.items()}
    runs[f"{POLICY}, w = {weight:g}"] = matchup.chosen, played.policy.at(weight)
    late = f"{POLICY} at the paper's approach time (w = {as_late.weights[0]:.3g})"
    runs[late] = "", as_late.at(as_late.weights[0])
    rows = []
    for label, (name, episodes) in runs.items():
        velocity, peak = episodes.object_velocity, episodes.peak_force
        row = {
            "contestant": label,
            "T (s)": f"{episodes.approach_time.mean():.4f}",
            "V_p (m/s)": f"{estimate(played.resamples.means(velocity)):.3f}",
            "V_p, mean of the worst 5 %": f"{np.sort(velocity)[-max(1, round(0.05 * velocity.size)) :].mean():.3f}",
            "peak force (N): mean, 95 %": f"{peak.mean():.1f}, {np.quantile(peak, 0.95):.0f}",
            "impulse (N s)": f"{(velocity * episodes.scenario['object_mass']).mean():.4f}",
            "several contacts": f"{100 * (episodes.contact_count > 1).mean():.1f} %",
            "contacts": f"{episodes.contact_count.mean():.2f}",
            "missed": f"{episodes.missed.sum()}",
        }
        if played.travelled:
            way = played.travelled.get(name)
            row["deflection (mm): 95 % before the touch, largest"] = (
                f"{1e3 * np.quantile(way['before'], 0.95):.0f}, {1e3 * way['in_all'].max():.0f}" if way else "-"
            )
        if matchup.operated:
            more = {"slide (m)": "slide", "until the touch (s)": "touch_time", "taken": "taken"}
            row |= {heading: f"{getattr(episodes, result).mean():.3f}" for heading, result in more.items()}
        rows.append(row)
    caption = f"Means over the same {played.count:,} scenarios; impulse: object mass times V_p"
    caption += "; deflection of the tool's spring in the first of these scenarios" if played.travelled else ""
    return Table(caption, tuple(rows[0]), [tuple(row.values()) for row in rows])
