"""Whether one policy that is told of the design judges springs as a search of each one's own controller does.

With each spring of the grid the policy is played at several time weights and read at the mean approach time of the
paper's rule. Then a search over springs alone, by what the policy does with them, picks one, and a controller is
searched for that, too.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from agents.baselines import PaperTrapezoid
from agents.design.limits import Limits
from agents.design.study import SEARCHED
from agents.design.told import best, environment, flown
from agents.evaluate import TUNING_SEED, Stage
from agents.jobs import Result, digest_of
from agents.policies import load_policy
from experiments.design_check.agreement import BUDGET, DAMPING, SEARCH, STIFFNESS, TEST, found
from experiments.lab.statistics import Resamples, along, estimate
from experiments.lab.tables import Gather, Row, result_of

POLICY = "linear-designs"
WEIGHTS = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)  # m/s per s
SAME = 0.02
"""Policy and search agree on a spring where their V_p differ by this share at the most."""


def tables(gather: Gather, grid: list[Row], quick: bool) -> dict[str, list[Row]]:
    """Return what the policy does with each spring of the grid, and what its own search picks."""
    depends = digest_of(*SEARCHED, "agents.design.told", "agents.policies", "experiments.design_check")
    springs = [{name: row[name] for name in ("stiffness", "damping_ratio")} for row in grid]
    asked = [{"budget": 400 if quick else BUDGET, "scenarios": 50 if quick else SEARCH["scenarios"]}]
    return {"told": gather("told", judged, springs, depends), "picked": gather("picked", picked, asked, depends)}


def judged(stiffness: float, damping_ratio: float) -> Result:
    """Return the row of one spring: V_p of the policy on the test set, as late as the paper's rule."""
    policy, count = load_policy(POLICY), len(WEIGHTS)
    time = Stage.of(*TEST, threads=1).play(PaperTrapezoid()).approach_time
    stage = Stage.of(*TEST, copies=count, threads=1, quiet=True, **environment(policy))
    design = {"coupling.stiffness": np.full(count, stiffness), "coupling.damping_ratio": np.full(count, damping_ratio)}
    seen = flown(policy, stage, design, np.array(WEIGHTS))
    resamples = Resamples(stage.count)
    curves = [
        resamples.means(values.reshape(1, count, -1)) for values in (seen.played.approach_time, seen.played.loss(0.0))
    ]
    velocity = estimate(along(*curves, resamples.means(time)))
    farthest = seen.travel.deflection.reshape(count, -1).max(axis=1)
    deflection = along(seen.time[None], farthest[None], np.array([time.mean()]))[0]
    row = {"stiffness": stiffness, "damping_ratio": damping_ratio, "deflection": deflection}
    return result_of([row | {"velocity": velocity.value, "low": velocity.low, "high": velocity.high}])


def picked(budget: int, scenarios: int) -> Result:
    """Return the row of the spring that the policy's search picks, with a controller searched for it."""
    time = float(Stage(TUNING_SEED, scenarios, scenario="train", threads=1).play(PaperTrapezoid()).approach_time.mean())
    free, middle = (STIFFNESS, DAMPING), {"coupling.stiffness": 80.0, "coupling.damping_ratio": 0.5}
    design = best(POLICY, [list(one) for one in free], middle, time, list(Limits()), scenarios, seed=1)["design"]
    return found(time, budget, design.tolist(), seed=1)


def said(tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Return what the page says of it."""
    ours, theirs = (np.array([row["velocity"] for row in tables[name]]) for name in ("told", "grid"))
    allowed = np.array([row["deflection"] for row in tables["told"]]) <= Limits().deflection
    return {
        "told": [
            {**row, "tuned": other, "ratio": row["velocity"] / other, "allowed": may}
            for row, other, may in zip(tables["told"], theirs.tolist(), allowed.tolist(), strict=True)
        ],
        "told_alike": int((np.abs(ours / theirs - 1.0) <= SAME).sum()),
        "told_rank": float(spearmanr(ours, theirs).statistic),
        "told_best": tables["told"][int(np.where(allowed, ours, np.inf).argmin())],
        "picked": tables["picked"][0],
        "same": SAME,
    }


def figure(tables: Mapping[str, list[Row]]) -> Figure:
    """Return V_p of the policy over that of each spring's own controller."""
    drawn = Figure(figsize=(6.6, 4.6))
    axes = drawn.subplots()
    ours, theirs = ([row["velocity"] for row in tables[name]] for name in ("told", "grid"))
    damping = [row["damping_ratio"] for row in tables["told"]]
    dots = axes.scatter(theirs, ours, c=damping, cmap="viridis", norm=LogNorm(), edgecolor="black", linewidth=0.5)
    for row, x, y in zip(tables["told"], theirs, ours, strict=True):
        axes.annotate(f"{row['stiffness']:.0f}", (x, y), xytext=(4, 3), textcoords="offset points", fontsize=7)
    axes.axline((theirs[0], theirs[0]), slope=1.0, color="#888888", linewidth=0.8)
    axes.set(xlabel="$V_p$ with a controller of its own (m/s)", ylabel="$V_p$ of the policy (m/s)")
    shown = drawn.colorbar(dots, label="damping ratio", ticks=np.unique(damping), format="%.2f")
    shown.minorticks_off()
    return drawn
