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
REPEATS = 5  # equal hits that tell a spread
SPLITS = 200
LOG = {"time", "force"}  # what a log of one blow has


@dataclass(frozen=True)
class Hits:
    """One set of hits."""

    name: str
    flux: Array  # m/s, (n,)
    distance: Array  # m, (n,)
    repeat: list[str]  # what is equal for hits that were meant to be equal
    left_out: int  # rows that are no hit


def read(
    path: Path, distance: str, flux: str, by: Sequence[str], repeat: Sequence[str], at_least: Mapping[str, float]
) -> list[Hits]:
    """Return the sets of a CSV file: hits with the same values in the columns `by`.

    A row whose numbers are none, or below what they must be `at_least`, is left out and counted.

    Raises:
        ValueError: the file has not these columns, or too few hits; names it and what it has.
    """
    rows = parsed(path, "CSV", lambda text: list(csv.DictReader(text.splitlines())))
    names = list(rows[0]) if rows else []
    missing = [name for name in (distance, flux, *by, *repeat, *at_least) if name not in names]
    if missing and {*names} >= LOG:
        raise ValueError(f"{path} is the log of one blow, not a table of hits: impact-gym identify {path}")
    if missing:
        raise ValueError(f"{path} has no column {missing[0]!r}, there are {names}")
    sets: dict[str, list[Mapping[str, str]]] = {}
    for row in rows:
        sets.setdefault(" ".join([path.stem, *(f"{name} {row[name]}" for name in by)]), []).append(row)
    made = [_hits(name, each, distance, flux, repeat, at_least) for name, each in sets.items()]
    kept = [hits for hits in made if len(hits.flux) >= FEWEST]
    if not kept:
        raise ValueError(f"{path} has sets of {[len(hits.flux) for hits in made]} hits, {FEWEST} or more are needed")
    return kept


def _hits(
    name: str,
    rows: Sequence[Mapping[str, str]],
    distance: str,
    flux: str,
    repeat: Sequence[str],
    at_least: Mapping[str, float],
) -> Hits:
    """Return the hits of some rows."""
    kept = []
    for row in rows:
        numbers = {column: _number(row[column]) for column in {distance, flux, *at_least}}
        least = {distance: 0.0, flux: 0.0} | dict(at_least)
        if all(np.isfinite(value) and value > least[column] for column, value in numbers.items()):
            kept.append((numbers[flux], numbers[distance], " ".join(row[column] for column in repeat)))
    fluxes, distances = (np.array([each[k] for each in kept], dtype=np.float64) for k in (0, 1))
    return Hits(name, fluxes, distances, [str(each[2]) for each in kept], len(rows) - len(kept))


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


Predict = Callable[[Array], Array]


def blow(flux: Array, distance: Array) -> Predict:
    """Fit (1 + e)^2 / (2 mu g), s^2/m, as the median of what each hit says."""
    number = number_of(flux, distance)
    return lambda other: number * other**2


def number_of(flux: Array, distance: Array) -> float:
    """Return that number."""
    return float(np.median(distance / flux**2))


def power(flux: Array, distance: Array) -> Predict:
    """Fit any power of the flux."""
    exponent, start = np.polyfit(np.log(flux), np.log(distance), 1)
    return lambda other: np.asarray(np.exp(start) * other**exponent)


def line(flux: Array, distance: Array) -> Predict:
    """Fit a straight line."""
    slope, start = np.polyfit(flux, distance, 1)
    return lambda other: np.asarray(slope * other + start)


def always(flux: Array, distance: Array) -> Predict:
    """Fit the median."""
    middle = float(np.median(distance))
    return lambda other: np.full_like(other, middle)


MODELS: Mapping[str, Callable[[Array, Array], Predict]] = {
    "blow and friction, one number": blow, "any power of the flux, two": power, "straight line, two": line,
    "always the same, one": always,
}  # fmt: skip
BLOW = next(iter(MODELS))


def errors(hits: Hits, fit: Callable[[Array, Array], Predict], other: Hits | None = None) -> tuple[float, float, float]:
    """Return median and 95 % relative error on hits that nothing was fitted on, and how many its interval holds.

    With `other` these are all of its hits, else the other half, over random halves.
    """
    off, held = list[Array](), list[float]()
    for one, two in _halves(hits, other):
        predict = fit(*one)
        spread = np.quantile(one[1] / predict(one[0]), [0.025, 0.975])
        off.append(np.abs(predict(two[0]) / two[1] - 1.0))
        share = two[1] / predict(two[0])
        held.append(float(np.mean((spread[0] <= share) & (share <= spread[1]))))
    together = np.concatenate(off)
    return float(np.median(together)), float(np.quantile(together, 0.95)), float(np.mean(held))


def _halves(hits: Hits, other: Hits | None) -> Iterator[tuple[tuple[Array, Array], tuple[Array, Array]]]:
    if other is not None:
        yield (hits.flux, hits.distance), (other.flux, other.distance)
        return
    rng, count = np.random.default_rng(0), len(hits.flux)
    for _ in range(SPLITS):
        order = rng.permutation(count)
        one, two = order[: count // 2], order[count // 2 :]
        yield (hits.flux[one], hits.distance[one]), (hits.flux[two], hits.distance[two])


def spread(hits: Hits) -> tuple[float, float, int]:
    """Return median and 95 % of how far a hit is from the median of those meant to be equal, and of how many hits.

    Nan where there are no repeats.
    """
    off: list[float] = []
    for name in dict.fromkeys(hits.repeat):
        mine = hits.distance[[each == name for each in hits.repeat]]
        if name and len(mine) >= REPEATS:
            off += [abs(float(np.median(np.delete(mine, k))) / mine[k] - 1.0) for k in range(len(mine))]
    if not off:
        return np.nan, np.nan, 0
    return float(np.median(off)), float(np.quantile(off, 0.95)), len(off)
