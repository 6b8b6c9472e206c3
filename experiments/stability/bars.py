"""What was promised of the storm, and whether it is met. A failure is listed with its scene, never dropped."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from experiments.speed_vs_error.records import Row
from experiments.stability.agreement import SHARE, relative_error

SLOWEST = 50.0  # ms
MOMENTUM = 1e-9  # over the impulse of the contact
ENERGY = 1e-6  # over the energy that went to and fro in the contact, beyond the doubt of the quadrature
PULL = 1e-12  # over the peak force, or the speed of the tool: rounding
FALL = 1e-8  # over the speed of the tool: rtol
ROUNDINGS = 8.0  # of the momenta in a contact, that may explain a momentum error

FINISHED, FINITE, FAST, BALANCED, PASSIVE, PUSHED, RISING, SETTLED = (
    "every run ends by itself, with an outcome",
    "every number is finite",
    "slowest run under 50 ms",
    "momentum error under 1e-9 of the impulse",
    "no contact creates energy",
    "the object is never pulled",
    "V_p falls nowhere along a trace, to rtol",
    "V_p within 1e-6 of a run at a hundredth of rtol",
)
PROMISES = (FINISHED, FINITE, FAST, BALANCED, PASSIVE, PUSHED, RISING, SETTLED)


@dataclass(frozen=True)
class Failure:
    """A scene that does not keep a promise."""

    scene: str
    promise: str
    reason: str
    row: Row = field(repr=False)


def failures(row: Row) -> list[Failure]:
    """Return which promises a row of the storm breaks. A number that is not there breaks its promise."""
    found: list[tuple[str, str]] = []
    if row["failure"]:
        return [Failure(row["scene"], FINISHED, row["failure"], row), *_late(row)]
    if not row["finite"]:
        found.append((FINITE, "a number is inf or nan"))
    for name in ("momentum_error", "impulse_error"):
        if not row[name] < MOMENTUM:
            reason = f"{name.replace('_', ' ')} {row[name]:.1e}"
            if row[name] <= ROUNDINGS * row["rounding"]:
                reason += f", of which rounding of the momenta explains {ROUNDINGS * row['rounding']:.1e}"
            found.append((BALANCED, reason))
    if row["traced"] and not row["energy_created"] <= ENERGY + row["energy_doubt"]:
        created, doubt = row["energy_created"], row["energy_doubt"]
        found.append((PASSIVE, f"{created:.1e} of the energy appeared (known to {doubt:.1e})"))
    if not row["pull"] <= PULL:
        found.append(
            (PUSHED, f"pulled by {row['pull']:.1e} of the peak force, or V_p fell by that of the tool's speed")
        )
    if not row["trace_fall"] <= FALL:
        found.append((RISING, f"V_p falls by {row['trace_fall']:.1e} of the tool's speed"))
    change = row["finer_change"] / max(abs(row["object_velocity"]), 1e-6 * row["speed"])
    if row["traced"] and not change <= SHARE:
        found.append((SETTLED, f"V_p changes by {change:.1e}"))
    return [Failure(row["scene"], promise, reason, row) for promise, reason in found] + _late(row)


def _late(row: Row) -> list[Failure]:
    if row["milliseconds"] < SLOWEST or (row["failure"] and math.isnan(row["milliseconds"])):
        return []
    reason = f"{row['milliseconds']:.0f} ms" + (f", {row['steps']:.0f} steps" if row["steps"] else "")
    return [Failure(row["scene"], FAST, reason, row)]


@dataclass(frozen=True)
class Bar:
    """A promise and what became of it."""

    promise: str
    found: str
    met: bool


def over_storm(found: Sequence[Failure], extremes: Mapping[str, float]) -> list[Bar]:
    """Return the bars of the storm; `extremes` are the worst of each column over the scenes that finished."""
    worst = {
        FINISHED: f"{extremes['steps']:,.0f} steps at most",
        FINITE: "",
        FAST: f"median {extremes['median']:.2g} ms, slowest {extremes['milliseconds']:,.0f} ms",
        BALANCED: f"largest {max(extremes['momentum_error'], extremes['impulse_error']):.1e}",
        PASSIVE: f"largest beyond the doubt of the quadrature {extremes['excess']:.1e} (lost, if negative), "
        f"doubt {extremes['doubt']:.1e} at most, {extremes['untraced']:.0f} scenes not traced",
        PUSHED: f"largest {extremes['pull']:.1e}",
        SETTLED: f"median {extremes['settled']:.1e}",
        RISING: f"largest {extremes['trace_fall']:.1e}",
    }
    bars = []
    for promise in PROMISES:
        broken = len({failure.scene for failure in found if failure.promise == promise})
        unexplained = sum(f.promise == promise and "explains" not in f.reason for f in found)
        words = [f"{broken} of {extremes['scenes']:.0f} scenes do not"] if broken else []
        if promise == BALANCED and broken:
            words.append(f"{unexplained} of these beyond what rounding of the momenta explains")
        bars.append(Bar(promise, ", ".join([*words, worst[promise]]).strip(", "), broken == 0))
    return bars


def disagreement(row: Row) -> str:
    """Return how ours and the independent solver differ on a scene, or an empty string."""
    if row["failure"]:
        return str(row["failure"])
    error = relative_error(row["velocity"], row["true_velocity"], row["speed"])
    if error <= SHARE and row["passes"] == row["true_passes"]:
        return ""
    words = [f"V_p {row['velocity']:.9g}, not {row['true_velocity']:.9g} m/s ({error:.1e})"]
    if row["contacts"] != row["true_contacts"]:
        words.append(f"{row['contacts']:.0f} contacts, not {row['true_contacts']:.0f}")
    if row["passes"] != row["true_passes"]:
        words.append(f"{row['passes']:.0f} snap-throughs, not {row['true_passes']:.0f}")
    if not math.isnan(row["finest_velocity"]):
        fine = relative_error(row["finest_velocity"], row["true_velocity"], row["speed"])
        spread = row["spread"] / max(abs(row["true_velocity"]), 1e-300)
        words.append(f"{fine:.1e} at our finest tolerance; moving the object by 1e-13 changes V_p by {spread:.1e}")
    return "; ".join(words)


def over_agreement(rows: Iterable[Row], unknown: int) -> Bar:
    """Return the bar of the agreement with the independent solver, which could not do `unknown` scenes."""
    rows = list(rows)
    apart = sum(bool(disagreement(row)) for row in rows)
    errors = sorted(
        relative_error(row["velocity"], row["true_velocity"], row["speed"]) for row in rows if not row["failure"]
    )
    middle = errors[len(errors) // 2] if errors else math.nan
    words = f"{apart} of {len(rows)} do not, median {middle:.1e}; {unknown} scenes the independent solver could not do"
    return Bar("V_p within 1e-6 of the independent solver, on 2 %", words, bool(rows) and apart == 0)


def over_invariances(rows: Sequence[Row]) -> list[Bar]:
    """Return the bars of what must not matter."""
    return [
        Bar(
            f"{row['contender']}: {row['description']}",
            f"median {row['median']:.1e}, largest {row['largest']:.1e}, equal to the bit in "
            f"{100 * row['equal']:.0f} % of {row['scenes']:.0f}",
            bool(row["met"]),
        )
        for row in rows
    ]
