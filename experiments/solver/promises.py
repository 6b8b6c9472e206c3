"""What was promised of the storm, and whether it is met. A failure is listed with its scene, never dropped."""

import math
from collections.abc import Callable, Mapping, Sequence
from statistics import median_high
from typing import NamedTuple

import numpy as np
import polars as pl

from experiments.lab.tables import Row
from experiments.solver.solutions import relative_error

SLOWEST = 50.0  # ms
MOMENTUM = 1e-9  # over the impulse of the contact
ENERGY = 1e-6  # over the energy that went to and fro in the contact, beyond the doubt of the quadrature
PULL = 1e-12  # over the peak force, or the speed of the tool: rounding
FALL = 1e-8  # over the speed of the tool: rtol
AGREEMENT = 1e-6  # of V_p, relative
ABOUT = ("coupling", "milliseconds", "steps", "slowest_contact", "description")  # what a failure says of its scene
ROUNDINGS = 8.0  # of the momenta in a contact, that may explain a momentum error


def _largest(values: pl.Series) -> float:
    return max(values.filter(values.is_finite()), default=math.nan)


def _explained(row: Row) -> bool:
    """Whether the rounding of the momenta explains a momentum error."""
    return bool(max(row["momentum_error"], row["impulse_error"]) <= ROUNDINGS * row["rounding"])


def _budget(row: Row) -> str:
    errors = f"momentum error {row['momentum_error']:.1e}, impulse error {row['impulse_error']:.1e}"
    rounding = f", of which rounding of the momenta explains {ROUNDINGS * row['rounding']:.1e}"
    return errors + rounding * _explained(row)


def _time(row: Row) -> str:
    return f"{row['milliseconds']:.0f} ms" + (f", {row['steps']:.0f} steps" if row["steps"] > 0 else "")


def _times(rows: pl.DataFrame) -> str:
    return f"median {np.nanmedian(rows['milliseconds']):.2g} ms, slowest {_largest(rows['milliseconds']):,.0f} ms"


def _energies(done: pl.DataFrame) -> str:
    struck = done.filter(pl.col("contacts") > 0, pl.col("traced") == 1)
    excess = _largest(struck["energy_created"] - struck["energy_doubt"])
    return (
        f"largest beyond the doubt of the quadrature {excess:.1e} (lost, if negative), "
        f"doubt {_largest(struck['energy_doubt']):.1e} at most, {(done['traced'] == 0).sum()} scenes not traced"
    )


class Promise(NamedTuple):
    """What is promised of a row of the storm; a number that is not there breaks its promise."""

    text: str
    kept: Callable[[Row], bool]
    reason: Callable[[Row], str]  # what there is to say of a row that breaks it
    worst: Callable[[pl.DataFrame], str]  # what there is to say of all rows that it is about
    of_unfinished: bool = False  # whether it is about runs without an outcome, too


FINISHED = Promise(
    "every run ends by itself, with an outcome",
    lambda row: not row["failure"],
    lambda row: str(row["failure"]),
    lambda rows: f"{_largest(rows['steps']):,.0f} steps at most",
    of_unfinished=True,
)
FINITE = Promise(
    "every number is finite", lambda row: bool(row["finite"]), lambda _: "a number is inf or nan", lambda _: ""
)
FAST = Promise(
    "slowest run under 50 ms",
    lambda row: row["milliseconds"] < SLOWEST or bool(row["failure"] and math.isnan(row["milliseconds"])),
    _time,
    _times,
    of_unfinished=True,
)
BALANCED = Promise(
    "momentum error under 1e-9 of the impulse",
    lambda row: row["momentum_error"] < MOMENTUM and row["impulse_error"] < MOMENTUM,
    _budget,
    lambda rows: f"largest {max(_largest(rows['momentum_error']), _largest(rows['impulse_error'])):.1e}",
)
PASSIVE = Promise(
    "no contact creates energy",
    lambda row: not row["traced"] or row["energy_created"] <= ENERGY + row["energy_doubt"],
    lambda row: f"{row['energy_created']:.1e} of the energy appeared (known to {row['energy_doubt']:.1e})",
    _energies,
)
PUSHED = Promise(
    "the object is never pulled",
    lambda row: row["pull"] <= PULL,
    lambda row: f"pulled by {row['pull']:.1e} of the peak force, or V_p fell by that of the tool's speed",
    lambda rows: f"largest {_largest(rows['pull']):.1e}",
)
RISING = Promise(
    "V_p falls nowhere along a trace, to rtol",
    lambda row: row["trace_fall"] <= FALL,
    lambda row: f"V_p falls by {row['trace_fall']:.1e} of the tool's speed",
    lambda rows: f"largest {_largest(rows['trace_fall']):.1e}",
)
SETTLED = Promise(
    "V_p within 1e-6 of a run at a hundredth of rtol",
    lambda row: not row["traced"] or row["finer_change"] <= AGREEMENT,
    lambda row: f"V_p changes by {row['finer_change']:.1e}",
    lambda rows: f"median {np.nanmedian(rows['finer_change']):.1e}",
)
PROMISES = (FINISHED, FINITE, FAST, BALANCED, PASSIVE, PUSHED, RISING, SETTLED)


