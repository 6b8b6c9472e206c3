"""What was promised of the storm, and whether it is met. A failure is listed with its scene, never dropped."""

from collections.abc import Callable
from typing import NamedTuple

import polars as pl

SLOWEST = 50.0  # ms
MOMENTUM = 1e-9  # over the impulse of the contact
ENERGY = 1e-6  # over the energy that went to and fro in the contact, beyond the doubt of the quadrature
PULL = 1e-12  # over the peak force, or the speed of the tool: rounding
FALL = 1e-8  # over the speed of the tool: rtol
AGREEMENT = 1e-6  # of V_p, relative
ROUNDINGS = 8.0  # of the momenta in a contact, that may explain a momentum error
FINISHED = pl.col("failure") == ""
TRACED = pl.col("traced")
BUDGET = pl.max_horizontal("momentum_error", "impulse_error")
EXPLAINED = pl.col("rounding") * ROUNDINGS
CREATED = pl.col("energy_created") - pl.col("energy_doubt")


def _digits(column: str | pl.Expr, digits: int = 1) -> pl.Expr:
    """Return numbers as text."""
    column = pl.col(column) if isinstance(column, str) else column
    return column.map_elements(lambda value: f"{value:.{digits}e}", pl.String)


def _largest(rows: pl.DataFrame, column: str | pl.Expr) -> float:
    """Return the largest finite number of a column, nan if there is none."""
    values = rows.select(value=column)["value"].drop_nulls()
    largest = values.filter(values.is_finite()).max()
    return float("nan") if largest is None else float(largest)  # type: ignore[arg-type]


def _median(rows: pl.DataFrame, column: str | pl.Expr) -> float:
    """Return the median of the numbers of a column, nan if there is none."""
    value = rows.select(pl.col(column).fill_nan(None).median() if isinstance(column, str) else column.median()).item()
    return float("nan") if value is None else float(value)


class Promise(NamedTuple):
    """What is promised of a row of the storm; a number that is not there breaks its promise."""

    text: str
    kept: pl.Expr
    reason: pl.Expr  # what there is to say of a row that breaks it
    worst: Callable[[pl.DataFrame], str]  # what there is to say of all rows that it is about
    of_unfinished: bool = False  # whether it is about runs without an outcome, too

    def broken(self, rows: pl.DataFrame) -> pl.DataFrame:
        """Return scene, promise, reason and description of the rows that break it."""
        about = rows if self.of_unfinished else rows.filter(FINISHED)
        wrong = about.filter(~self.kept.fill_null(value=False))
        return wrong.select("scene", promise=pl.lit(self.text), reason=self.reason, description="description")


def _energies(rows: pl.DataFrame) -> str:
    struck = rows.filter(pl.col("contacts") > 0, TRACED)
    return (
        f"largest beyond the doubt of the quadrature {_largest(struck, CREATED):.1e} (lost, if negative), "
        f"doubt {_largest(struck, 'energy_doubt'):.1e} at most, {rows.filter(~TRACED).height} scenes not traced"
    )


def _budgets(rows: pl.DataFrame) -> str:
    beyond = rows.filter(~BALANCED.kept.fill_null(value=False), ~(BUDGET <= EXPLAINED)).height
    words = f"{beyond} of these beyond what rounding of the momenta explains, " if beyond else ""
    return f"{words}largest {_largest(rows, BUDGET):.1e}"


