"""Robustness: results with one changed argument of the environment, without a new training or tuning."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from agents.setups.evaluation import Change, variants
from experiments.lab import grid
from experiments.lab.parts import Heat, HeatMap, Table
from experiments.lab.study import Cell, frame_of
from experiments.report.matchups import PAPER, POLICY, Matchup
from experiments.report.played import MISSED_TOO_OFTEN, Played
from impact_gym.quantities import QUANTITIES
from impact_gym.task import evaluation_sets

WORDS = {  # plain names of some arguments; `factor` names all arguments
    "force_noise": "noise of the force sensor",
    "range_noise": "error of the distance estimate",
    "robot": "compliant robot",
    "scenario": "objects outside the training ranges",
}
SHOWN = {"s": ("ms", 1e3), "m": ("mm", 1e3), "%": ("%", 100.0)}  # for some units: the printed unit, and the factor
Row = dict[str, Any]


class Failing(NamedTuple):
    """Changes under which a controller fails, see `where_it_fails`."""

    controller: str  # plain name with article
    worst: str  # the worst change in one line, or the statement that there is none
    details: str  # for each argument, the mildest change under which a rival costs less; the most misses, if over 1 %


def cells(matchup: Matchup, scenarios: Mapping[str, Any]) -> Iterator[Cell]:
    """Yield a cell (a job) for each change and each of `Matchup.rivals`, at the typical time weight."""
    for change in variants(matchup.evaluation, matchup.environment):
        played = scenarios
        if change.scenarios:
            there = evaluation_sets.load(change.scenarios).count
            played = {"set": change.scenarios, "count": min(scenarios["count"], there)}
        nominal = {**matchup.environment, **matchup.evaluation.nominal}
        environment = nominal if change.same else change.environment
        labels = {
            "change": f"{factor(change.argument)}: {setting(change)}",
            "factor": factor(change.argument, environment.get("alarm") == "reading"), "setting": setting(change),
            "same": change.same, "value": change.value,
        }  # fmt: skip
        for each in matchup.rivals:
            about = {**labels, "contestant": each.name}
            yield grid.cell(about, each.controller, environment, played, [matchup.typical])


def factor(argument: str, by_reading: bool = False) -> str:
    """Return the plain name of an argument; `by_reading`: whether readings of the force sensor raise the alarm."""
    words = WORDS.get(argument) or (QUANTITIES[argument].words if argument in QUANTITIES else argument)
    alarm = "which raises the alarm" if by_reading else "the alarm is a switch without noise"
    return f"{words} ({alarm})" if argument == "force_noise" else words


def setting(change: Change) -> str:
    """Return the changed value with its unit; if the value is not a number, the change's label."""
    if not np.isfinite(change.value):
        return change.label
    unit = "%" if change.multiple else QUANTITIES[change.argument].unit
    name, scale = SHOWN.get(unit, (unit, 1.0))
    return f"{scale * change.value:g} {name}"


def outcomes(played: Played, controller: str = POLICY) -> pl.DataFrame:
    """Return a row for each contestant under each change; `Matchup.policy` has the name POLICY.

    Columns: the means `V` (m/s), `T` (s) and `loss` (cost, m/s); `missed`, the number of missed objects among `of`
    objects; `more` (m/s), the extra cost of `controller` over this contestant, or 0 if below two standard errors;
    `off`, the absolute difference of the changed value from the unchanged value, 0 if a value is not a number.
    """
    if not played.varied:
        numbers = dict.fromkeys(("value", "off", "missed", "of", "more"), float)
        return pl.DataFrame(schema={"factor": str, "setting": str, "contestant": str, "same": bool, **numbers})
    policy = pl.col("contestant").replace(played.matchup.chosen, POLICY)
    frame = frame_of(played.varied).with_columns(policy)
    ours = frame.filter(contestant=controller).select("change", "episode", more=pl.col("cost"))
    more = pl.col("more") - pl.col("cost")
    clear = more.mean() > 2.0 * more.std() / more.len().sqrt()
    off = (pl.col("value") - pl.col("value").filter("same").first().over("factor")).abs().fill_nan(0.0).fill_null(0.0)
    by = ["change", "factor", "setting", "same", "value", "contestant"]
    return frame.join(ours, on=["change", "episode"], maintain_order="left").group_by(by, maintain_order=True).agg(
        loss=pl.mean("cost"), V=pl.mean("object_velocity"), T=pl.mean("approach_time"), missed=pl.sum("missed"),
        of=pl.len(), more=pl.when(clear).then(more.mean()).otherwise(0.0),
    ).with_columns(off=off)  # fmt: skip


