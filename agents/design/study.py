"""The jobs of a study of designs: what is searched, what is chosen by validation, what is played on the test set."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from agents.baselines.tuned import RULES, read_tuned
from agents.design.free import Free, as_built, designed, own
from agents.design.limits import Limits
from agents.design.search import PENALTY
from agents.design.told import fixed
from agents.evaluate import TUNING_SEED, Stage
from agents.jobs import Job, Result, digest_of, gather_all
from agents.policies import load_policy
from agents.setups import Setup
from impact_gym.envs.task import Task
from impact_gym.scene import Bistable

SEARCHED = (
    "impact_gym", "agents.baselines", "agents.evaluate", "agents.setups",
    *(f"agents.design.{name}" for name in ("free", "limits", "pads", "search")),
)  # fmt: skip
"""Sources that what a search finds depends on."""
PAPERS_RULE = {"rule": "ConstantSpeed", "parameters": [1.0, 8.0, 8.0]}  # paper, section 3.2
VALIDATION, TEST = ["validation", None], ["test", None]
MARGIN = 1.2
"""By so many times the tolerance is a design off in a search. A search looks at few scenarios: what holds its tool by a
hair in all of them lets it go in others."""
STARTS = {("BlindProfile", False): "blind-profile", ("BlindProfile", True): "bistable-blind-profile"}
"""What the search of a controller begins with, by its rule and whether there is a mechanism; otherwise "ranged"."""


@dataclass(frozen=True)
class Study:
    """What is asked for, checked."""

    setup: Setup
    free: Sequence[Free]
    searched: Mapping[str, Any]  # the set-up's environment, with a range for each free number
    times: Sequence[float]  # approach times, as shares of that of the paper's rule
    limits: Limits
    pad: str
    tolerance: float  # share by which each number of a design may be off
    scenarios: int
    budget: int
    population: int
    seeds: int
    folder: Path
    processes: int
    others: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # environments to compare with, by name
    inner: str = ""  # policy that chooses the designs

    @property
    def rule(self) -> str:
        """Which controller the set-up's observation allows."""
        return "BlindProfile" if Task(**self.setup.environment).range_noise is None else "Ranged"

    def limits_of(self, line: str) -> list[float | None]:
        """Return what a line of the study must keep to: what is only compared with has no limits."""
        return list(self.limits) if line in ("designs", "chosen") else [None] * len(self.limits)


@dataclass(frozen=True)
class Entry:
    """One design with one controller, and what came of it on the test set."""

    line: str  # "paper's rule", "designs", "chosen", or a name of `Study.others`
    share: float  # of the paper's approach time that was allowed
    design: Mapping[str, float]  # what differs from the environment
    rule: str
    parameters: Sequence[float]
    environment: Mapping[str, Any]
    pad: str = ""
    seed: int = 0
    train: float = np.nan  # m/s, V_p on the scenarios of the search, and what limits that were exceeded cost
    played: Mapping[str, Any] = field(default_factory=dict)  # arrays (scenarios,)


def run(study: Study) -> list[Entry]:
    """Search, choose and play; the paper's rule with the paper's spring is the first entry.

    For each approach time the design is the best of its seeds on the validation set; that at the paper's own time is
    chosen, and its controller searched for the other times. Nothing is chosen by the test set.
    """
    time = papers_time(study)
    picked = _picked(study, time) if study.inner else {}
    asked = [("designs", study.searched, study.free, share, seed) for share in study.times for seed in seeds(study)]
    if picked:
        asked = [("designs", built(study, design), (), share, 1) for share, design in picked.items()]
    asked += [(line, environment, (), share, 1) for line, environment in study.others.items() for share in study.times]
    found = _searched(study, asked, time, "designs and controllers")
    found = [replace(one, design=picked[one.share]) if picked and one.line == "designs" else one for one in found]
    designs = [_best(study, [one for one in found if one.share == share]) for share in study.times]
    chosen = min(designs, key=lambda one: abs(one.share - 1.0))
    made = built(study, chosen.design)
    asked = [("chosen", made, (), share, 1) for share in study.times if share != chosen.share]
    more = _searched(study, asked, time, "controllers of the chosen design", chosen.parameters)
    curve = [chosen, *more]
    curve = [replace(one, line="chosen", environment=made, design=chosen.design) for one in curve]
    rest = [one for one in found if one.line != "designs"]
    return played(study, [papers(study), *designs, *sorted(curve, key=lambda one: one.share), *rest], TEST)


