"""Limits for the objects, such as `--max-velocity 0.3`: when a controller keeps them, and the chart of all attempts.

A controller keeps a limit if the share `Limits.share` of all objects stays at or below it; a missed object counts as
above every limit.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain, repeat
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy.stats import quantile_test

from agents.evaluate.scenario_batch import Episodes
from experiments.lab import charts
from experiments.lab.parts import Picture
from experiments.lab.statistics import CONFIDENCE, Estimate
from impact_gym.parameters import SI, Options
from impact_gym.render import palette
from impact_gym.support.files import parsed
from impact_gym.support.validation import choice, number

LIMITED = {  # by option: the limited result, its unit, its words
    "max_velocity": ("object_velocity", "m/s", "V_p"),
    "max_force": ("peak_force", "N", "peak force"),
    "max_slide": ("slide", "m", "slide"),
}
KEYS = {"limits", "controller", "time_weight", "attempts"}  # of a file `limits.json`


@dataclass(frozen=True, kw_only=True)
class Limits(Options):
    """Limits for the objects that a controller touches; None: no limit."""

    max_velocity: Annotated[float | None, SI("m/s", above=0)] = None
    """Largest final velocity of the object, m/s; with friction, its largest velocity. With a limit, the command exports
    the soonest controller that keeps all limits, at the time weight that the limits need."""
    max_force: Annotated[float | None, SI("N", above=0)] = None
    """Largest contact force, N."""
    max_slide: Annotated[float | None, SI("m", above=0)] = None
    """Largest distance that the object slides, m. It needs a set-up with friction."""
    share: Annotated[float, SI("-", at_least=0.5, at_most=0.99)] = 0.95
    """Share of the objects that must stay at or below each limit. A missed object does not count as below."""

    @property
    def given(self) -> dict[str, float]:
        """The given limits, by option."""
        return {name: value for name in LIMITED if (value := getattr(self, name)) is not None}

    def reached(self, played: Episodes) -> dict[str, Estimate]:
        """Return for each given limit, by option, the quantile at `share` of the limited result."""
        return {name: quantile(getattr(played, LIMITED[name][0]), played.missed, self.share) for name in self.given}


def words(values: Mapping[str, Any]) -> str:
    """Return values of limited results, by option, with names and units."""
    return " and ".join(f"{LIMITED[name][2]} of {value} {LIMITED[name][1]}" for name, value in values.items())


def quantile(values: ArrayLike, missed: ArrayLike, share: float) -> Estimate:
    """Return a quantile with its interval, which assumes no distribution; `values` of missed objects count as inf."""
    counted = np.where(missed, np.inf, values)
    low, high = quantile_test(counted, p=share).confidence_interval(CONFIDENCE)
    return Estimate(float(np.quantile(counted, share, method="inverted_cdf")), float(low), float(high))


def read_limited(path: Path) -> dict[str, Any]:
    """Return the content of a file `limits.json`, see `experiments.limits`; ValueError: it is another file."""

    def checked(text: str) -> dict[str, Any]:
        content: dict[str, Any] = json.loads(text)
        if set(content) != KEYS:
            raise ValueError(f"it must have {sorted(KEYS)}")
        if not Limits(**content["limits"]).given:
            raise ValueError("limits must have a limit")
        number("time_weight", content["time_weight"], "m/s per s", above=0.0)
        choice("controller", content["controller"], list(content["attempts"]))
        for time, value, _ in chain.from_iterable(content["attempts"].values()):
            number("attempts", time, "s", at_least=0.0)
            number("attempts", value, "SI", at_least=0.0)
        return content

    return parsed(path, "limits.json of impact-gym controller", checked)


def times(limited: Mapping[str, Any]) -> dict[str, float]:
    """Return the least mean time (s) at which each contestant keeps the limits, by name, of those that keep them."""
    kept = {name: [time for time, _, keeps in tried if keeps] for name, tried in limited["attempts"].items()}
    return {name: min(found) for name, found in kept.items() if found}


def front(limited: Mapping[str, Any], labels: Mapping[str, str], name: str = "limits") -> Picture:
    """Return the chart of the first limited result over the mean time in all attempts, with the limit as a line."""
    wanted = Limits(**limited["limits"])
    (option, limit), *_ = wanted.given.items()
    _, unit, what = LIMITED[option]
    figure = Figure(figsize=(4.4, 3.4))
    axes = figure.subplots()
    colours = chain(charts.SERIES, repeat(charts.OTHERS))
    for (who, tried), colour in zip(limited["attempts"].items(), colours, strict=False):
        points = sorted((time, value) for time, value, _ in tried)
        axes.plot(*np.reshape(points, (-1, 2)).T, "o-", markersize=3, color=colour, label=labels[who])
    axes.axhline(limit, color=palette.INK, linestyle=":", label=f"limit: {limit:g} {unit}")
    axes.set(xlabel="mean time T (s)", ylim=(0.0, None))
    axes.set_ylabel(f"{what} ({unit}): {100 * wanted.share:g} % stay below")
    axes.legend(fontsize=8)
    caption = (
        f"Each mark is a controller at one time weight. Below the dotted line, {100 * wanted.share:g} % of the objects "
        f"stay below {limit:g} {unit}; of these marks, the one farthest to the left touches soonest."
    )
    least = ", ".join(f"{labels[who]} after {time:.3f} s" for who, time in times(limited).items())
    return Picture(name, figure, f"Soonest within the limit: {least or 'none'}.", caption, "What keeps the limit")
