"""Does it hold, and is it the simulator? Tables of the changed environments and of the other solvers."""

from collections.abc import Mapping
from itertools import chain, groupby

import numpy as np

from agents.setups.evaluation import Change
from experiments.lab.statistics import Floats
from experiments.report.matchups import PAPER, POLICY
from experiments.report.played import Arrays, Played, Run
from experiments.report.results import EXACT
from experiments.report.tables import Table
from impact_gym.quantities import QUANTITIES
from impact_gym.task import Task

WORDS = {
    "force_noise": "noise of the force sensor",
    "range_noise": "error of the distance estimate",
    "robot": "robot that gives",
    "scenario": "objects beyond the training",
}
"""Changed arguments in plain words, where the quantity has none that a layman reads."""
SHOWN = {"s": ("ms", 1e3), "m": ("mm", 1e3), "%": ("%", 100.0)}  # units and scales, where they are others than given
STROKE = 0.02  # m, of a spring whose way ends
Varied = list[tuple[Change, dict[str, Run]]]
"""Changes with the runs of all contestants."""


def varied(played: Played) -> list[Varied]:
    """Return the changes with their runs, a list for each argument."""
    runs: dict[tuple[str, str], dict[str, Run]] = {}
    for (argument, label, contestant), run in played.varied.items():
        name = POLICY if contestant == played.matchup.chosen else contestant
        runs.setdefault((argument, label), {})[name] = run
    pairs = [(change, runs[change.argument, change.label]) for change in played.matchup.changes]
    return [list(changes) for _, changes in groupby(pairs, lambda changed: changed[0].argument)]


def factor(argument: str) -> str:
    """Return an argument of the environment in plain words."""
    return WORDS.get(argument) or (QUANTITIES[argument].words if argument in QUANTITIES else argument)


def setting(change: Change) -> str:
    """Return the changed value with its unit, or its label."""
    if not np.isfinite(change.value):
        return change.label
    unit = "%" if change.multiple else QUANTITIES[change.argument].unit
    name, scale = SHOWN.get(unit, (unit, 1.0))
    return f"{scale * change.value:g} {name}"


def changes_table(played: Played) -> Table:
    """Return loss, V_p, T and misses of each contestant under each change, one at a time."""
    weight, labels, body = played.matchup.typical, played.matchup.labels, []
    for change, runs in chain.from_iterable(varied(played)):
        for name, run in runs.items():
            mean = run.means(weight)
            changed = (factor(change.argument), setting(change), labels.get(name, name))
            body.append((*changed, f"{mean['loss']:.4f}", f"{mean['V']:.4f}", f"{mean['T']:.4f}",
                         f"{mean['missed']} of {run['missed'].shape[1]}"))  # fmt: skip
    head = ("changed", "to", "contestant", f"V_p + {weight:g} T (m/s)", "V_p (m/s)", "T (s)", "missed")
    return Table("One thing changed at a time; hard scenarios lie beyond the training ranges, lighter, stiffer, less "
                 "elastic, nearer", head, body)  # fmt: skip


def travel_table(played: Played) -> list[Table]:
    """Return how far each contestant lets a tool on a spring get from its place on the flange; nothing without one."""
    body, labels, end = [], played.matchup.labels, 1e3 * STROKE
    for name, run in played.travelled.items():
        before, after = (1e3 * run[key] for key in ("before", "in_all"))
        shares = [np.mean(values > end) for values in (before, after)]
        name = POLICY if name == played.matchup.chosen else name
        way = (f"{np.quantile(before, share):.0f}" for share in (0.5, 0.95, 1.0))
        body.append((labels.get(name, name), *way, f"{after.max():.0f}", *(f"{100 * share:.0f}" for share in shares)))
    if not body:
        return []
    task = Task(**played.matchup.environment)
    most, rest = task.acceleration_range[1], task.tool_mass / task.coupling.stiffness
    caption = (
        f"How far the tool gets from its place on the flange. At {most:g} m/s^2 it hangs {1e3 * most * rest:.0f} mm "
        f"behind, so a stop after {end:g} mm is met wherever more than {STROKE / rest:.3g} m/s^2 are kept up; "
        "the rest of the way is the blow and the retreat"
    )
    head = ("contestant", "before the touch, median (mm)", "95 % (mm)", "most (mm)", "in all, most (mm)",
            f"beyond {end:g} mm before the touch (%)", "in all (%)")  # fmt: skip
    return [Table(caption, head, body)]


def simulator(played: Played) -> Table:
    """Return how much other solvers and laws change V_p and the gain."""
    weight, chosen, rival = played.matchup.typical, played.matchup.chosen, played.matchup.rival.name
    rival_label = played.matchup.rival.label
    gains = [(run.loss(weight) - played.policy.loss(weight)).mean() for run in (played.paper, played.rival)]
    body = []

    def add(label: str, contestants: str, velocities: list[Floats], losses: Mapping[str, Floats]) -> None:
        """Add a row of changes (scenarios,), m/s: of V_p, and of the losses by contestant."""
        mean = max(abs(change.mean()) for change in velocities)
        largest = max(np.abs(change).max() for change in velocities)
        means = {name: loss.mean() for name, loss in losses.items()}
        gain_changes = (f"{means[name] - means[chosen]:+.2g}" if name in means else "-" for name in (PAPER, rival))
        body.append((label, f"{contestants}, {velocities[0].size}", f"{mean:.2g}", f"{largest:.2g}", *gain_changes))

    as_it_is = {**played.baselines, **played.seeds}
    for change in EXACT:
        pairs = {}
        for name in {*played.seeds, rival, PAPER}:
            after = played.exactly[change, name].at(weight)
            pairs[name] = as_it_is[name].at(weight).first(after.missed.size), after
        velocities = [pairs[name][1].object_velocity - pairs[name][0].object_velocity for name in played.seeds]
        losses = {name: after.loss(weight) - before.loss(weight) for name, (before, after) in pairs.items()}
        add(change, f"{len(velocities)} seeds", velocities, losses)
    if (scipy := played.scipy.get(chosen)) is not None:
        cost = played.paper.missed_cost
        losses = {name: _scipy_loss(arrays, weight, cost) for name, arrays in played.scipy.items()}
        add("SciPy's solver", chosen, [scipy["object_velocity"] - scipy["our_object_velocity"]], losses)
    else:
        body.append(("SciPy's solver", "not played: it takes neither drawn ranges nor noise", "", "", "", ""))
    head = ("changed", "played", "largest mean change of V_p (m/s)", "in any scenario (m/s)",
            "change of the gain over the rule (m/s)", f"over {rival_label} (m/s)")  # fmt: skip
    caption = (f"The gain in V_p + w T at w = {weight:g} is {gains[0]:.4f} m/s over the paper's rule and "
               f"{gains[1]:.4f} m/s over {rival_label}; what follows is by how much that changes.")  # fmt: skip
    return Table(caption, head, body)


def _scipy_loss(arrays: Arrays, weight: float, missed_cost: float) -> Floats:
    """Change of V_p + w T and of what misses cost (scenarios,), m/s."""
    names = ("object_velocity", "approach_time", "missed")
    change = {name: arrays[name].astype(float) - arrays[f"our_{name}"] for name in names}
    return change["object_velocity"] + weight * change["approach_time"] + missed_cost * change["missed"]
