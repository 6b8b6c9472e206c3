"""What an approach costs on one core, by coupling, by robot and by tolerance."""

import time
from dataclasses import asdict
from functools import partial
from timeit import repeat
from typing import Any

import numpy as np
import polars as pl

from agents.evaluate.play import play
from agents.setups import load_setup
from impact_gym.envs import IDS
from impact_gym.robot import IMPACT, default_approach

RULE = "paper-trapezoid"
COUNT, SEED = 10_000, 30_000_000  # of the scenarios: only time is measured, so any will do
RTOLS = {"1e-4": 1e-4, "1e-6": 1e-6, "1e-8 (the default)": 1e-8, "1e-10": 1e-10, "1e-12": 1e-12}


def measure(quick: bool) -> dict[str, pl.DataFrame]:
    """Return a table for each of these: processor time of an approach, the best of some rounds."""
    robot, along = default_approach().at(IMPACT), default_approach().robot_table()
    spring, bistable = IDS["ImpactApproach-v0"], IDS["ImpactApproachBistable-v0"]
    varied: dict[str, dict[str, dict[str, Any]]] = {
        "coupling": {
            "rigid": IDS["ImpactApproachRigid-v0"],
            "spring and damper (the default)": spring,
            "bistable, the paper's": bistable,
            "bistable, for slow touches": dict(load_setup("bistable-blind").environment),
        },
        "robot, with the default coupling": {
            "rigid (the default)": spring,
            "one mass on a spring": {"robot": {"type": "Robot", **asdict(robot)}},
            "table along the way": {"robot": {"type": "RobotTable", **asdict(along)}},
        },
        "rtol, with the default coupling": {name: {"rtol": rtol} for name, rtol in RTOLS.items()},
        "rtol, with the paper's bistable coupling": {name: {"rtol": rtol, **bistable} for name, rtol in RTOLS.items()},
    }
    rounds, count = (1, 500) if quick else (3, COUNT)
    tables, scenarios = {}, {"ranges": "test", "seed": SEED, "count": count}
    for what, cases in varied.items():
        plays = [partial(play, {"baseline": RULE}, scenarios, environment=case) for case in cases.values()]
        times = [min(repeat(call, timer=time.process_time, repeat=rounds, number=1)) for call in plays]
        table = pl.DataFrame({"case": list(cases), "microseconds": 1e6 * np.array(times) / count})
        default = pl.col("microseconds").filter(pl.col("case").str.ends_with("(the default)")).first()
        ratio = (pl.col("microseconds") / default).alias("ratio")
        tables[f"An approach of {RULE} on one core, by {what}"] = table.with_columns(ratio)
    return tables