def failures(row: Row) -> list[Row]:
    """Return a row for each promise that a row of the storm breaks."""
    about = {name: row[name] for name in ABOUT}
    return [
        {"scene": row["scene"], "contender": promise.text, "failure": promise.reason(row)} | about
        for promise in PROMISES
        if (promise.of_unfinished or not row["failure"]) and not promise.kept(row)
    ]


class Verdict(NamedTuple):
    """A promise, what was found of it, and whether it is kept."""

    text: str
    finding: str
    met: bool


def over_storm(rows: Sequence[Row], broken: Sequence[Row]) -> list[Verdict]:
    """Return the promises of the storm: the worst over the scenes that finished, and how many have `broken` it."""
    frame = pl.DataFrame(rows, infer_schema_length=None)
    done = frame.filter(pl.col("failure") == "")
    verdicts = []
    for promise in PROMISES:
        finding = promise.worst(frame if promise.of_unfinished else done)
        scenes = {row["scene"] for row in broken if row["contender"] == promise.text}
        if scenes:
            beyond = ""
            if promise is BALANCED:
                unexplained = sum(row["scene"] in scenes and not _explained(row) for row in rows)
                beyond = f"{unexplained} of these beyond what rounding of the momenta explains, "
            finding = f"{len(scenes)} of {frame.height} scenes do not, {beyond}{finding}".removesuffix(", ")
        verdicts.append(Verdict(promise.text, finding, met=not scenes))
    return verdicts


def agreement(storm: Sequence[Row], truths: Mapping[int, Row]) -> list[Row]:
    """Return the rows of the storm whose truth is known, each beside what the independent solver finds."""
    rows = []
    for scene, true in truths.items():
        if not true["failure"]:
            ours, v_p = storm[scene], true["velocity"]
            row = {name: ours[name] for name in ("scene", "coupling", "speed", "description", "failure")}
            row |= {"contender": true["contender"], "velocity": ours["object_velocity"]}
            row["velocity_error"] = relative_error(ours["object_velocity"], v_p, ours["speed"])
            row |= {name: ours[name] for name in ("contacts", "passes")}
            rows.append(row | {f"true_{name}": true[name] for name in ("velocity", "contacts", "passes")})
    return rows


def disagreement(row: Row) -> str:
    """Return how ours and the independent solver differ on a scene, or an empty string."""
    if row["failure"]:
        return str(row["failure"])
    if row["velocity_error"] <= AGREEMENT and row["passes"] == row["true_passes"]:
        return ""
    words = [f"V_p {row['velocity']:.9g}, not {row['true_velocity']:.9g} m/s ({row['velocity_error']:.1e})"]
    for name, many in (("contacts", "contacts"), ("passes", "snap-throughs")):
        if row[name] != row[f"true_{name}"]:
            words.append(f"{row[name]:.0f} {many}, not {row[f'true_{name}']:.0f}")
    return "; ".join(words)


def over_agreement(rows: Sequence[Row], unknown: int) -> Verdict:
    """Return the promise of agreement with the independent solver, which could not do `unknown` scenes."""
    apart = sum(bool(disagreement(row)) for row in rows)
    middle = median_high([row["velocity_error"] for row in rows if not row["failure"]] or [math.nan])
    words = f"{apart} of {len(rows)} do not, median {middle:.1e}; {unknown} scenes the independent solver could not do"
    return Verdict("V_p within 1e-6 of the independent solver, on 2 %", words, bool(rows) and apart == 0)
