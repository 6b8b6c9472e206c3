"""Ten seeds of the joint search over a spring and its controller, beside a grid of springs, each with its own search.

All searches look at the same scenarios; what they found is then played on the test set. The controller of each spring
of the grid is searched with as many candidates as the joint search has for both.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from agents.baselines import PaperTrapezoid
from agents.design.free import Free, designed
from agents.design.limits import Limits
from agents.design.search import play_one, search_one
from agents.design.study import SEARCHED, start_of
from agents.evaluate import TUNING_SEED, Stage
from agents.jobs import Result, digest_of
from experiments.lab.charts import OBJECT, TOOL
from experiments.lab.statistics import Resamples, estimate
from experiments.lab.tables import Gather, Row, result_of

STIFFNESS, DAMPING = Free("coupling.stiffness", 40.0, 200.0), Free("coupling.damping_ratio", 0.1, 1.0)
SEARCH = {
    "rule": "BlindProfile",
    "limits": list(Limits()),
    "pad": "",
    "tolerance": 0.0,
    "scenarios": 200,
    "population": 16,
}
BUDGET, SEEDS, POINTS = 4000, 10, (5, 4)
TEST = ["test", 2000]
SLOPE = 1.4
"""m/s per s, by which V_p falls with the approach time near the paper's (the front of the search): small differences in
approach time between what seeds find are read at one and the same time by it."""


def tables(gather: Gather, quick: bool) -> dict[str, list[Row]]:
    """Return a row for each seed and for each spring of the grid."""
    time = float(
        Stage(TUNING_SEED, SEARCH["scenarios"], scenario="train", threads=1).play(PaperTrapezoid()).approach_time.mean()
    )
    budget, seeds, points = (400, 3, (2, 2)) if quick else (BUDGET, SEEDS, POINTS)
    common = {"approach_time": time, "budget": budget}
    joint = [{**common, "springs": [], "seed": seed} for seed in range(1, seeds + 1)]
    grid = [
        {**common, "springs": [float(stiffness), float(damping)], "seed": 1}
        for stiffness in np.geomspace(STIFFNESS.low, STIFFNESS.high, points[0])
        for damping in np.geomspace(DAMPING.low, DAMPING.high, points[1])
    ]
    depends = digest_of(*SEARCHED, __name__)
    return {name: gather(name, found, asked, depends) for name, asked in {"seeds": joint, "grid": grid}.items()}


def found(approach_time: float, budget: int, springs: list[float], seed: int) -> Result:
    """Return the row of what one search finds, for a free spring or for the one that is given."""
    free, names = ((STIFFNESS, DAMPING), ()) if not springs else ((), (STIFFNESS.name, DAMPING.name))
    ranges = {one.name: [one.low, one.high] for one in free}
    environment = designed({}, ranges | dict(zip(names, springs, strict=True)))
    start = start_of("BlindProfile", {}, approach_time)
    result = search_one(
        environment, [list(one) for one in free], [80.0, 0.5][: len(free)], rule_start=start, journal="",
        approach_time=approach_time, budget=budget, seed=seed, **SEARCH,
    )  # fmt: skip
    design = dict(zip([one.name for one in free], result["design"].tolist(), strict=True))
    played = play_one(environment, design, "BlindProfile", result["parameters"].tolist(), "", 0.0, TEST)
    stiffness, damping = springs or design.values()
    at_one_time = played["object_velocity"] + SLOPE * (played["approach_time"] - _papers_time())
    velocity = estimate(Resamples(len(at_one_time)).means(at_one_time))
    return result_of([{
        "seed": seed, "stiffness": stiffness, "damping_ratio": damping, "train": result["loss"].item(),
        "generations": result["generations"].item(), "velocity": velocity.value, "low": velocity.low,
        "high": velocity.high, "time": played["approach_time"].mean(), "deflection": played["deflection"].max(),
    }])  # fmt: skip


def _papers_time() -> float:
    """Return the mean approach time of the paper's rule on the test set, s."""
    return float(Stage.of(TEST[0], TEST[1], threads=1).play(PaperTrapezoid()).approach_time.mean())


def said(tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Return what the page says of it."""
    seeds, grid = tables["seeds"], tables["grid"]
    best = min(grid, key=lambda row: row["train"])
    within = sum(row["low"] <= best["velocity"] <= row["high"] for row in seeds)
    spread = [row["velocity"] for row in seeds]
    return {"seeds": seeds, "grid": grid, "best": best, "within": within, "spread": max(spread) - min(spread)}


def figure(tables: Mapping[str, list[Row]]) -> Figure:
    """Return the grid as a map of V_p, and where the seeds ended."""
    grid, seeds = tables["grid"], tables["seeds"]
    drawn = Figure(figsize=(7.6, 4.4))
    axes = drawn.subplots()
    columns = [[row[name] for row in grid] for name in ("stiffness", "damping_ratio", "train")]
    levels = axes.tricontourf(np.log(columns[0]), np.log(columns[1]), columns[2], levels=12, cmap="viridis_r")
    axes.plot(np.log(columns[0]), np.log(columns[1]), ".", color="white", label="grid, a search of its controller each")
    ends = [[np.log(row[name]) for row in seeds] for name in ("stiffness", "damping_ratio")]
    axes.plot(*ends, "o", color=OBJECT, markeredgecolor="black", label="joint search, a seed each")
    for ticks, values in ((axes.set_xticks, np.unique(columns[0])), (axes.set_yticks, np.unique(columns[1]))):
        ticks(np.log(values), [f"{value:.3g}" for value in values])
    axes.set(xlabel="stiffness (N/m)", ylabel="damping ratio")
    axes.grid(color=TOOL, alpha=0.1)
    axes.legend(loc="upper right", fontsize=8, frameon=True)
    drawn.colorbar(levels, label="V_p where searched (m/s)")
    return drawn
