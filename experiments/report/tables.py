"""Tables and charts of the report."""

import numpy as np
from matplotlib.figure import Figure

from experiments.lab.charts import OTHERS, SERIES
from experiments.lab.parts import Picture, Table, percent
from experiments.lab.statistics import Comparison, estimate, tolerated
from experiments.report.answer import Answer, at_least, rival_words, sooner
from experiments.report.episodes import Played
from experiments.report.matchups import BOUND, PAPER, POLICY
from impact_gym.task.task import VELOCITY_RANGE

LOOKS = (("-", "X"), ("-", "o"), ("--", "s"), (":", "D"), ("-.", "^"), ((0, (8, 2, 1, 2)), "v"), ((0, (1, 3)), ">"))


def answered(answer: Answer, played: Played) -> Table:
    """Return the table of the answer, with intervals."""
    reduction = percent(answer.reduction) + ("" if answer.reached else " (at the nearest time of the policy)")
    body = [
        ("V_p lower at the paper's approach time", reduction),
        ("95 % of trainings: at least", at_least(answer)),
        (f"V_p lower there, {played.matchup.rival.plain}", rival_words(answer)),
        ("approach time at the paper's V_p", "(not reached) " * (answer.beyond == "faster") + sooner(answer)),
        ("V_p at the paper's approach time (m/s)", f"{answer.velocity:.3f}"),
        ("share of scenarios with a lower V_p", percent(answer.improvement)),
        ("objects missed, at all weights", f"{answer.missed} of {answer.episodes:,}"),
    ]
    policies = f"{len(played.seeds)} trainings" if len(played.seeds) > 1 else "One policy"
    caption = (
        f"{policies} against the paper's rule in {played.count:,} scenarios, 95 % intervals; V_p: of touched objects"
    )
    return Table(caption, ("what", POLICY), body)


def at_one_time(played: Played) -> Table:
    """Return means and 95th percentiles of each contestant, at the weight whose mean time is nearest to the rule's."""
    goal, labels = played.paper.front[0][0], played.matchup.labels
    contestants = {labels[name]: run for name, run in played.baselines.items()} | {
        POLICY: played.as_late[played.matchup.chosen]
    }
    columns = {"T (s)": "approach_time", "V_p (m/s)": "object_velocity", "peak force (N)": "peak_force"}
    columns |= {} if played.paper.at(played.paper.weights[0]).rest_time is None else {"at rest (s)": "rest_time"}
    body = []
    for label, run in contestants.items():
        weight = min(run.weights, key=lambda each: abs(run.means(each)["T"] - goal))
        episodes = run.at(weight)
        values = [getattr(episodes, field) for field in columns.values()]
        values[1] = values[1][~episodes.missed]
        numbers = [f"{each.mean():.3g}, {np.percentile(each, 95.0):.3g}" if each.size else "-" for each in values]
        body.append((label, f"{weight:.3g}", *numbers, str(int(run.at(weight).missed.sum()))))
    caption = f"Mean, 95th percentile of {played.count:,} scenarios; V_p: of touched objects"
    return Table(caption, ("contestant", "w (m/s per s)", *columns, "missed"), body)


def by_weight(played: Played) -> Table:
    """Return the table that compares the cost of policy, rival and clairvoyant search at each weight."""
    body = []
    for weight in played.matchup.weights:
        ours = np.array([run.loss(weight) for run in played.seeds.values()])
        theirs, chosen = played.rival.loss(weight), played.policy.loss(weight)
        median, recipe = (Comparison.of_means(loss, theirs).ratio for loss in (chosen, ours))
        by_seed, gap = ours.mean(axis=1), "-"
        if played.searched is not None and weight in played.searched.weights:
            bound = played.searched.loss(weight)
            gaps = [Comparison.of_means(bound, loss[..., : bound.size]).less for loss in (ours, theirs)]
            gap = ", ".join(f"{estimate:.3f}" for estimate in gaps)
        next_one = f"{-tolerated(-by_seed):.4f}, {by_seed.max():.4f}" if by_seed.size > 1 else "-"
        body.append((f"{weight:g}", f"{chosen.mean():.4f}", f"{theirs.mean():.4f}", f"{median:.4f}", f"{recipe:.4f}",
                     next_one, gap))  # fmt: skip
    head = ("time weight (m/s per s)", "median seed (m/s)", f"{played.matchup.rival.label} (m/s)", "ratio, median seed",
            "ratio, all seeds", "95 % of trainings at most, worst seed (m/s)",
            "above the clairvoyant search: policy, baseline (m/s)")  # fmt: skip
    return Table("V_p + w T of policy and main baseline; below a ratio of 1 the policy is better", head, body)


