"""The results of a matchup."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from agents.evaluate.scenario_batch import MEASURED, Episodes
from experiments.lab.statistics import Floats, Resamples
from experiments.report.matchups import BOUND, PAPER, Matchup
from impact_gym.task.scenario import FIELDS
from impact_gym.task.task import MISSED_COST

Arrays = Mapping[str, NDArray[Any]]
MISSED_TOO_OFTEN = 0.01  # share of missed objects above which the report claims no gain


@dataclass
class Run:
    """Results of one contestant in one matchup."""

    weights: tuple[float, ...]  # time weights, m/s per s
    arrays: Arrays  # by name: results (weights, scenarios), and fields of the scenarios (scenarios,)
    missed_cost: float = MISSED_COST  # m/s, charge for a missed object

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.arrays[name]

    def at(self, weight: float) -> Episodes:
        """Return the results at a weight (m/s per s), or at the only weight of the run."""
        if len(self.weights) > 1 and weight not in self.weights:
            raise ValueError(f"there are no results at a time weight of {weight:g} m/s per s, only at {self.weights}")
        place = self.weights.index(weight) if weight in self.weights else 0
        results = {name: self[name][place] for name in MEASURED if name in self.arrays}
        return Episodes(**results, scenario={name: self[name] for name in FIELDS}, missed_cost=self.missed_cost)

    def loss(self, weight: float) -> Floats:
        """Costs (scenarios,) in m/s: V_p + weight * approach time + cost of a miss."""
        return self.at(weight).loss(weight)

    def means(self, weight: float) -> dict[str, Any]:
        """Mean approach time T (s) and V_p (m/s) at a weight, and the number of missed objects."""
        episodes = self.at(weight)
        time, velocity = episodes.approach_time.mean(), episodes.object_velocity.mean()
        return {"T": float(time), "V": float(velocity), "missed": int(episodes.missed.sum())}

    @property
    def front(self) -> list[tuple[float, float]]:
        """Mean approach time (s) and V_p (m/s) at each weight, the shortest time first."""
        return sorted((mean["T"], mean["V"]) for mean in map(self.means, self.weights))


@dataclass
class Played:
    """All results of one matchup; the keys of the dicts are names of contestants."""

    matchup: Matchup
    seeds: dict[str, Run] = field(default_factory=dict)
    as_late: dict[str, Run] = field(default_factory=dict)  # results of seeds at about the rule's mean approach time
    baselines: dict[str, Run] = field(default_factory=dict)
    choosing: dict[str, Run] = field(default_factory=dict)  # results in the scenarios of `experiments.report.choice`
    bound: Run | None = None  # results of the clairvoyant search
    varied: list[tuple[Mapping[str, Any], pl.DataFrame]] = field(default_factory=list)  # (labels, rows) of each job
    travelled: dict[str, Run] = field(default_factory=dict)  # deflections, if the coupling is a spring

    @property
    def paper(self) -> Run:
        """The paper's rule."""
        return self.baselines[PAPER]

    @property
    def rival(self) -> Run:
        """The baseline `Matchup.rival`."""
        return self.baselines[self.matchup.rival.name]

    @property
    def policy(self) -> Run:
        """The median seed."""
        return self.seeds[self.matchup.chosen]

    @property
    def count(self) -> int:
        """Number of scenarios."""
        return self.paper["missed"].shape[1]

    @property
    def resamples(self) -> Resamples:
        """Resamples of the scenarios; they are the same for all contestants."""
        return Resamples(self.count)


def episodes(all_played: Sequence[Played]) -> pl.DataFrame:
    """Return a row for each episode of `seeds`, `as_late`, `baselines` and `bound`."""
    frames = []
    for played in all_played:
        runs = {**played.seeds, **played.baselines, **({BOUND: played.bound} if played.bound else {})}
        runs |= {f"{name} at the paper's approach time": run for name, run in played.as_late.items()}
        for name, run in runs.items():
            for place, weight in enumerate(run.weights):
                results = {field: run[field][place] for field in MEASURED if field in run.arrays}
                numbers = np.arange(len(results["missed"]), dtype=np.int32)
                about = {"matchup": played.matchup.name, "contestant": name, "time_weight": weight, "scenario": numbers}
                frames.append(pl.DataFrame({**about, **results, **{field: run[field] for field in FIELDS}}))
    return pl.concat(frames, how="diagonal")