def built(study: Study, design: Mapping[str, float]) -> dict[str, Any]:
    """Return the environment of a design as a search meets it, each number off by a share in each episode."""
    return designed(study.setup.environment, as_built(design, MARGIN * study.tolerance))


def _picked(study: Study, paper: float) -> dict[float, dict[str, float]]:
    """Return what the policy does best with at each share of the `paper`'s approach time (s)."""
    policy, names = load_policy(study.inner), [one.name for one in study.free]
    weights = hashlib.sha256(b"".join(layer.weight.tobytes() for layer in policy.network.layers())).hexdigest()
    depends = digest_of(*SEARCHED, "agents.design.told") + weights
    jobs = [
        Job("agents.design.told:best", {
            "policy": study.inner, "free": [list(one) for one in study.free], "start": fixed(policy, study.setup),
            "approach_time": share * paper, "limits": list(study.limits), "scenarios": study.scenarios, "seed": 1,
        }, depends)
        for share in study.times
    ]  # fmt: skip
    results = gather_all(jobs, study.folder / "kept", processes=study.processes, title="designs for the policy")
    designs = [dict(zip(names, result["design"].tolist(), strict=True)) for result in results]
    return dict(zip(study.times, designs, strict=True))


def seeds(study: Study) -> range:
    """Return the seeds of the searches for a design."""
    return range(1, study.seeds + 1)


def papers_time(study: Study) -> float:
    """Return the mean approach time (s) of the paper's rule with the paper's spring, where searches look."""
    environment = with_papers_spring(study.setup.environment)
    options = {"scenario": "train", "threads": 1, **environment}
    rule = RULES[PAPERS_RULE["rule"]].of(PAPERS_RULE["parameters"]).for_environment(environment)
    return float(Stage(TUNING_SEED, study.scenarios, **options).play(rule).approach_time.mean())


def with_papers_spring(environment: Mapping[str, Any]) -> dict[str, Any]:
    """Return an environment's arguments with the coupling that it has unless it is told another: the paper's spring."""
    return {name: value for name, value in environment.items() if name != "coupling"}


def papers(study: Study) -> Entry:
    """Return the paper's rule with the paper's spring in the set-up's environment."""
    return Entry("paper's rule", 1.0, {}, **PAPERS_RULE, environment=with_papers_spring(study.setup.environment))


def start_of(rule: str, environment: Mapping[str, Any], approach_time: float) -> list[float]:
    """Return the parameters of the shipped controller of this rule whose approach takes most nearly so long (s)."""
    bistable = isinstance(Task(**environment).coupling, Bistable)
    weights = read_tuned(STARTS.get((rule, bistable), "ranged"))["weights"].values()
    nearest = min(weights, key=lambda found: abs(found["validation"]["approach_time"] - approach_time))
    return list(nearest["parameters"].values())


