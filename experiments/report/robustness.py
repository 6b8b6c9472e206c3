"""Robustness: results with one changed argument of the environment, without a new training or tuning."""

from typing import Any

import numpy as np
import polars as pl

from experiments.report.comparisons import PAPER, POLICY
from experiments.report.episodes import MISSED_TOO_OFTEN, ComparisonResults

Row = dict[str, Any]


def outcomes(results: ComparisonResults, controller: str = POLICY) -> pl.DataFrame:
    """Return a row for each contestant under each change; `Comparison.policy` has the name POLICY.

    Columns: `loss`, the mean cost (m/s); `missed`, the number of missed objects among `of` objects; `more` (m/s), the
    extra cost of `controller` over this contestant, or 0 if below two standard errors; `off`, the absolute difference
    of the changed value from the unchanged value, 0 if a value is not a number.
    """
    if results.varied.is_empty():
        numbers = dict.fromkeys(("value", "off", "missed", "of", "more"), float)
        return pl.DataFrame(schema={"factor": str, "setting": str, "contestant": str, "same": bool, **numbers})
    frame = results.varied.with_columns(pl.col("contestant").replace(results.comparison.chosen, POLICY))
    ours = frame.filter(contestant=controller).select("change", "episode", more=pl.col("cost"))
    more = pl.col("more") - pl.col("cost")
    clear = more.mean() > 2.0 * more.std() / more.len().sqrt()
    off = (pl.col("value") - pl.col("value").filter("same").first().over("factor")).abs().fill_nan(0.0).fill_null(0.0)
    by = ["change", "factor", "setting", "same", "value", "contestant"]
    return frame.join(ours, on=["change", "episode"], maintain_order="left").group_by(by, maintain_order=True).agg(
        loss=pl.mean("cost"), missed=pl.sum("missed"), of=pl.len(),
        more=pl.when(clear).then(more.mean()).otherwise(0.0),
    ).with_columns(off=off)  # fmt: skip


def where_it_fails(results: ComparisonResults, name: str) -> tuple[str, str, str]:
    """Return where a contestant fails: its cost is above another's, or it misses over 1 % of objects.

    Returns its label with article; the worst change in one line, or that there is none; details: for each argument the
    mildest change under which a rival costs less, and the most misses, if over 1 %. Only rule, rival and policy play
    under changes; for any other `name`, the result is about the policy.
    """
    labels = {POLICY if each is results.comparison.policy else each.name: each.label
              for each in results.comparison.rivals}  # fmt: skip
    controller = name if name in labels else POLICY
    rows, called = outcomes(results, controller), f"the {labels.pop(controller)}"
    sentences, worse = list[str](), list[tuple[Row, str]]()
    for rival, label in labels.items():
        changed = rows.filter(~pl.col("same"), contestant=rival).with_columns(settings=pl.len().over("factor"))
        losing = changed.filter(pl.col("more") > 0.0).sort("off", maintain_order=True)
        mildest = losing.group_by("factor", maintain_order=True).agg(pl.all().first(), most=pl.max("more"))
        found = mildest.sort("most", descending=True).to_dicts()
        if found:
            named = (row["factor"] + (f" ({row['setting']})" if row["settings"] > 1 else "") for row in found)
            sentences.append(f"Worse than the {label} with {', '.join(named)}.")
        worse += [(row, f"it is worse than the {label}") for row in found]
    ours = rows.filter(contestant=controller).to_dicts()
    missed = max(ours, key=lambda row: row["missed"] / row["of"], default={"missed": 0, "of": 1})
    shown = worse[:1]
    if missed["missed"] > MISSED_TOO_OFTEN * missed["of"]:
        misses = f"misses {missed['missed']} of {missed['of']} objects"
        sentences.append(f"It {misses} with {missed['factor']} at {missed['setting']}.")
        alike = [(row, words) for row, words in worse if row["factor"] == missed["factor"]]
        shown = [*alike[:1], (missed, f"it {misses}")]
    if not shown:
        tried = sum(not row["same"] for row in ours)
        return called, f"it is not worse than its rivals under any of {tried} single changes.", ""
    places = ((f"at {row['setting']}" if np.isfinite(row["value"]) else "there", words) for row, words in shown)
    line = ", ".join(f"{place} {words}" for place, words in places)
    return called, f"{shown[0][0]['factor']}. {line[0].upper()}{line[1:]}.", " ".join(sentences)


def rows(results: ComparisonResults) -> list[dict[str, str]]:
    """Return a row for each change with the mean costs (m/s) of the rivals, texts by heading."""
    names, found = {"rule": PAPER, "main baseline": results.comparison.rival.name, "policy": POLICY}, []
    for (factor, setting), group in outcomes(results).group_by("factor", "setting", maintain_order=True):
        each = {row["contestant"]: row for row in group.to_dicts()}
        row = {"set-up, change": f"{results.comparison.name}, {factor}: {setting}"}
        row |= {heading: f"{each[name]['loss']:.3f}" for heading, name in names.items()}
        found.append(row | {"missed by the policy": f"{each[POLICY]['missed']} of {each[POLICY]['of']}"})
    return found