def where_it_fails(played: Played, name: str) -> Failing:
    """Return where a contestant fails: its cost is above another's, or it misses over 1 % of objects.

    Only rule, rival and policy play under changes; for any other `name`, the result is about the policy.
    """
    rival, shown = played.matchup.rival, {each.name for each in played.matchup.rivals}
    controller = POLICY if name == played.matchup.chosen or name not in shown else name
    rows, others = outcomes(played, controller), {PAPER: PAPER, rival.name: rival.plain, POLICY: POLICY}
    called = f"the {others.pop(controller).removeprefix('the ')}"
    sentences, worse = list[str](), list[tuple[Row, str]]()
    for name, plain in others.items():
        changed = rows.filter(~pl.col("same"), contestant=name).with_columns(settings=pl.len().over("factor"))
        losing = changed.filter(pl.col("more") > 0.0).sort("off", maintain_order=True)
        mildest = losing.group_by("factor", maintain_order=True).agg(pl.all().first(), most=pl.max("more"))
        found = mildest.sort("most", descending=True).to_dicts()
        if found:
            named = (row["factor"] + (f" ({row['setting']})" if row["settings"] > 1 else "") for row in found)
            sentences.append(f"Worse than the {plain} with {', '.join(named)}.")
        worse += [(row, plain) for row in found]
    ours = rows.filter(contestant=controller).to_dicts()
    missed = max(ours, key=lambda row: row["missed"] / row["of"], default={"missed": 0, "of": 1})
    many = missed["missed"] > MISSED_TOO_OFTEN * missed["of"]
    if many:
        misses = f"{missed['missed']} of {missed['of']} objects"
        sentences.append(f"It misses {misses} with {missed['factor']} at {missed['setting']}.")
    if not sentences:
        tried = sum(not row["same"] for row in ours)
        return Failing(called, f"it is not worse than its rivals under any of {tried} single changes.", "")
    place = missed["factor"] if many else worse[0][0]["factor"]
    clauses = [(row, f"it is worse than the {plain}") for row, plain in worse if row["factor"] == place][:1]
    clauses += [(missed, f"it misses {misses}")] if many else []
    placed = [(f"at {row['setting']}" if np.isfinite(row["value"]) else "there", words) for row, words in clauses]
    line = ", ".join(f"{where} {words}" for where, words in placed)
    return Failing(called, f"{place}. {line[0].upper()}{line[1:]}.", " ".join(sentences))


def heat_map(played: Played) -> HeatMap:
    """Return the heat map: for each argument and contestant, the highest cost over the argument's values."""
    weight, frame, rival = played.matchup.typical, outcomes(played), played.matchup.rival
    contestants = {PAPER: PAPER, rival.name: rival.label, POLICY: POLICY}
    usual = {row["contestant"]: row for row in frame.filter("same").unique("contestant", keep="first").to_dicts()}
    for name, run in {PAPER: played.paper, rival.name: played.rival, POLICY: played.policy}.items():
        means = {**run.means(weight), "loss": float(run.loss(weight).mean()), "of": played.count}
        usual.setdefault(name, means)  # if no cell was played without a change
    measure = usual[PAPER]["loss"]

    def cell(mean: Row, note: str) -> Heat:
        missed = f"{mean['missed']} of {mean['of']} missed" if mean["missed"] else ""
        return Heat(f"{mean['loss']:.2f}", ", ".join(filter(None, (note, missed))), mean["loss"] / measure)

    rows = [("nothing", "as trained and tuned", [cell(usual[name], "") for name in contestants])]
    for (place,), group in frame.group_by("factor", maintain_order=True):
        tried = group.filter(~pl.col("same"))["setting"].unique(maintain_order=True).to_list()
        if not tried:
            continue
        worst = [max(group.filter(contestant=name).to_dicts(), key=lambda row: row["loss"]) for name in contestants]
        heats = [cell(row, "unchanged" if row["same"] else row["setting"] if len(tried) > 1 else "") for row in worst]
        rows.append((place, f"{len(tried)} tried: {tried[0]} to {tried[-1]}" if len(tried) > 1 else tried[0], heats))
    caption = (
        f"Mean V_p + {weight:g} T (m/s) with one thing changed; lower is better. A cell has the highest cost of all "
        f"values, and this value. Blue is below, orange above the paper's rule without changes, {measure:.2f} m/s."
    )
    return HeatMap(caption, ("what is changed", *contestants.values()), rows)


def table(played: Played) -> Table:
    """Return the table of cost, V_p, T and misses of each contestant under each change."""
    labels = pl.col("contestant").replace(played.matchup.labels)
    columns = {
        "changed": "{factor}", "to": "{setting}", "contestant": "{contestant}",
        f"V_p + {played.matchup.typical:g} T (m/s)": "{loss:.4f}",
        "V_p (m/s)": "{V:.4f}", "T (s)": "{T:.4f}", "missed": "{missed} of {of}",
    }  # fmt: skip
    caption = (
        "One thing is changed at a time; policy and baselines are not trained or tuned again. A stiffer coupling keeps "
        "its damping ratio. Hard scenarios are outside the training ranges: lighter, stiffer, less elastic, nearer"
    )
    return Table.of(caption, outcomes(played).with_columns(labels), columns)
