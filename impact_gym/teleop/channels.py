"""Channels between an operator and an arm, with random or recorded delays and losses."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.kernels import LONGEST_JITTER
from impact_gym.parameters import Parameters
from impact_gym.support.column_names import Column, unit_hint
from impact_gym.support.csv_files import read_columns
from impact_gym.support.validation import numbers, rising, shown

WAYS = ("uplink", "downlink")
CUT = float(LONGEST_JITTER)  # the random part of a delay is at most this multiple of its mean
LOST = 1e6  # s, delay of a lost packet: longer than any episode
LEAST_USUAL = 1e-4  # s; questions about units assume longer delays, and longer times between packets
USUAL_DELAY = 1.0  # s; a trace file with a median delay of at least this must state the unit
TRACE_COLUMNS = {
    "time": Column("s", r"((rel|relative|elapsed|send|sent) )?(time ?stamp|time|at)s?|t|sent"),
    "delay": Column("s", r"((one way|network|packet) )?(delay|latency|owd)s?", may_be_empty=True),
}


@dataclass(frozen=True, slots=True)
class Channel(Parameters, path="uplink"):
    """A channel for packets from operator to arm, or from arm to operator.

    The receiver drops a packet that arrives after a newer one. The delay of a packet is `delay` plus an exponentially
    distributed random time, at most twelve times its mean. The mean is `tail` for the fraction `tail_share` of the
    packets, and `jitter` for the others. A `trace` (rows of time and delay in s, or a CSV file of such rows) gives the
    delays instead. The trace repeats, and each episode begins at a random time in it. A packet is lost if the row
    nearest in time has the delay `LOST`, or in a task a delay of at least the horizon. `loss` adds losses, in bursts
    (Gilbert 1960, Bell Syst. Tech. J. 39).
    """

    delay: float = 0.0  # s
    jitter: float = 0.0  # s
    loss: float = 0.0  # -, fraction of packets lost
    burst: float = 1.0  # -, mean number of successive losses
    timeout: float = 0.1  # s, uplink only: the arm stops after this time without a newer command
    trace: Any = None
    tail: float = 0.0  # s
    tail_share: float = 0.0  # -

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        if self.trace is not None:
            columns = {name: numbers(f"Channel.trace: {name}", values, "s", at_least=0.0, at_most=1e6)
                       for name, values in zip(("time", "delay"), columns_of(self.trace), strict=True)}  # fmt: skip
            rising("Channel.trace", columns["time"], "delay", columns["delay"])
            object.__setattr__(self, "trace", tuple(zip(*columns.values(), strict=True)))
            if len(self.delays) < 2:
                raise ValueError(f"Channel.trace must have 2 packets or more that arrive, got {len(self.delays)}")
            for name in ("delay", "jitter", "tail", "tail_share"):
                if value := getattr(self, name):
                    raise ValueError(f"Channel.{name} must be 0 with a trace, which gives all delays, got {value!r}")
        if self.loss > (most := self.burst / (1.0 + self.burst)):
            raise ValueError(f"Channel.loss must be at most {most:g} for burst = {self.burst:g}, got {self.loss!r}")

    def within(self, horizon: float, way: str) -> "Channel":
        """Return the channel `way` in which packets with a delay of at least `horizon` (s) are lost; warn of them."""
        late = np.array(self.delays) >= horizon
        if not late.any():
            return self
        if 2 * late.sum() >= len(late):
            least, most = min(self.delays), max(self.delays)
            raise ValueError(f"{way}.trace must have more than half of its delays below the horizon, {horizon:g} s, "
                             f"got {least:g} to {most:g} s (rows and files that name no unit, such as ms, are in s)"
                             )  # fmt: skip
        warnings.warn(f"{way}.trace: {late.sum()} of {len(late)} packets have delays of at least the horizon, "
                      f"{horizon:g} s, and count as lost", stacklevel=5)  # fmt: skip
        return replace(self, trace=[(time, LOST if delay >= horizon else delay) for time, delay in self.trace])

    @property
    def delays(self) -> tuple[float, ...]:
        """Delays (s) of those packets of the trace that arrived."""
        return tuple(delay for _, delay in self.trace or () if delay < LOST)

    @property
    def table(self) -> NDArray[np.float64]:
        """The trace as n times (s), then n delays (s). A delay is `LOST` where the row nearest in time is a loss."""
        times, delays = np.array(self.trace or np.empty((0, 2)), np.float64).T
        lost = delays >= LOST
        if not lost.any():
            return np.concatenate([times, delays])
        ends = np.flatnonzero(lost[1:] != lost[:-1])
        middles = 0.5 * (times[ends] + times[ends + 1])
        at = np.concatenate([times, middles, np.nextafter(middles, np.inf)])
        none = np.concatenate([lost, lost[ends], lost[ends + 1]])
        values = np.where(none, LOST, np.interp(at, times[~lost], delays[~lost]))
        order = np.argsort(at)
        return np.concatenate([at[order], values[order]])


FIFTH_GENERATION = {
    f"5g-{mean}ms": Channel(least / 1e3, 1e-3 / fast, tail=1e-3 / slow, tail_share=share)
    for mean, least, share, fast, slow in (
        (100, 70.0, 0.726, 0.0853, 0.0271), (299, 210.0, 0.893, 0.0162, 0.0108), (500, 406.0, 0.896, 0.0155, 0.0103),
    )
}  # fmt: skip
"""Channels of telesurgery over 5G (UVA-DSA/telesurgery-qos-analysis, arXiv 2603.06824), named by mean delay."""


def columns_of(trace: Any) -> list[list[float]]:
    """Return the times and the delays (s) of a trace: rows (time, delay) or a CSV file.

    The times of a file are shifted to begin at 0 s, and an empty or infinite delay in a file becomes `LOST`.
    """
    wanted = f"Channel.trace must be rows of time and delay in s, or a CSV file of them, got {shown(trace)}"
    try:
        if isinstance(trace, (str, Path)):
            columns, said = read_columns(Path(trace), TRACE_COLUMNS, ("time", "delay"))
            time, delay = columns["time"], columns["delay"]
            delay = np.where(np.isnan(delay), np.inf, delay)
            usual = float(np.median(delay[delay < np.inf])) if np.isfinite(delay).any() else 0.0
            dated = unit_hint(0.0, 0.0, begin=time[0])
            if "without a unit" in said and (dated or usual >= USUAL_DELAY):
                got = f"time begins at {time[0]:.16g} s" if dated else f"delay is {usual:g} s in the median"
                hint = dated or unit_hint(usual, USUAL_DELAY, LEAST_USUAL) or "."
                raise ValueError(f"its {got}{hint} Write both units into the header, such as time (s), delay (s)")
            delay = np.where(delay < np.inf, np.minimum(delay, np.nextafter(LOST, 0.0)), LOST)
            return [(time - time[0]).tolist(), delay.tolist()]
        rows = np.asarray(trace, np.float64).T
    except (OSError, TypeError, ValueError) as problem:
        why = " ".join(f"{problem}".split())
        raise ValueError(f"{wanted}: {why}") from None
    if rows.ndim != 2 or len(rows) != 2:
        raise ValueError(wanted)
    return rows.tolist()


def without_files(environment: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments in an untrusted file as a dict; raise ValueError if a channel's trace is a file name."""
    for way in WAYS:
        channel = environment.get(way)
        if isinstance(channel, Mapping) and isinstance(trace := channel.get("trace"), str):
            raise ValueError(f"{way}.trace must be rows of time and delay in s, got {shown(trace)}: no file is read")
    return dict(environment)
