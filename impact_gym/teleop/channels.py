"""Channels between an operator and an arm: their delays, losses and traces, and those of telesurgery over 5G."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.csv_files import Column, read_columns
from impact_gym.kernels import LONGEST_JITTER
from impact_gym.parameters import Parameters
from impact_gym.validation import numbers, rising, shown

CUT = float(LONGEST_JITTER)  # means of a random delay, which takes no longer
LOST = 1e6  # s, the delay of a packet that never arrives: longer than any episode
USUAL_DELAY = 1.0  # s; a file with longer ones must say its unit
TRACE_COLUMNS = {
    "time": Column("s", r"((rel|relative|elapsed|send|sent) )?(time ?stamp|time|at)s?|t|sent"),
    "delay": Column("s", r"((one way|network|packet) )?(delay|latency|owd)s?", may_be_empty=True),
}


@dataclass(frozen=True, slots=True)
class Channel(Parameters, path="uplink"):
    """One way between operator and arm: a packet each control period; the newest wins, later ones are dropped.

    A packet takes `delay` and an exponential time beside, of mean `jitter`, or of mean `tail` for a share of them; what
    takes more than twelve times its mean is cut. With a `trace`, rows of time and delay in s or a CSV file of these, it
    takes what the trace says, from a random place on; a delay of `LOST` loses the packets that are sent nearest to it.
    Losses come in bursts (Gilbert 1960, Bell Syst. Tech. J. 39).
    """

    delay: float = 0.0  # s
    jitter: float = 0.0  # s
    loss: float = 0.0  # -, share of all packets
    burst: float = 1.0  # -, mean number in a row
    timeout: float = 0.1  # s; of the uplink alone: without a newer command for so long the arm stops
    trace: Any = None
    tail: float = 0.0  # s
    tail_share: float = 0.0  # -

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        if self.trace is not None:
            columns = {name: numbers(f"Channel.trace: {name}", values, "s", at_least=0.0, at_most=1e6)
                       for name, values in zip(("time", "delay"), columns_of(self.trace), strict=True)}  # fmt: skip
            rising("Channel.trace", columns["time"], {"delay": columns["delay"]})
            object.__setattr__(self, "trace", tuple(zip(*columns.values(), strict=True)))
            if len(self.delays) < 2:
                raise ValueError(f"Channel.trace must have 2 packets or more that arrive, got {len(self.delays)}")
            for name in ("delay", "jitter", "tail", "tail_share"):
                if value := getattr(self, name):
                    raise ValueError(f"Channel.{name} must be 0 beside a trace, which has all delays, got {value!r}")
        if self.loss > (most := self.burst / (1.0 + self.burst)):
            raise ValueError(f"Channel.loss must be at most {most:g} with bursts of {self.burst:g}, got {self.loss!r}")

    @property
    def delays(self) -> tuple[float, ...]:
        """Delays of the packets of the trace that arrived, s."""
        return tuple(delay for _, delay in self.trace or () if delay < LOST)

    @property
    def table(self) -> NDArray[np.float64]:
        """The trace: times (s), then as many delays (s), `LOST` up to the middle between such a packet and the next."""
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
"""Channels of telesurgery over 5G (UVA-DSA/telesurgery-qos-analysis, arXiv 2603.06824), by their mean delay."""


def columns_of(trace: Any) -> list[list[float]]:
    """Return the times and delays (s) of rows of both, or of a CSV file, see `impact_gym.csv_files`.

    Those of a file begin at 0 s; an empty delay, or one that is no finite number, is that of a packet that is `LOST`.
    """
    wanted = f"Channel.trace must be rows of time and delay in s, or a CSV file of them, got {shown(trace)}"
    try:
        if isinstance(trace, (str, Path)):
            table = read_columns(Path(trace), TRACE_COLUMNS, ("time", "delay"))
            time, delay = table.columns["time"], table.columns["delay"]
            delay = np.where(np.isnan(delay) | (delay == np.inf), LOST, delay)
            arrived = delay[delay < LOST]
            if table.said.count(" without a unit") and len(arrived) and np.median(arrived) >= USUAL_DELAY:
                raise ValueError(f"its delays are {np.median(arrived):g} s in the median: are they in ms? If not, "
                                 "write the unit into the header, delay (s)")  # fmt: skip
            return [(time - time[0]).tolist(), delay.tolist()]
        columns = np.asarray(trace, np.float64).T
    except (OSError, TypeError, ValueError) as problem:
        why = " ".join(f"{problem}".split())
        raise ValueError(f"{wanted}: {why}") from None
    if columns.ndim != 2 or len(columns) != 2:
        raise ValueError(wanted)
    return columns.tolist()
