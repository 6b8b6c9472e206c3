"""What was promised of the storm, and whether it is met. A failure is listed with its scene, never dropped."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median_high

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
    found: list[Row] = []

    def check(promise: str, kept: bool, reason: str) -> None:
        if not kept:
            about = {name: row[name] for name in ABOUT}
            found.append({"scene": row["scene"], "contender": promise, "failure": reason} | about)

    check(FINISHED, not row["failure"], row["failure"])
    if not row["failure"]:
        check(FINITE, row["finite"], "a number is inf or nan")
        for name in ("momentum_error", "impulse_error"):
            reason, rounding = f"{name.replace('_', ' ')} {row[name]:.1e}", ROUNDINGS * row["rounding"]
            if row[name] <= rounding:
                reason += f", of which rounding of the momenta explains {rounding:.1e}"
            check(BALANCED, row[name] < MOMENTUM, reason)
        created, doubt, traced = row["energy_created"], row["energy_doubt"], row["traced"]
        reason = f"{created:.1e} of the energy appeared (known to {doubt:.1e})"
        check(PASSIVE, not traced or created <= ENERGY + doubt, reason)
        reason = f"pulled by {row['pull']:.1e} of the peak force, or V_p fell by that of the tool's speed"
        check(PUSHED, row["pull"] <= PULL, reason)
        check(RISING, row["trace_fall"] <= FALL, f"V_p falls by {row['trace_fall']:.1e} of the tool's speed")
        check(SETTLED, not traced or row["finer_change"] <= SHARE, f"V_p changes by {row['finer_change']:.1e}")
    reason = f"{row['milliseconds']:.0f} ms" + (f", {row['steps']:.0f} steps" if row["steps"] > 0 else "")
    hung = row["failure"] and math.isnan(row["milliseconds"])
    check(FAST, hung or row["milliseconds"] < SLOWEST, reason)
    return found


@dataclass(frozen=True)
class Bar:
    """A promise and what became of it."""

    promise: str
    found: str
    met: bool


def over_storm(rows: Sequence[Row], broken: Sequence[Row]) -> list[Bar]:
    """Return the bars of the storm: the worst of each column over the scenes that finished, and what is `broken`."""
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
        SETTLED: f"median {np.nanmedian(done['finer_change']):.1e}",
        RISING: f"largest {largest(done['trace_fall']):.1e}",
    }
    bars = []
    for promise in PROMISES:
        here = [row for row in broken if row["contender"] == promise]
        count = len({row["scene"] for row in here})
        words = [f"{count} of {frame.height} scenes do not"] if here else []
        if promise == BALANCED and here:
            unexplained = sum("explains" not in row["failure"] for row in here)
            words.append(f"{unexplained} of these beyond what rounding of the momenta explains")
        bars.append(Bar(promise, ", ".join([*words, worst[promise]]).strip(", "), not here))
    return bars


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


def over_agreement(rows: Sequence[Row], unknown: int) -> Bar:
    """Return the bar of the agreement with the independent solver, which could not do `unknown` scenes."""
    apart = sum(bool(disagreement(row)) for row in rows)
    errors = [row["velocity_error"] for row in rows if not row["failure"]]
    middle = median_high(errors) if errors else math.nan
    words = f"{apart} of {len(rows)} do not, median {middle:.1e}; {unknown} scenes the independent solver could not do"
    return Bar("V_p within 1e-6 of the independent solver, on 2 %", words, bool(rows) and apart == 0)
