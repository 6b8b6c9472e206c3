"""What shipped answers do in worlds that they were not made for: friction, fixed damping, an end of the spring, delay.

Outcome is not V_p alone: how far the object slides, how often it is touched, and when tool and object are at rest, the
clock of somebody who has to fetch the object.
"""

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agents.baselines import PaperTrapezoid, load_baseline
from agents.evaluate import ScenarioBatch
from agents.jobs import Result
from agents.policies import load_policy
from agents.setups import load_setup
from experiments.lab.statistics import Resamples, estimate
from experiments.lab.tables import Gather, Row, result_of, solver_and

ANSWERS = ("linear-blind", "linear-robust", "linear-ranged", "bistable-blind")
RULE = "paper's rule"
STROKE = 0.02  # m
WORLDS: Mapping[str, Mapping[str, Any]] = {
    "as trained": {},
    **{f"friction {mu:g}": {"friction": mu} for mu in (0.1, 0.3, 0.5)},
    "restitution holds at 0.2 m/s": {"dissipation": "fixed", "reference_velocity": 0.2},
    f"stroke {1e3 * STROKE:g} mm": {"coupling": STROKE},
    **{f"sensed {1e3 * delay:g} ms late": {"reaction_delay": delay} for delay in (0.05, 0.1, 0.2)},
}
MEASURES = {
    "object_velocity": "V_p (m/s)", "approach_time": "T (s)", "slide": "slides (cm)", "contact_count": "contacts",
    "rest_time": "all at rest (s)",
}  # fmt: skip


def played(setup: str, world: str, contestant: str, count: int) -> Result:
    """Return what comes of the first test scenarios, a row each."""
    made = load_setup(setup)
    weight, environment = made.evaluation.typical, {**made.environment, **WORLDS[world]}
    if "coupling" in WORLDS[world]:
        environment["coupling"] = {**made.environment["coupling"], "stroke": STROKE}
    controller: Any = load_policy(setup)
    if contestant != "policy":
        rule: Any = PaperTrapezoid() if contestant == RULE else load_baseline(made.against[0], weight)
        controller = rule.for_environment(environment)
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # of a stroke that is meant to be short
        stage = ScenarioBatch.of("test", count, time_weight=[weight], threads=1, quiet=True, **environment)
        episodes = stage.play(controller)
    asked = {"setup": setup, "world": world, "contestant": contestant, "missed": 0}
    columns = {name: getattr(episodes, name) for name in ("missed", *MEASURES)}
    columns = {name: np.full(count, np.nan) if values is None else values for name, values in columns.items()}
    numbers = zip(*(values.tolist() for values in columns.values()), strict=True)
    return result_of([asked | dict(zip(columns, row, strict=True)) for row in numbers])


def rows(gather: Gather, count: int) -> list[Row]:
    """Return a row for each scenario of each answer in each world."""
    jobs = [
        {"setup": setup, "world": world, "contestant": contestant, "count": count}
        for setup in ANSWERS
        for world in WORLDS
        for contestant in (RULE, "profile", "policy")
        if "coupling" not in WORLDS[world] or setup.startswith("linear")  # a mechanism has its stops
    ]
    return gather("worlds", played, jobs, solver_and("experiments.gain", "agents"))


def table(found: Sequence[Row]) -> list[dict[str, Any]]:
    """Return for each answer in each world the means of the measures with intervals, and how many objects it missed."""
    lines = []
    for setup, world, contestant in dict.fromkeys((row["setup"], row["world"], row["contestant"]) for row in found):
        mine = [row for row in found if (row["setup"], row["world"], row["contestant"]) == (setup, world, contestant)]
        line: dict[str, Any] = {"setup": setup, "world": world, "contestant": contestant}
        line["missed"] = sum(row["missed"] for row in mine)
        for name in MEASURES:
            values = np.array([row[name] for row in mine]) * (100.0 if name == "slide" else 1.0)
            known = bool(np.isfinite(values).all())
            line[name] = estimate(Resamples(len(values)).means(values)) if known else None
        lines.append(line)
    return lines