ENDED = Promise(
    "every run ends by itself, with an outcome", FINISHED, pl.col("failure"),
    lambda rows: f"{_largest(rows, 'steps'):,.0f} steps at most", of_unfinished=True,
)  # fmt: skip
FINITE = Promise("every number is finite", pl.col("finite"), pl.lit("a number is inf or nan"), lambda _: "")
FAST = Promise(
    "slowest run under 50 ms",
    # a run that was ended has no time
    (pl.col("milliseconds") < SLOWEST) | (~FINISHED & pl.col("milliseconds").is_null()),
    pl.format("{} ms, {} steps", pl.col("milliseconds").round(0), pl.col("steps").fill_null(0)),
    lambda rows: f"median {_median(rows, 'milliseconds'):.2g} ms, slowest {_largest(rows, 'milliseconds'):,.0f} ms",
    of_unfinished=True,
)
BALANCED = Promise(
    "momentum error under 1e-9 of the impulse",
    (pl.col("momentum_error") < MOMENTUM) & (pl.col("impulse_error") < MOMENTUM),
    pl.format(
        "momentum error {}, impulse error {}, of which rounding of the momenta explains {}",
        _digits("momentum_error"), _digits("impulse_error"), _digits(EXPLAINED),
    ),
    _budgets,
)  # fmt: skip
PASSIVE = Promise(
    "no contact creates energy",
    ~TRACED | (CREATED <= ENERGY),
    pl.format("{} of the energy appeared (known to {})", _digits("energy_created"), _digits("energy_doubt")),
    _energies,
)
PUSHED = Promise(
    "the object is never pulled",
    pl.col("pull") <= PULL,
    pl.format("pulled by {} of the peak force, or V_p fell by that of the tool's speed", _digits("pull")),
    lambda rows: f"largest {_largest(rows, 'pull'):.1e}",
)
RISING = Promise(
    "V_p falls nowhere along a trace, to rtol",
    pl.col("trace_fall") <= FALL,
    pl.format("V_p falls by {} of the tool's speed", _digits("trace_fall")),
    lambda rows: f"largest {_largest(rows, 'trace_fall'):.1e}",
)
SETTLED = Promise(
    "V_p within 1e-6 of a run at a hundredth of rtol",
    ~TRACED | (pl.col("finer_change") <= AGREEMENT),
    pl.format("V_p changes by {}", _digits("finer_change")),
    lambda rows: f"median {_median(rows, 'finer_change'):.1e}",
)
PROMISES = (ENDED, FINITE, FAST, BALANCED, PASSIVE, PUSHED, RISING, SETTLED)


def failures(rows: pl.DataFrame) -> pl.DataFrame:
    """Return a row for each promise that a row of the storm breaks."""
    return pl.concat([promise.broken(rows) for promise in PROMISES]).sort("scene")


class Verdict(NamedTuple):
    """A promise, what was found of it, and whether it is kept."""

    text: str
    finding: str
    met: bool


def over_storm(rows: pl.DataFrame) -> list[Verdict]:
    """Return the promises of the storm: the worst over the scenes that finished, and how many break it."""
    verdicts = []
    for promise in PROMISES:
        finding, count = (
            promise.worst(rows if promise.of_unfinished else rows.filter(FINISHED)),
            promise.broken(rows).height,
        )
        if count:
            finding = f"{count} of {rows.height} scenes do not, {finding}".removesuffix(", ")
        verdicts.append(Verdict(promise.text, finding, met=not count))
    return verdicts


def agreement(storm: pl.DataFrame, truths: pl.DataFrame) -> pl.DataFrame:
    """Return the rows of the storm whose truth is known, with `velocity_error` and how they are `apart`, or ''."""
    known = truths.filter(FINISHED).select(
        "scene", true_velocity="velocity", true_contacts="contacts", true_passes="passes"
    )
    size = pl.max_horizontal(pl.col("true_velocity").abs(), 1e-6 * pl.col("speed"))  # an object at rest has rounding
    error = (pl.col("object_velocity") - pl.col("true_velocity")).abs() / size
    alike = (pl.col("velocity_error") <= AGREEMENT) & (pl.col("passes") == pl.col("true_passes"))
    counts = "V_p {}, not {} m/s ({}); {} contacts, not {}; {} snap-throughs, not {}"
    said = pl.format(
        counts, _digits("object_velocity", 8), _digits("true_velocity", 8), _digits("velocity_error"),
        "contacts", "true_contacts", "passes", "true_passes",
    )  # fmt: skip
    apart = pl.when(~FINISHED).then("failure").when(~alike.fill_null(value=False)).then(said).otherwise(pl.lit(""))
    return storm.join(known, on="scene").with_columns(velocity_error=error).with_columns(apart=apart)


def over_agreement(judged: pl.DataFrame, unknown: int) -> Verdict:
    """Return the promise of agreement with the independent solver, which could not do `unknown` scenes."""
    apart, middle = judged.filter(pl.col("apart") != "").height, _median(judged, "velocity_error")
    words = (
        f"{apart} of {judged.height} do not, median {middle:.1e}; {unknown} scenes the independent solver could not do"
    )
    return Verdict("V_p within 1e-6 of the independent solver, on 2 %", words, judged.height > 0 and apart == 0)