def measures(played: Played) -> Table:
    """Return the table of times, velocities, forces and impulses of the main contestants."""
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
        velocity, peak, touched = episodes.object_velocity, episodes.peak_force, ~episodes.missed
        impulse = velocity * episodes.scenario["object_mass"]
        row = {
            "contestant": label,
            "T (s)": f"{episodes.approach_time.mean():.4f}",
            "V_p (m/s)": f"{estimate(played.resamples.means_where(velocity, touched)):.3f}",
            "V_p, mean of the worst 5 %": f"{np.sort(velocity)[-max(1, round(0.05 * velocity.size)) :].mean():.3f}",
            "peak force (N): mean, 95 %": f"{peak.mean():.1f}, {np.quantile(peak, 0.95):.0f}",
            "impulse (N s)": f"{played.resamples.means_where(impulse, touched)[0]:.4f}",
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
    caption = f"Means over the same {played.count:,} scenarios; V_p and impulse, object mass times V_p: touched objects"
    caption += "; deflection of the tool's spring in the first of these scenarios" if played.travelled else ""
    return Table(caption, tuple(rows[0]), [tuple(row.values()) for row in rows])


def trade_off(played: Played, first_screen: bool = False) -> Picture:
    """Return the chart of V_p against time; for the `first_screen`, only with rule, median seed and main baseline."""
    matchup = played.matchup
    until = "all is done" if matchup.operated else "the touch"
    names = (PAPER, matchup.rival.name) if first_screen else played.baselines
    labels = {each.name: each.plain if first_screen else each.label for each in matchup.baselines}
    bound = None if first_screen else played.searched
    others = [] if first_screen else [run for run in played.seeds.values() if run is not played.policy]
    runs = {PAPER: [played.paper], POLICY: [played.policy, *others]}
    runs |= {labels[name]: [played.baselines[name]] for name in names}
    runs |= {BOUND: [bound]} if bound else {}
    figure = Figure(figsize=(4.4, 3.4) if first_screen else (8.0, 4.8))
    axes = figure.subplots()
    for k, (name, each) in enumerate(runs.items()):
        line, marker = LOOKS[min(k, len(LOOKS) - 1)]
        colour = SERIES[k] if k < len(SERIES) else OTHERS
        for place, run in enumerate(each):
            means = [run.means(weight) for weight in sorted(run.weights)]
            curve = [mean["T"] for mean in means], [mean["V"] for mean in means]
            if place == 0:
                axes.plot(*curve, color=colour, linestyle=line, marker=marker, label=name)
            else:
                axes.plot(*curve, color=colour, linewidth=0.8, alpha=0.45)
    axes.set(xlabel=f"mean time until {until} (s)", ylabel="mean V_p (m/s)", ylim=(0.0, None))
    axes.legend(fontsize=9)
    places = [f"{time:.3f} s and {velocity:.3f} m/s" for time, velocity in (*played.paper.front, *played.policy.front)]
    alternative = f"Paper's rule: {places[0]}. The learned policy: from {places[1]} to {places[-1]}."
    if first_screen:
        speed = min(1.0, matchup.environment.get("velocity_range", VELOCITY_RANGE)[1])
        tuning = "" if matchup.rival.name == PAPER else f", and for which the {matchup.rival.plain} is tuned"
        heading = "Final speed of the object, V_p"
        caption = (
            "Down and left is better: gentler and sooner. Along each line the time weight falls from left to right. "
            f"Each mark is one time weight, which the policy observes{tuning}. The rule of the paper, Tommasino et al. "
            f"2020, moves at {speed:g} m/s and brakes at the alarm."
        )
    else:
        heading = f"Time until {until} against V_p, all contestants and seeds"
        caption = (
            "Down and left is better. Each line joins the time weights of one contestant; faint lines are other seeds."
        )
        caption += "" if bound is None else (
            f" The {BOUND} knows the object: it is the best approach that a search found for each of the first "
            f"{bound['missed'].shape[1]} scenarios."
        )  # fmt: skip
    name = f"figures/{matchup.name}_{'answer' if first_screen else 'trade_off'}"
    return Picture(name, figure, alternative, caption, heading)
