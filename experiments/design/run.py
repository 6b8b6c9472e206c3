"""Searches, choice by validation and play on the test set, of a study of designs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.baselines.tuned import read_tuned
from agents.evaluate import TUNING_SEED, ScenarioBatch
from agents.jobs import Job, Result, digest_of, gather_all
from experiments.design.search import PENALTY, Rig, play, search
from experiments.design.study import CHOSEN, FRONT, GRID, PAPER, SEEDS, Study, with_papers_spring
from experiments.lab.results import KEPT
from impact_gym.scene import Bistable
from impact_gym.task import Task

DEPENDS = (
    "impact_gym", "agents.baselines", "agents.evaluate", "agents.setups",
    *(f"experiments.design.{name}" for name in ("free", "limits", "pads", "search")),
)  # fmt: skip
"""Sources that the result of a search depends on."""
PAPERS_RULE = "ConstantSpeed", [1.0, 8.0, 8.0]  # paper, section 3.2
STARTS = {("BlindProfile", False): "blind-profile", ("BlindProfile", True): "bistable-blind-profile"}
"""Tuned baseline whose parameters begin a search, by its rule and whether there is a mechanism; otherwise "ranged"."""


@dataclass(frozen=True)
class Entry:
    """One rig of a study; a search fills in design, parameters and loss, playing the results."""

    line: str  # PAPER, FRONT, CHOSEN, SEEDS, GRID, or a name of `Study.others`
    allowed: float  # approach time, over that of the paper's rule
    rig: Rig
    seed: int = 1
    loss: float = np.nan  # m/s, V_p on the scenarios of the search, with the penalty for exceeded limits
    results: Mapping[str, NDArray[Any]] = field(default_factory=dict)  # (scenarios,), see `search.play`

    def mean(self, name: str) -> float:
        """Return the mean of a result over the scenarios."""
        return float(self.results[name].mean())


def run(study: Study) -> list[Entry]:
    """Search, choose and play; the paper's rule with the paper's spring is the first entry.

    For each approach time the design is the best of its seeds on the validation set. The one at the paper's own time is
    chosen, and its controller searched for the other times. Nothing is chosen by the test set.
    """
    padded = partial(Rig, rule=study.rule, pad=study.pad)
    seeds = range(1, study.seeds + 1)
    joint = [Entry(FRONT, allowed, padded(study.searched), seed) for allowed in study.times for seed in seeds]
    others = [
        Entry(name, allowed, Rig(environment, study.rule))
        for name, environment in study.others.items()
        for allowed in study.times
    ]
    paper = Entry(PAPER, 1.0, Rig(with_papers_spring(study.arm.environment), *PAPERS_RULE))
    time = mean_time(paper.rig, study.effort.scenarios)
    entries = searched(study, [*joint, *others], time, "designs and controllers")
    joint, others = entries[: len(joint)], entries[len(joint) :]
    validation, *rivals = played(study, [paper, *joint], "validation")
    by_time = [[entry for entry in rivals if entry.allowed == allowed] for allowed in study.times]
    front = [best(entries, validation) for entries in by_time]
    chosen = next(entry for entry in front if entry.allowed == study.typical)
    built = padded(study.built(chosen.rig.design))
    later = [Entry(CHOSEN, allowed, built) for allowed in study.times if allowed != study.typical]
    curve = [chosen, *searched(study, later, time, "controllers of the chosen design", chosen.rig.parameters)]
    final = partial(replace, environment=built.environment, design=chosen.rig.design)
    curve = [replace(entry, line=CHOSEN, rig=final(entry.rig)) for entry in curve]
    curve.sort(key=lambda entry: entry.allowed)
    optimum = []
    if study.grid:
        designs = list(study.designs_of_grid())
        grid = [Entry(GRID, study.typical, padded(study.built(design))) for design in designs]
        grid = searched(study, grid, time, "controllers of the grid")
        optimum = [replace(entry, line=SEEDS) for entry in joint if entry.allowed == study.typical]
        optimum += [replace(one, rig=replace(one.rig, design=each)) for one, each in zip(grid, designs, strict=True)]
    return played(study, [paper, *front, *curve, *others, *optimum], "test")


def mean_time(rig: Rig, scenarios: int) -> float:
    """Return the mean approach time (s) of a rig on the scenarios of a search."""
    batch = ScenarioBatch(TUNING_SEED, scenarios, **{"scenario": "train", "threads": 1, **rig.environment})
    return float(batch.play(rig.controller).approach_time.mean())


def start_of(rig: Rig, approach_time: float) -> list[float]:
    """Return the parameters of the shipped controller of the rig's rule whose approach time (s) is nearest."""
    bistable = isinstance(Task(**rig.environment).coupling, Bistable)
    weights = read_tuned(STARTS.get((rig.rule, bistable), "ranged"))["weights"].values()
    nearest = min(weights, key=lambda tuned: abs(tuned["validation"]["approach_time"] - approach_time))
    return list(nearest["parameters"].values())


def searched(
    study: Study, entries: Sequence[Entry], paper: float, title: str, start: Sequence[float] = ()
) -> list[Entry]:
    """Return the entries as searches find them; allowed times are multiples of the `paper`'s time (s).

    On the line FRONT the design is searched, elsewhere the controller alone. Controllers begin with `start`, or else
    with a shipped one.
    """
    asked, free = [], [study.numbers if entry.line == FRONT else [] for entry in entries]
    for entry, numbers in zip(entries, free, strict=True):
        time = entry.allowed * paper
        begin = replace(entry.rig, parameters=list(start or start_of(entry.rig, time)))
        how = {"limits": asdict(study.limits_of(entry.line)), "effort": asdict(study.effort), "seed": entry.seed}
        asked.append({"rig": asdict(begin), "free": list(map(list, numbers)), "approach_time": time} | how)
    ends = []
    for entry, numbers, result in zip(entries, free, _results(study, search, asked, title), strict=True):
        design = dict(zip((number.name for number in numbers), result["design"].tolist(), strict=True))
        rig = replace(entry.rig, design=design, parameters=result["parameters"].tolist())
        ends.append(replace(entry, rig=rig, loss=result["loss"].item()))
    return ends


def played(study: Study, entries: Sequence[Entry], name: str) -> list[Entry]:
    """Return the entries with their results on the frozen set of this name."""
    with_limits = ((asdict(entry.rig), asdict(study.limits_of(entry.line))) for entry in entries)
    how = {"tolerance": study.effort.tolerance, "name": name}
    results = _results(study, play, [{"rig": rig, "limits": limits} | how for rig, limits in with_limits], "playing")
    return [replace(entry, results=result) for entry, result in zip(entries, results, strict=True)]


def _results(study: Study, work: Callable[..., Result], asked: Sequence[Mapping[str, Any]], title: str) -> list[Result]:
    """Return what a function of `search` returns for each of the arguments; what was done before is kept."""
    depends = digest_of(*DEPENDS)
    jobs = [Job(f"{work.__module__}:{work.__name__}", arguments, depends) for arguments in asked]
    return gather_all(jobs, study.out / KEPT, processes=study.processes, title=title)


def best(entries: Sequence[Entry], paper: Entry) -> Entry:
    """Return what leaves the object slowest; exceeded limits and a later approach count as in a search."""

    def cost(entry: Entry) -> float:
        late = entry.mean("approach_time") / (entry.allowed * paper.mean("approach_time")) - 1.0
        return entry.mean("object_velocity") + PENALTY * (max(late, 0.0) + entry.mean("excess"))

    return min(entries, key=cost)
