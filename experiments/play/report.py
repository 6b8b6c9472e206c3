"""What a study found: each person's difference, a mixed model, and how many persons it takes; scripted persons."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure
from scipy import stats
from statsmodels.regression.mixed_linear_model import MixedLM
from statsmodels.stats.power import TTestPower

from experiments.lab import experiment
from experiments.lab.charts import OBJECT, TOOL
from experiments.lab.results import noted
from experiments.play import tries
from experiments.play.live import Live
from experiments.play.plan import Plan, Study
from impact_gym.files import whole_file

COLUMNS = ("person", "number", "block", "condition", "slide", "done_time", "object_velocity", "missed", "counts")
TRAITS = {"place_error": 0.02, "creep": 0.1, "reaction": 0.25}
"""A scripted person: m, how much each believes the object too far or too near; m/s; s."""
FEWEST, MOST_PERSONS = 3, 10_000


@dataclass(frozen=True)
class Finding:
    """The second condition against the first: how much farther the object slides, at equal done_time."""

    persons: int
    difference: float  # m
    low: float  # m, of its interval
    high: float
    p: float
    spread: float  # m, standard deviation of the persons' differences
    needed: int | None  # persons


def table_of(folder: Path) -> pl.DataFrame:
    """Return a row for each try of a study."""
    rows = [{**this.study, **this.result, "counts": this.counts and not this.result["missed"]}
            for _, this in tries.folder_of(folder)]  # fmt: skip
    rows = [{name: row[name] for name in COLUMNS} for row in rows]
    return pl.DataFrame(rows, schema=None if rows else list(COLUMNS), infer_schema_length=None)


def analysed(rows: pl.DataFrame, plan: Plan) -> pl.DataFrame:
    """Return the tries that count: those of blocks, of persons who have both conditions."""
    rows = rows.filter(pl.col("counts") & (pl.col("block") > 0)) if len(rows) else rows
    both = rows.group_by("person").agg(pl.col("condition").n_unique()) if len(rows) else None
    return (
        rows
        if both is None
        else rows.filter(pl.col("person").is_in(both.filter(pl.col("condition") == 2)["person"].implode()))
    )


def found(rows: pl.DataFrame, plan: Plan) -> Finding | None:
    """Return what the analysed rows say; None before FEWEST persons have played both conditions.

    A mixed model, with a level of each person's own in each condition, gives how slide (cm in it) goes with done_time;
    each person's difference between the conditions is taken at equal done_time by that. These are held against their
    own spread, by t with persons - 1 degrees of freedom. A model with levels and effects of persons as two variances
    did not converge in a fifth of the studies of `calibration`, and its errors were too large.
    """
    persons = rows["person"].unique(maintain_order=True).to_list() if len(rows) else []
    if len(persons) < FEWEST:
        return None
    second, person = (rows["condition"] == [*plan.conditions][1]).to_numpy(), rows["person"].to_numpy()
    slide, late = 100.0 * rows["slide"].to_numpy(), rows["done_time"].to_numpy()
    late = late - late.mean()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a variance of nought is a result, too
        cell = 2 * np.searchsorted(np.unique(person), person) + second
        fit = MixedLM(slide, np.column_stack([np.ones(len(slide)), second, late]), cell).fit(reml=True, method="powell")
    level = slide - float(fit.fe_params[2]) * late
    means = np.array([[level[(person == who) & (second == side)].mean() for side in (False, True)] for who in persons])
    lines = 0.01 * (means[:, 1] - means[:, 0])  # m
    interval = stats.ttest_1samp(lines, 0.0).confidence_interval(1.0 - plan.alpha)
    spread, p = float(np.std(lines, ddof=1)), float(stats.ttest_1samp(lines, 0.0).pvalue)
    return Finding(
        len(lines), float(lines.mean()), float(interval.low), float(interval.high), p, spread, needed(spread, plan)
    )


def needed(spread: float, plan: Plan) -> int | None:
    """Return how many persons it takes to find the smallest difference with the plan's power, by their spread (m)."""
    if not spread > 0.0:
        return 2
    size, count = plan.smallest / spread, 2
    while TTestPower().power(size, count, plan.alpha) < plan.power:
        count += max(count // 50, 1)
        if count > MOST_PERSONS:
            return None
    return count


def standing(plan: Plan, folder: Path) -> str:
    """Return in one line where a study stands, and how many persons it takes."""
    rows = table_of(folder)
    finding = found(analysed(rows, plan), plan)
    if finding is None:
        persons = rows["person"].n_unique() if len(rows) else 0
        return f"{plan.title}: pilot, {persons} persons so far; how many are needed is computed from {FEWEST} on"
    wanted = "more persons than can be had" if finding.needed is None else f"{finding.needed} persons needed"
    state = "pilot" if is_pilot(finding) else "complete"
    return f"{plan.title}: {state}, {wanted} by the spread of {finding.persons}, {100 * finding.spread:.2g} cm"


def is_pilot(finding: Finding | None) -> bool:
    """Whether fewer have played than are needed."""
    return finding is None or finding.needed is None or finding.persons < finding.needed


def play_scripted(study: Study, folder: Path, count: int) -> None:
    """Let so many scripted persons take the place of persons, each with traits of its own, and keep their tries."""
    for _ in range(count):
        study.agree()
        person = study.person or 0
        traits = traits_of(np.random.default_rng((study.plan.seed, 2, person)))
        for number in range(study.done[person], study.length):
            asked = study.asked_of(person, number)
            live = Live(type(asked)(**vars(asked) | {"operator": {"type": "Reach", **traits}}))
            while not live.ended:
                live.step()
            tries.write(folder / f"{person:06d}-{number:04d}.json", live.finished())
            study.enter(asked.study)


def traits_of(rng: np.random.Generator) -> dict[str, float]:
    """Return who a scripted person is: numbers of a `Reach`."""
    traits = {name: value * float(rng.lognormal(sigma=0.2)) for name, value in TRAITS.items()}
    return traits | {"place_error": traits["place_error"] * float(rng.choice([-1.0, 1.0]))}


def chart(rows: pl.DataFrame, plan: Plan) -> Figure:
    """Return each person's line from the first condition to the second, and the mean."""
    figure = Figure(figsize=(5.0, 3.6))
    axes, names = figure.subplots(), [*plan.conditions]
    means = rows.group_by("person", "condition").agg(pl.col("slide").mean()) if len(rows) else rows
    for person in means["person"].unique().sort().to_list() if len(means) else []:
        mine = dict(means.filter(pl.col("person") == person).select("condition", "slide").iter_rows())
        axes.plot([0, 1], [100 * mine[name] for name in names], "o-", color=TOOL, alpha=0.45)
    if len(means):
        whole = dict(means.group_by("condition").agg(pl.col("slide").mean()).iter_rows())
        axes.plot([0, 1], [100 * whole[name] for name in names], "s-", color=OBJECT, linewidth=3.0, label="mean")
        axes.legend()
    axes.set(xticks=[0, 1], xticklabels=names, ylabel="object slides (cm), a line for each person", xlim=(-0.3, 1.3))
    return figure


def write(plan: Plan, folder: Path) -> Path:
    """Write what was found beside the tries: tries.parquet, tables, each person's line, and a page; return its path."""
    rows = table_of(folder)
    out = folder / "report"
    with noted(out, f"impact-gym play --plan {plan.title!r} --report", ("statsmodels", "polars"), again=False) as runs:
        with whole_file(out / "tries.parquet") as file:
            rows.write_parquet(file)
        counted = analysed(rows, plan)
        finding = found(counted, plan)
    content: dict[str, Any] = {
        "plan": plan, "finding": finding, "pilot": is_pilot(finding), "standing": standing(plan, folder),
        "tries": len(rows), "counted": len(counted), "names": [*plan.conditions],
    }  # fmt: skip
    return experiment.write("play", out, {"tries": rows.to_dicts()}, {"lines": chart(counted, plan)}, content, runs)
