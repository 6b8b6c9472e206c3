"""The chart of approach time against V_p; contestants differ in dash or marker as well as in colour."""

from matplotlib.figure import Figure

from experiments.lab.charts import OTHERS, SERIES
from experiments.lab.parts import Picture
from experiments.report.matchups import BOUND, PAPER, POLICY
from experiments.report.played import Played
from impact_gym.task.task import VELOCITY_RANGE

LOOKS = (("-", "X"), ("-", "o"), ("--", "s"), (":", "D"), ("-.", "^"), ((0, (8, 2, 1, 2)), "v"), ((0, (1, 3)), ">"))
"""Line and marker of each contestant: first the paper's rule, then the policy, then the others."""


def trade_off(played: Played, first_screen: bool = False) -> Picture:
    """Return the chart with all seeds and baselines; on the first screen with rule, median seed and rival only."""
    matchup = played.matchup
    names = (PAPER, matchup.rival.name) if first_screen else played.baselines
    labels = {each.name: each.plain if first_screen else each.label for each in matchup.baselines}
    bound = None if first_screen else played.bound
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
    axes.set(xlabel=f"mean time until {matchup.until} (s)", ylabel="mean V_p (m/s)", ylim=(0.0, None))
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
        heading = f"Time until {matchup.until} against V_p, all contestants and seeds"
        caption = (
            "Down and left is better. Each line joins the time weights of one contestant; faint lines are other seeds."
        )
        caption += "" if bound is None else (
            f" The {BOUND} knows the object: it is the best approach that a search found for each of the first "
            f"{bound['missed'].shape[1]} scenarios."
        )  # fmt: skip
    name = f"figures/{matchup.name}_{'answer' if first_screen else 'trade_off'}"
    return Picture(name, figure, alternative, caption, heading)
