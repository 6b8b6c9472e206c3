"""Least squares from one point, and from several that race each other to the minima."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from impact_gym.identify.coordinates import RESTITUTION
from impact_gym.identify.model import Model

Array = NDArray[np.float64]

HEAT, HEATS = 8, 5  # evaluations after which the starts are compared, and how often that is done
SLOW = 0.8  # of what a fit is behind the best one, still left after a heat, from which it is given up
ALIKE = 20.0  # of the misfit, by which a rough minimum may be above the best one to be looked at again
SAME = 0.03  # of the coordinate of any free number, by which minima are apart
INSIDE = 4.0  # of ln(e/(1-e)), from where a fit may begin: e from 0.02 to 0.98
TOLERANCE, ROUGH = 1e-8, 1e-5  # -, of misfit and x, relative: of the best fit, and of those on the way to an end


class Point(NamedTuple):
    """Where least squares have come to."""

    misfit: float  # sum of squared residuals over the noise
    x: Array
    is_minimum: bool = True  # False: evaluations ran out on the way to one


def descended(
    model: Model, x: Array, fixed: int | None = None, tolerance: float = TOLERANCE, evaluations: int = HEAT * HEATS
) -> Point:
    """Return where least squares come to from x, with x[fixed] held, within so many evaluations."""
    free = np.delete(np.arange(model.size), [] if fixed is None else [fixed])
    x = x.copy()
    for i, one in enumerate(model.free):  # at the end of what a restitution may be nothing would move it
        if one.name == RESTITUTION and i != fixed:
            x[i] = min(max(x[i], -INSIDE), INSIDE)

    def put(part: Array) -> Array:
        whole = x.copy()
        whole[free] = part
        return whole

    found = least_squares(
        lambda part: model.residuals(put(part)),
        x[free],
        jac=lambda part: model.jacobian(put(part), but=fixed)[:, free],
        method="lm",
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=evaluations,
    )
    at = put(found.x)
    for i, one in enumerate(model.free):
        at[i] = min(max(at[i], one.reach[0]), one.reach[1])
    return Point(2.0 * float(found.cost), at, found.status > 0)


def raced(model: Model, starts: Sequence[Array]) -> list[Point]:
    """Return the distinct minima that rough fits from `starts` come to, the best first.

    After each heat the fits are compared. Of those that have met the best goes on; one that is clearly worse than the
    best of all, and has hardly come closer in this heat, is given up.
    """
    reached = [Point(math.inf, x, is_minimum=False) for x in starts]
    for _ in range(HEATS):
        before = [one.misfit for one in reached]
        reached = [one if one.is_minimum else descended(model, one.x, None, ROUGH, HEAT) for one in reached]
        least = min((one.misfit for one in reached), default=math.inf)
        good = {id(one) for one in as_good(model, reached)}
        reached = distinct(model, [
            one for one, was in zip(reached, before, strict=True)
            if one.is_minimum or id(one) in good or one.misfit - least < SLOW * (was - least)
        ])  # fmt: skip
    return reached


def as_good(model: Model, found: Sequence[Point]) -> list[Point]:
    """Return those points that may lead to the best minimum, or to one as good."""
    least = min((one.misfit for one in found), default=math.inf)
    return [one for one in found if one.misfit < least + ALIKE * (1.0 + least / model.samples)]


def distinct(model: Model, found: Sequence[Point]) -> list[Point]:
    """Return the points at which the free numbers are not the same, the best first."""
    kept: list[Point] = []
    for one in sorted(found, key=lambda one: one.misfit):
        if all(np.abs(one.x - other.x)[: len(model.free)].max() > SAME for other in kept):
            kept.append(one)
    return kept