def _searched(
    study: Study, asked: Sequence[tuple[Any, ...]], paper: float, title: str, start: Sequence[float] | None = None
) -> list[Entry]:
    """Return what searches find, of line, environment, free numbers, share of the `paper`'s time (s), and seed each.

    Controllers begin with `start`, or else with a shipped one.
    """
    depends, jobs = digest_of(*SEARCHED), []
    for line, environment, free, share, seed in asked:
        pad = study.pad if line in ("designs", "chosen") else ""
        arguments = {
            "environment": dict(environment),
            "free": [list(one) for one in free],
            "start": own(study.setup, free),
            "rule": study.rule,
            "rule_start": list(start or start_of(study.rule, environment, share * paper)),
            "approach_time": share * paper,
            "limits": study.limits_of(line),
            "pad": pad,
            "tolerance": MARGIN * study.tolerance,
            "scenarios": study.scenarios,
            "budget": study.budget,
            "population": study.population,
            "seed": seed,
        }
        arguments["journal"] = str(study.folder / "journal" / f"{_name(arguments, depends)}.jsonl")
        jobs.append(Job("agents.design.search:search_one", arguments, depends))
    results = gather_all(jobs, study.folder / "kept", processes=study.processes, title=title)
    return [
        Entry(
            line, share, dict(zip([one.name for one in free], result["design"].tolist(), strict=True)), study.rule,
            result["parameters"].tolist(), dict(environment), study.pad if line in ("designs", "chosen") else "",
            seed, result["loss"].item(),
        )
        for (line, environment, free, share, seed), result in zip(asked, results, strict=True)
    ]  # fmt: skip


def _name(arguments: Mapping[str, Any], depends: str) -> str:
    """Return a name of what is searched for."""
    return hashlib.sha256(json.dumps([arguments, depends], sort_keys=True).encode()).hexdigest()[:24]


def played(study: Study, entries: Sequence[Entry], scenarios: Sequence[Any]) -> list[Entry]:
    """Return the entries with what they do on a frozen set."""
    depends = digest_of(*SEARCHED)
    jobs = [
        Job("agents.design.search:play_one", {
            "environment": dict(one.environment), "design": dict(one.design), "rule": one.rule,
            "parameters": list(one.parameters), "pad": one.pad, "tolerance": study.tolerance,
            "scenarios": list(scenarios), "limits": study.limits_of(one.line),
        }, depends)
        for one in entries
    ]  # fmt: skip
    results: list[Result] = gather_all(jobs, study.folder / "kept", processes=study.processes, title="playing")
    return [replace(one, played=result) for one, result in zip(entries, results, strict=True)]


def _best(study: Study, found: Sequence[Entry]) -> Entry:
    """Return what leaves the object slowest on the validation set; limits and a later approach count as in a search."""
    designs = [one for one in found if one.line == "designs"]
    if len(designs) == 1:
        return designs[0]
    paper, *validated = played(study, [papers(study), *designs], VALIDATION)

    def cost(one: Entry) -> float:
        late = one.played["approach_time"].mean() / (one.share * paper.played["approach_time"].mean()) - 1.0
        return one.played["object_velocity"].mean() + PENALTY * (max(late, 0.0) + one.played["excess"].item())

    return min(validated, key=cost)


def lines(entries: Sequence[Entry]) -> Iterator[str]:
    """Yield a sentence for each entry, what it does on the test set."""
    paper = entries[0].played
    yield f"the paper's rule: V_p {paper['object_velocity'].mean():.4f} m/s at {paper['approach_time'].mean():.4f} s"
    for one in entries[1:]:
        velocity, time = (one.played[name].mean() for name in ("object_velocity", "approach_time"))
        numbers = ", ".join(f"{name} {value:.4g}" for name, value in one.design.items())
        lower = 1.0 - velocity / paper["object_velocity"].mean()
        deflection, stroke = (1e3 * one.played[name].max() for name in ("deflection", "stroke"))
        yield (
            f"{one.line} at {one.share:g}: V_p {velocity:.4f} m/s, {lower:.1%} less, at {time:.4f} s; deflection "
            f"{deflection:.1f} mm, stroke {stroke:.1f} mm, a second blow in "
            f"{(one.played['contact_count'] > 1).mean():.1%}, missed {int(one.played['missed'].sum())}"
            + (f"; BEYOND ITS LIMITS by {excess:.2g}" if (excess := one.played["excess"].item()) else "")
            + (f"; {numbers}" if numbers else "")
        )
