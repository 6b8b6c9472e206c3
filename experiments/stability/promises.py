"""What was promised of the storm, and whether it is met. A failure is listed with its scene, never dropped."""

import math
from collections.abc import Iterator, Sequence
from statistics import median_high
from typing import NamedTuple

import numpy as np
import polars as pl

from experiments.lab.tables import Row
from experiments.stability.agreement import SHARE
from experiments.stability.scenes import relative_error

SLOWEST = 50.0  # ms
MOMENTUM = 1e-9  # over the impulse of the contact
ENERGY = 1e-6  # over the energy that went to and fro in the contact, beyond the doubt of the quadrature
PULL = 1e-12  # over the peak force, or the speed of the tool: rounding
FALL = 1e-8  # over the speed of the tool: rtol
ABOUT = ("coupling", "milliseconds", "steps", "slowest_contact", "description")  # what a failure says of its scene
ROUNDINGS = 8.0  # of the momenta in a contact, that may explain a momentum error

PROMISES = FINISHED, FINITE, FAST, BALANCED, PASSIVE, PUSHED, RISING, SETTLED = (
    "every run ends by itself, with an outcome",
    "every number is finite",
    "slowest run under 50 ms",
    "momentum error under 1e-9 of the impulse",
    "no contact creates energy",
    "the object is never pulled",
    "V_p falls nowhere along a trace, to rtol",
    "V_p within 1e-6 of a run at a hundredth of rtol",
)


def failures(row: Row) -> list[Row]:
    """Return a row for each promise that a row of the storm breaks; a number that is not there breaks its promise."""
    about = {name: row[name] for name in ABOUT}
    return [
        {"scene": row["scene"], "contender": promise, "failure": reason} | about
        for promise, kept, reason in checked(row)
        if not kept
    ]


def checked(row: Row) -> Iterator[tuple[str, bool, str]]:
    """Yield the promises that are about a row of the storm, whether each is kept, and what there is to say if not."""
    yield FINISHED, not row["failure"], row["failure"]
    if not row["failure"]:
        yield FINITE, row["finite"], "a number is inf or nan"
        rounding = ROUNDINGS * row["rounding"]
        for name in ("momentum_error", "impulse_error"):
            explained = f", of which rounding of the momenta explains {rounding:.1e}" if row[name] <= rounding else ""
            yield BALANCED, row[name] < MOMENTUM, f"{name.replace('_', ' ')} {row[name]:.1e}{explained}"
        created, doubt, untraced = row["energy_created"], row["energy_doubt"], not row["traced"]
        reason = f"{created:.1e} of the energy appeared (known to {doubt:.1e})"
        yield PASSIVE, untraced or created <= ENERGY + doubt, reason
        reason = f"pulled by {row['pull']:.1e} of the peak force, or V_p fell by that of the tool's speed"
        yield PUSHED, row["pull"] <= PULL, reason
        yield RISING, row["trace_fall"] <= FALL, f"V_p falls by {row['trace_fall']:.1e} of the tool's speed"
        yield SETTLED, untraced or row["finer_change"] <= SHARE, f"V_p changes by {row['finer_change']:.1e}"
    hung = row["failure"] and math.isnan(row["milliseconds"])
    steps = f", {row['steps']:.0f} steps" if row["steps"] > 0 else ""
    yield FAST, hung or row["milliseconds"] < SLOWEST, f"{row['milliseconds']:.0f} ms{steps}"


class Promise(NamedTuple):
    """A promise, what was found of it, and whether it is kept."""

    text: str
    found: str
    met: bool


def over_storm(rows: Sequence[Row], broken: Sequence[Row]) -> list[Promise]:
    """Return the promises of the storm: the worst over the scenes that finished, and how many have `broken` it."""
    frame = pl.DataFrame(rows, infer_schema_length=None)
    done = frame.filter(pl.col("failure") == "")
    struck = done.filter(pl.col("contacts") > 0, pl.col("traced") == 1)

    def largest(values: pl.Series) -> float:
        return max(values.filter(values.is_finite()), default=math.nan)

    excess = largest(struck["energy_created"] - struck["energy_doubt"])
    worst = {
        FINISHED: f"{largest(frame['steps']):,.0f} steps at most",
        FINITE: "",
        FAST: f"median {np.nanmedian(frame['milliseconds']):.2g} ms, slowest {largest(frame['milliseconds']):,.0f} ms",
        BALANCED: f"largest {max(largest(done['momentum_error']), largest(done['impulse_error'])):.1e}",
        PASSIVE: f"largest beyond the doubt of the quadrature {excess:.1e} (lost, if negative), "
        f"doubt {largest(struck['energy_doubt']):.1e} at most, {(done['traced'] == 0).sum()} scenes not traced",
        PUSHED: f"largest {largest(done['pull']):.1e}",
        RISING: f"largest {largest(done['trace_fall']):.1e}",
        SETTLED: f"median {np.nanmedian(done['finer_change']):.1e}",
    }
    unexplained = sum(row["contender"] == BALANCED and "explains" not in row["failure"] for row in broken)
    beyond = {BALANCED: f"{unexplained} of these beyond what rounding of the momenta explains, "}
    promises = []
    for text, found in worst.items():
        if count := len({row["scene"] for row in broken if row["contender"] == text}):
            found = f"{count} of {frame.height} scenes do not, {beyond.get(text, '')}{found}".removesuffix(", ")
        promises.append(Promise(text, found, met=not count))
    return promises


def disagreement(row: Row) -> str:
    """Return how ours and the independent solver differ on a scene, or an empty string."""
    if row["failure"]:
        return str(row["failure"])
    if row["velocity_error"] <= SHARE and row["passes"] == row["true_passes"]:
        return ""
    words = [f"V_p {row['velocity']:.9g}, not {row['true_velocity']:.9g} m/s ({row['velocity_error']:.1e})"]
    for name, many in (("contacts", "contacts"), ("passes", "snap-throughs")):
        if row[name] != row[f"true_{name}"]:
            words.append(f"{row[name]:.0f} {many}, not {row[f'true_{name}']:.0f}")
    if not math.isnan(row["finest_velocity"]):
        fine = relative_error(row["finest_velocity"], row["true_velocity"], row["speed"])
        spread = row["spread"] / max(abs(row["true_velocity"]), 1e-300)
        words.append(f"{fine:.1e} at our finest tolerance; moving the object by 1e-13 changes V_p by {spread:.1e}")
    return "; ".join(words)


def over_agreement(rows: Sequence[Row], unknown: int) -> Promise:
    """Return the promise of agreement with the independent solver, which could not do `unknown` scenes."""
    apart = sum(bool(disagreement(row)) for row in rows)
    middle = median_high([row["velocity_error"] for row in rows if not row["failure"]] or [math.nan])
    words = f"{apart} of {len(rows)} do not, median {middle:.1e}; {unknown} scenes the independent solver could not do"
    return Promise("V_p within 1e-6 of the independent solver, on 2 %", words, bool(rows) and apart == 0)
