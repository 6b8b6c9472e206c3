"""Tables of measured hits of a free object: read, fitted on one half, the other half predicted.

A tool of effective mass m that arrives at v gives an object of mass m_p the velocity (1 + e) phi, with the flux
phi = m v / (m + m_p) (paper, eq. 2 with an object at rest), and friction stops it after (1 + e)^2 phi^2 / (2 mu g).
Restitution and friction come as one number: of distances alone they cannot be told apart.
"""

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.files import parsed
from impact_gym.validation import shown

Array = NDArray[np.float64]
FEWEST = 20  # hits of a set
SPLITS = 200
LOG = {"time", "force"}  # what a log of one blow has


@dataclass(frozen=True)
class Hits:
    """One set of hits."""

    name: str
    flux: Array  # m/s, (n,)
    distance: Array  # m, (n,)
    repeat: NDArray[np.str_]  # what is equal for hits that were meant to be equal, (n,)
    left_out: int = 0  # rows that are no hit

    def part(self, rows: Any) -> "Hits":
        """Return some of the hits."""
        return Hits(self.name, self.flux[rows], self.distance[rows], self.repeat[rows])


def read(
    path: Path, distance: str, flux: str, by: Sequence[str], repeat: Sequence[str], at_least: Mapping[str, float]
) -> list[Hits]:
    """Return the sets of a CSV file: hits with the same values in the columns `by`.

    A row whose numbers are none, or not above what they must be `at_least`, is left out and counted; so is one whose
    distance or flux is not above 0.

    Raises:
        ValueError: the file has not these columns, or too few hits; names it and what it has.
    """
    rows = parsed(path, "CSV", lambda text: list(csv.DictReader(text.splitlines())))
    names = list(rows[0]) if rows else []
    missing = [name for name in (distance, flux, *by, *repeat, *at_least) if name not in names]
    if missing and {*names} >= LOG:
        raise ValueError(f"{path} is the log of one blow, not a table of hits: give what is known of it with --scene")
    if missing:
        raise ValueError(f"{path} has no column {missing[0]!r}, there are {names}")
    sets: dict[str, list[Mapping[str, str]]] = {}
    for row in rows:
        sets.setdefault(" ".join([path.stem, *(f"{name} {row[name]}" for name in by)]), []).append(row)
    least, made = {distance: 0.0, flux: 0.0} | dict(at_least), list[Hits]()
    for name, mine in sets.items():
        numbers = np.array([[_number(row[column]) for column in (flux, distance, *least)] for row in mine])
        kept = np.isfinite(numbers).all(axis=1) & (numbers[:, 2:] > list(least.values())).all(axis=1)
        equal = np.array([" ".join(row[column] for column in repeat) for row in mine])
        flux_of, way_of = numbers[kept, :2].T
        made.append(Hits(name, flux_of, way_of, equal[kept], int(np.sum(~kept))))
    enough = [hits for hits in made if len(hits.flux) >= FEWEST]
    if not enough:
        raise ValueError(f"{path} has sets of {[len(hits.flux) for hits in made]} hits, {FEWEST} or more are needed")
    return enough


def _number(text: Any) -> float:
    try:
        return float(text)
    except (TypeError, ValueError):
        return np.nan


def least(texts: Sequence[str]) -> dict[str, float]:
    """Return what columns must be above, of texts like `HittingFlux=0.35`."""
    found = {}
    for text in texts:
        name, _, value = text.rpartition("=")
        if not name or not np.isfinite(_number(value)):
            raise ValueError(f"at_least must be COLUMN=NUMBER, got {shown(text)}")
        found[name] = float(value)
    return found


Predict = Callable[[Hits], Array]
"""What a fit says of the distances of other hits, (n,); nan where it says nothing."""


def number_of(hits: Hits) -> float:
    """Return (1 + e)^2 / (2 mu g), s^2/m, the median of what each hit says."""
    return float(np.median(hits.distance / hits.flux**2))


def blow(hits: Hits) -> Predict:
    """Fit that number."""
    number = number_of(hits)
    return lambda other: number * other.flux**2


def power(hits: Hits) -> Predict:
    """Fit any power of the flux."""
    exponent, start = np.polyfit(np.log(hits.flux), np.log(hits.distance), 1)
    return lambda other: np.asarray(np.exp(start) * other.flux**exponent)


def line(hits: Hits) -> Predict:
    """Fit a straight line."""
    slope, start = np.polyfit(hits.flux, hits.distance, 1)
    return lambda other: np.asarray(slope * other.flux + start)


def equal(hits: Hits) -> Predict:
    """Take the median of the hits that were meant to be equal: what repeats leave, whatever the model."""
    median = {name: float(np.median(hits.distance[hits.repeat == name])) for name in np.unique(hits.repeat)}
    return lambda other: np.array([median.get(name, np.nan) if name else np.nan for name in other.repeat])


MODELS: Mapping[str, Callable[[Hits], Predict]] = {
    "blow and friction, one number": blow, "any power of the flux, two": power, "straight line, two": line,
    "median of equal hits": equal,
}  # fmt: skip
BLOW, *_, EQUAL = MODELS


def errors(hits: Hits, model: str, other: Hits | None = None, beside: str = BLOW) -> tuple[float, float, float]:
    """Return median and 95 % relative error on hits that nothing was fitted on, and how many its interval holds.

    With `other` these are all of its hits, else the other half, over random halves; of these only such as another
    model, `beside`, says something of. All are nan where there are none.
    """
    off, held = list[Array](), list[Array]()
    for one, two in _halves(hits) if other is None else [(hits, other)]:
        predict = MODELS[model](one)
        known = one.distance / predict(one)
        spread = np.nanquantile(known, [0.025, 0.975]) if np.isfinite(known).any() else np.full(2, np.nan)
        share = two.distance / predict(two)
        share = share[np.isfinite(share + MODELS[beside](one)(two))]
        off.append(np.abs(1.0 / share - 1.0))
        held.append((spread[0] <= share) & (share <= spread[1]))
    together = np.concatenate(off)
    if not len(together):
        return np.nan, np.nan, np.nan
    return float(np.median(together)), float(np.quantile(together, 0.95)), float(np.mean(np.concatenate(held)))


def _halves(hits: Hits) -> Iterator[tuple[Hits, Hits]]:
    rng, count = np.random.default_rng(0), len(hits.flux)
    for _ in range(SPLITS):
        order = rng.permutation(count)
        yield hits.part(order[: count // 2]), hits.part(order[count // 2 :])
