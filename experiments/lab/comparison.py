"""Ours against theirs on the same cases: the difference, the ratio and the reduction, each with its interval."""

from dataclasses import dataclass
from typing import Self

from experiments.lab.statistics import Estimate, Floats, Resamples, along, estimate

Front = tuple[Floats, Floats]
"""Mean approach time (s) and V_p (m/s) at each weight, in the sample and in each resample: (1 + n, weights) each."""


@dataclass(frozen=True)
class Comparison:
    """A number of ours and of theirs, less is better, in the sample and in each of the same resamples: (1 + n,) each.

    As both are resampled alike, what they share cancels.
    """

    ours: Floats
    theirs: Floats

    @classmethod
    def of_means(cls, ours: Floats, theirs: Floats) -> Self:
        """Compare the means of values (cases,) or (seeds, cases) on the same cases."""
        resamples = Resamples(ours.shape[-1])
        return cls(resamples.means(ours), resamples.means(theirs))

    @classmethod
    def of_fronts(cls, ours: Front, theirs: Front) -> Self:
        """Compare V_p (m/s) at the mean approach time of theirs, a single point, where the front of ours is read."""
        (time,), (velocity,) = theirs[0].T, theirs[1].T
        return cls(along(*ours, time), velocity)

    @property
    def less(self) -> Estimate:
        """By how much ours is below theirs, in their unit."""
        return estimate(self.theirs - self.ours)

    @property
    def ratio(self) -> Estimate:
        """Ours over theirs."""
        return estimate(self.ours / self.theirs)

    @property
    def reduction(self) -> Estimate:
        """By which share ours is below theirs."""
        return estimate(1.0 - self.ours / self.theirs)
