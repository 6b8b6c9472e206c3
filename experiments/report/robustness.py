"""Robustness: results with one changed argument of the environment, without a new training or tuning."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from experiments.report.comparisons import PAPER, POLICY
from experiments.report.episodes import MISSED_TOO_OFTEN, SIDES, ComparisonResults
from experiments.report.limits import LIMITED, Limits, quantile

Row = dict[str, Any]
PLACE = tuple(f"objects {word} than" for word in SIDES["distance"])  # begins of the names of changed places


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
    """Return where a contestant fails: cost above another's, with limits a limit not kept, or over 1 % missed.

    Returns its label with article; the worst change in one line, after it a place outside the set-up's range, or that
    no change tried is one; details: each argument with its mildest failure, and all that was tried. Only
    `Comparison.rivals` play under changes; for any other `name`, the result is about the policy.
    """
    comparison = results.comparison
    labels = {POLICY if each is comparison.policy else each.name: comparison.words[each.name]
              for each in comparison.rivals}  # fmt: skip
    name = POLICY if name == comparison.chosen else name
    controller = name if name in labels else POLICY
    every, called = outcomes(results, controller), f"the {labels.pop(controller)}"
    ours = every.filter(contestant=controller)
    sentences, worse = list[str](), [*_above_limits(results, controller, ours)]
    for rival, label in labels.items() if not comparison.limited else ():
        changed = every.filter(~pl.col("same"), contestant=rival).with_columns(settings=pl.len().over("factor"))
        losing = changed.filter(pl.col("more") > 0.0).sort("off", maintain_order=True)
        mildest = losing.group_by("factor", maintain_order=True).agg(pl.all().first(), most=pl.max("more"))
        found = mildest.sort("most", descending=True).to_dicts()
        if found:
            named = (row["factor"] + (f" ({row['setting']})" if row["settings"] > 1 else "") for row in found)
            sentences.append(f"Worse than the {label} with {', '.join(named)}.")
        worse += [(row, f"it costs {row['more']:.2g} m/s more than the {label}") for row in found]
    worse.sort(key=lambda pair: -pair[0]["most"])
    share = pl.col("missed") / pl.col("of")
    most = ours.filter(share > MISSED_TOO_OFTEN).sort(share, descending=True, maintain_order=True)
    missing = most.group_by("factor", maintain_order=True).agg(pl.all().first()).to_dicts()
    missed = [(row, f"it misses {row['missed']} of {row['of']} objects") for row in missing]
    limited = worse if comparison.limited else []
    sentences += [f"{words[0].upper()}{words[1:]} with {row['factor']} at {row['setting']}."
                  for row, words in (*limited, *missed)]  # fmt: skip
    tried = ours.filter(~pl.col("same")).group_by("factor", maintain_order=True).agg("setting").rows()
    names = "; ".join(f"{factor}: {', '.join(settings)}" for factor, settings in tried)
    sentences += [f"Tried, one change at a time: {names}. Nothing else was tried."] * bool(tried)
    if not (worse or missed):
        places = [each for factor, settings in tried if factor.startswith(PLACE) for each in settings]
        beside = f", objects at {' and '.join(places)} among them" * bool(places)
        than = "exceed a limit" if comparison.limited else "cost more than a rival"
        single = sum(len(settings) for _, settings in tried)
        line = f"in none of the {single} single changes that were tried{beside} does it {than} or miss"
        return called, f"{line} more than 1 % of objects.", " ".join(sentences)
    failing = [row["factor"] for row, _ in (*missed, *worse)]
    shown = dict.fromkeys([*(factor for factor in failing if factor.startswith(PLACE)), failing[0]])
    lines = [_line([*[each for each in worse if each[0]["factor"] == factor][:1],
                    *(each for each in missed if each[0]["factor"] == factor)]) for factor in shown]  # fmt: skip
    return called, " ".join(lines), " ".join(sentences)


def _above_limits(results: ComparisonResults, controller: str, ours: pl.DataFrame) -> Iterator[tuple[Row, str]]:
    """Yield the rows of changes in which a contestant clearly exceeds a limit, with words; without limits, nothing."""
    if not results.comparison.limited:
        return
    wanted = Limits(**results.comparison.limited["limits"])
    played = results.varied.filter(contestant=results.comparison.chosen if controller == POLICY else controller)
    for row in ours.filter(~pl.col("same")).to_dicts():
        episodes = played.filter(change=row["change"])
        for option, limit in wanted.given.items():
            name, unit, words = LIMITED[option]
            reached = quantile(episodes[name].to_numpy(), episodes["missed"].cast(bool).to_numpy(), wanted.share)
            if limit < reached.low <= reached.value < np.inf:  # else too many are missed, which is named for itself
                keeps = f"{100 * wanted.share:g} % keep {words} of {reached.value:.3g} {unit}, not {limit:g} {unit}"
                yield {**row, "most": reached.value / limit}, keeps


def _line(failures: Sequence[tuple[Row, str]]) -> str:
    """Return failures with the same changed argument as one line."""
    places = ((f"at {row['setting']}" if np.isfinite(row["value"]) else "there", words) for row, words in failures)
    line = ", ".join(f"{place} {words}" for place, words in places)
    factor = failures[0][0]["factor"]
    return f"{factor[0].upper()}{factor[1:]}. {line[0].upper()}{line[1:]}."


def rows(results: ComparisonResults, names: Mapping[str, str] | None = None, judged: str = "policy") -> list[Row]:
    """Return a row for each change, texts by heading: mean costs (m/s), and the misses of `judged`.

    `names` maps a heading to each contestant; `judged` is one of these headings.
    """
    names, found = names or {"rule": PAPER, "main baseline": results.comparison.rival.name, "policy": POLICY}, []
    for (factor, setting), group in outcomes(results).group_by("factor", "setting", maintain_order=True):
        each = {row["contestant"]: row for row in group.to_dicts()}
        row = {"set-up, change": f"{results.comparison.name}, {factor}: {setting}"}
        row |= {heading: f"{each[name]['loss']:.3f}" for heading, name in names.items()}
        missed = each[names[judged]]
        found.append(row | {f"missed by the {judged}": f"{missed['missed']} of {missed['of']}"})
    return found
