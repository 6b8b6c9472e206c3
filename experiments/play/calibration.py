"""How often a study finds what is not there, and what is: many studies of scripted persons, played as one batch.

`python -m experiments.play.calibration` counts both. Where nothing differs between the conditions, an analysis at alpha
must find something in a share alpha of the studies; where the second delays the operator by 0.2 s more, in most.
"""

from dataclasses import replace

import numpy as np
import polars as pl
import tyro

from agents.evaluate.scenario_batch import ScenarioBatch
from agents.setups import load_setup
from experiments.play.assistance import assistance, environment_of, record_of, usual
from experiments.play.plan import Plan
from experiments.play.report import found, traits_of

PLAN = Plan("calibration", "teleop-spring", "slide at equal done_time", 0.01,
            {"first": {"assist": "none"}, "second": {"assist": "none"}}, "", blocks=1, tries=10)  # fmt: skip
FIRST_SEED = 90_000_000


def studies(plan: Plan, count: int, persons: int, later: float, seed: int = 0) -> list[pl.DataFrame]:
    """Return the rows of `count` studies of so many scripted persons; in the second condition all is `later`, s."""
    setup, rng = load_setup(plan.setup), np.random.default_rng(seed)
    each = plan.blocks * plan.tries
    shape = count, persons, 2, each
    record: dict[str, np.ndarray] = {}
    traits = [traits_of(rng) for _ in range(count * persons)]
    for name in traits[0]:
        values = np.array([person[name] for person in traits]).reshape(count, persons, 1, 1)
        record[f"operator.{name}"] = np.broadcast_to(values, shape).ravel()
    for name, value in record_of(usual(setup)).items():
        more = 0.5 * later * np.arange(2)[:, None] if name.endswith(".delay") else 0.0
        record[name] = np.broadcast_to(value + more, shape).ravel()
    operator = {"type": "Reach", "place_error": [-1.0, 1.0], "creep": [1e-3, 0.5], "reaction": [1e-3, 2.0]}
    options = {"threads": 1, "lenient": True, "quiet": True, **environment_of(setup), "rtol": 1e-6}
    batch = ScenarioBatch(FIRST_SEED + seed * 10**6, int(np.prod(shape)), operator=operator, **options)
    played = batch.play(assistance("none", setup), record)
    done, slide = np.asarray(played.done_time).reshape(shape), np.asarray(played.slide).reshape(shape)
    where = np.indices(shape[1:]).reshape(3, -1)
    same = {"person": where[0], "condition": np.array([*plan.conditions])[where[1]]}
    return [pl.DataFrame(same | {"slide": slide[k].ravel(), "done_time": done[k].ravel()}) for k in range(count)]


def share_found(plan: Plan, count: int, persons: int, later: float, seed: int = 0) -> float:
    """Return in which share of studies something is found at the plan's alpha."""
    findings = [found(rows, plan) for rows in studies(plan, count, persons, later, seed)]
    return float(np.mean([finding is not None and finding.p < plan.alpha for finding in findings]))


def main(count: int = 1000, persons: int = 8, alpha: float = 0.05) -> None:
    """Count false alarms, and what is found of 0.2 s more.

    Args:
        count: studies.
        persons: of each.
        alpha: at which something is found.
    """
    plan = replace(PLAN, alpha=alpha)
    for later in (0.0, 0.2):
        share = share_found(plan, count, persons, later)
        error = (share * (1.0 - share) / count) ** 0.5
        found_in = f"{100 * share:.1f} +- {100 * error:.1f} % of {count} studies of {persons} persons"
        print(f"{later:g} s later: found in {found_in}")


if __name__ == "__main__":
    tyro.cli(main, prog="python -m experiments.play.calibration")
