"""The table of all contestants and the chart of the report."""

import numpy as np
from matplotlib.figure import Figure

from experiments.lab.charts import SERIES
from experiments.lab.parts import Picture, Table, percent
from experiments.lab.statistics import estimate
from experiments.report.choice import Choice, simplest_first
from experiments.report.episodes import Played
from experiments.report.matchups import BOUND, PAPER, POLICY
from impact_gym.task.task import VELOCITY_RANGE

LOOKS = (("-", "X"), ("-", "o"), ("--", "s"), (":", "D"))  # line and marker of rule, policy, main baseline and search


def contestants(result: Choice, played: Played) -> Table:
    """Return the table of cost, time, velocity and forces of each contestant at the typical weight, simplest first.

    The last row is the policy at about the paper's approach time.
    """
    matchup, weight, as_late = played.matchup, result.time_weight, played.as_late[played.matchup.chosen]
    compared = {name: f"{percent(above)} above" for name, above in result.above.items()}
    compared[result.controller] = "best choice"
    each = [(matchup.labels[name], played.runs[name], compared[name])
            for name in (contestant.name for contestant in simplest_first(matchup))]  # fmt: skip
    late = f"{POLICY} at about the paper's approach time (w = {as_late.weights[0]:.3g})"
    rows = []
    for label, run, against in [*each, (late, as_late, "-")]:
        episodes = run.at(weight)
        velocity, peak, touched = episodes.object_velocity, episodes.peak_force, ~episodes.missed
        impulse = velocity * episodes.scenario["object_mass"]
        row = {
            "controller": label,
            f"V_p + {weight:g} T (m/s)": f"{estimate(played.resamples.means(run.loss(weight))):.4f}",
            "against the best choice": against,
            "T (s)": f"{episodes.approach_time.mean():.4f}",
            "V_p (m/s)": f"{estimate(played.resamples.means_where(velocity, touched)):.3f}",
            "V_p, mean of the worst 5 %": f"{np.sort(velocity)[-max(1, round(0.05 * velocity.size)) :].mean():.3f}",
            "peak force (N): mean, 95 %": f"{peak.mean():.1f}, {np.quantile(peak, 0.95):.0f}",
            "impulse (N s)": f"{played.resamples.means_where(impulse, touched)[0]:.4f}",
            "several contacts": f"{100 * (episodes.contact_count > 1).mean():.1f} %",
            "missed": f"{episodes.missed.sum()}",
        }
        if matchup.operated:
            more = {"slide (m)": "slide", "until the touch (s)": "touch_time", "taken": "taken"}
            row |= {heading: f"{getattr(episodes, name).mean():.3f}" for heading, name in more.items()}
        rows.append(row)
    drawn = played.choosing[result.controller]["missed"].shape[1]
    caption = (
        f"The best choice is the simplest controller whose cost is not clearly above the lowest, on {drawn:,} "
        f"other scenarios (on these, if a CSV file gives them). The numbers are of these {played.count:,} scenarios, "
        "with the median seed's policy (in the ablation: the mean of all seeds) and 95 % intervals over scenarios. "
        "V_p and impulse, object mass times V_p: touched objects. The weight of the last row was found on other "
        "scenarios, too"
    )
    return Table.joined(caption, rows)


def trade_off(played: Played) -> Picture:
    """Return the chart of V_p against time, with rule, policy, main baseline and clairvoyant search."""
    matchup, rival = played.matchup, played.matchup.rival
    others = [run for run in played.seeds.values() if run is not played.policy]
    runs = {PAPER: [played.paper], POLICY: [played.policy, *others]}
    runs |= {rival.label: [played.rival]} if rival.name != PAPER else {}
    runs |= {BOUND: [played.searched]} if played.searched else {}
    figure = Figure(figsize=(4.4, 3.4))
    axes = figure.subplots()
    for (name, each), (line, marker), colour in zip(runs.items(), LOOKS, SERIES, strict=False):
        for run in each:
            points = np.array([[mean["T"], mean["V"]] for mean in map(run.means, sorted(run.weights))])
            if run is each[0]:
                axes.plot(*points.T, color=colour, linestyle=line, marker=marker, label=name)
            else:
                axes.plot(*points.T, color=colour, linewidth=0.8, alpha=0.45)
    until = "all is done" if matchup.operated else "the touch"
    axes.set(xlabel=f"mean time until {until} (s)", ylabel="mean V_p (m/s)", ylim=(0.0, None))
    axes.legend(fontsize=9)
    places = [f"{time:.3f} s and {velocity:.3f} m/s" for time, velocity in (*played.paper.front, *played.policy.front)]
    alternative = f"Paper's rule: {places[0]}. The learned policy: from {places[1]} to {places[-1]}."
    speed = min(1.0, matchup.environment.get("velocity_range", VELOCITY_RANGE)[1])
    tuning = f", and for which {rival.label} is tuned" if "tuned" in rival.controller else ""
    caption = (
        "Down and left is better: gentler and sooner. Along each line the time weight falls from left to right. "
        f"Each mark is one time weight, which the policy observes{tuning}. Faint lines are other seeds. The rule of "
        f"the paper, Tommasino et al. 2020, moves at {speed:g} m/s and brakes at the alarm."
    )
    if played.searched:
        caption += f" The {BOUND} knows the object; it has the first {played.searched['missed'].shape[1]} scenarios."
    name = f"figures/{matchup.name}_answer"
    return Picture(name, figure, alternative, caption, "Final speed of the object, V_p")
