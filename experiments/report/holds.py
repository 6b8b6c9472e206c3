"""Robustness: results with one changed argument of the environment, without a new training or tuning."""

from typing import Any, NamedTuple

import numpy as np
import polars as pl

from experiments.lab.parts import Heat, HeatMap, Table
from experiments.report.episodes import MISSED_TOO_OFTEN, Played
from experiments.report.matchups import PAPER, POLICY

Row = dict[str, Any]


class Failing(NamedTuple):
    """Changes under which a controller fails, see `where_it_fails`."""

    controller: str  # plain name with article
    worst: str  # the worst change in one line, or the statement that there is none
    details: str  # for each argument, the mildest change under which a rival costs less; the most misses, if over 1 %


def outcomes(played: Played, controller: str = POLICY) -> pl.DataFrame:
    """Return a row for each contestant under each change; `Matchup.policy` has the name POLICY.

    Columns: the means `V` (m/s, over the touched objects), `T` (s) and `loss` (cost, m/s); `missed`, the number of
    missed objects among `of` objects; `more` (m/s), the extra cost of `controller` over this contestant, or 0 if below
    two standard errors; `off`, the absolute difference of the changed value from the unchanged value, 0 if a value is
    not a number.
    """
    if played.varied.is_empty():
        numbers = dict.fromkeys(("value", "off", "missed", "of", "more"), float)
        return pl.DataFrame(schema={"factor": str, "setting": str, "contestant": str, "same": bool, **numbers})
    policy = pl.col("contestant").replace(played.matchup.chosen, POLICY)
    frame = played.varied.with_columns(policy)
    ours = frame.filter(contestant=controller).select("change", "episode", more=pl.col("cost"))
    more = pl.col("more") - pl.col("cost")
    clear = more.mean() > 2.0 * more.std() / more.len().sqrt()
    off = (pl.col("value") - pl.col("value").filter("same").first().over("factor")).abs().fill_nan(0.0).fill_null(0.0)
    by = ["change", "factor", "setting", "same", "value", "contestant"]
    return frame.join(ours, on=["change", "episode"], maintain_order="left").group_by(by, maintain_order=True).agg(
        V=pl.col("object_velocity").filter(~pl.col("missed")).mean().fill_null(np.nan), T=pl.mean("approach_time"),
        loss=pl.mean("cost"), missed=pl.sum("missed"), of=pl.len(),
        more=pl.when(clear).then(more.mean()).otherwise(0.0),
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


def rows(played: Played) -> list[dict[str, str]]:
    """Return the row of each change in the table of all set-ups, texts by heading."""
    names, found = {PAPER: "rule", played.matchup.rival.name: "main baseline", POLICY: "policy"}, []
    for (factor, setting), group in outcomes(played).group_by("factor", "setting", maintain_order=True):
        each = {row["contestant"]: row for row in group.to_dicts()}
        row = {"set-up, change": f"{played.matchup.name}, {factor}: {setting}"}
        row |= {heading: f"{each[name]['loss']:.3f}" for name, heading in names.items()}
        found.append(row | {"missed by the policy": f"{each[POLICY]['missed']} of {each[POLICY]['of']}"})
    return found
