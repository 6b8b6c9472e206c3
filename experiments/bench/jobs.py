"""Grids of approaches as jobs, here and on Ray, and how long an approach takes."""

import os
import tempfile
import time
from dataclasses import asdict
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from timeit import repeat
from typing import Any

import numpy as np
import polars as pl

from agents.evaluate.play import play
from agents.jobs import Job, gather
from agents.setups import load_setup
from impact_gym.envs import IDS
from impact_gym.robot import default_approach

SEED = 30_000_000  # of the first scenario: only time is measured, so any will do
RULE, POLICY = "paper-trapezoid", "linear-blind"
CONTROLLERS = {RULE: {"baseline": RULE}, POLICY: {"shipped": POLICY}}
PER_JOB = 5000  # approaches
WHOLE = 10_000_000  # approaches of the whole grid
GROWTH = 10_000  # approaches of each row of the tables of growth
RTOLS = {"1e-4": 1e-4, "1e-6": 1e-6, "1e-8 (the default)": 1e-8, "1e-10": 1e-10, "1e-12": 1e-12}


def scenarios(count: int, first: int = 0) -> dict[str, Any]:
    """Return scenarios of the test ranges that nothing else uses."""
    return {"ranges": "test", "seed": SEED + first, "count": count}


def grid(controller: str, count: int, where: str, per_job: int = PER_JOB, **engine: Any) -> dict[str, Any]:
    """Gather so many jobs of a controller into an empty folder; return the row of what that took.

    Rates leave out the first result. The time on cores is that of this process and those that it started, which hardly
    depends on what else the machine does; Ray's workers are not among them.
    """
    arguments = [
        {"controller": CONTROLLERS[controller], "scenarios": scenarios(per_job, number * per_job)}
        for number in range(count)
    ]
    jobs = [Job("agents.evaluate.play:play", each) for each in arguments]
    with tempfile.TemporaryDirectory() as folder:
        load, begun, used = os.getloadavg()[0], time.perf_counter(), sum(os.times()[:4])
        arrivals = [time.perf_counter() - begun for _ in gather(jobs, folder, title=f"{controller}, {where}", **engine)]
        size = sum(path.stat().st_size for path in Path(folder).iterdir())
    first, last, hours = arrivals[0], arrivals[-1], (sum(os.times()[:4]) - used) / 3600.0
    each = (last - first) / (count - 1)
    return {
        "controller": controller,
        "on": where,
        "approaches": count * per_job,
        "first result, s": first,
        "all, s": last,
        "ms a job": 1e3 * each,
        "kB a result": size / count / 1e3,
        "approaches a second": per_job / each,
        f"{WHOLE:,} at that rate, min": (first + WHOLE / per_job * each) / 60.0,
        f"{WHOLE:,}, core hours": None if "cluster" in engine else hours * WHOLE / per_job / count,
        "load before": load,
    }


def growth(rounds: int) -> dict[str, pl.DataFrame]:
    """Return the time of an approach on one core, the best of so many rounds: by coupling, by robot, by tolerance."""
    constant, along = default_approach().at_impact(), default_approach().robot_table()
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
            "one mass on a spring": {"robot": {"type": "Robot", **asdict(constant)}},
            "table along the way": {"robot": {"type": "RobotTable", **asdict(along)}},
        },
        "rtol, with the default coupling": {name: {"rtol": rtol} for name, rtol in RTOLS.items()},
        "rtol, with the paper's bistable coupling": {name: {"rtol": rtol, **bistable} for name, rtol in RTOLS.items()},
    }
    tables = {}
    for what, cases in varied.items():
        plays = [partial(play, CONTROLLERS[RULE], scenarios(GROWTH), environment=case) for case in cases.values()]
        times = [min(repeat(call, timer=time.process_time, repeat=rounds, number=1)) for call in plays]
        table = pl.DataFrame({"case": list(cases), "microseconds": 1e6 * np.array(times) / GROWTH})
        default = pl.col("microseconds").filter(pl.col("case").str.ends_with("(the default)")).first()
        tables[f"An approach of {RULE} on one core, by {what}"] = table.with_columns(
            ratio=pl.col("microseconds") / default
        )
    return tables


def measure(quick: bool) -> dict[str, pl.DataFrame]:
    """Return what grids of approaches cost here and on Ray, and how the cost grows."""
    jobs, cores = 4 if quick else 80, os.cpu_count() or 1
    runs = [
        grid(name, jobs, f"{count} of {cores} cores", processes=count)
        for name in CONTROLLERS
        for count in sorted({1, cores})
    ]
    if find_spec("ray"):
        from ray.cluster_utils import Cluster

        node = {"num_cpus": cores, "object_store_memory": 200 * 2**20, "include_dashboard": False}
        ray = Cluster(initialize_head=True, head_node_args=node)  # at the latest it ends with this process
        runs.append(grid(POLICY, jobs, "Ray", cluster=ray.address))
        ray.shutdown()  # type: ignore[no-untyped-call]  # Ray's own
    return {f"Grids of approaches, {PER_JOB:,} a job": pl.DataFrame(runs), **growth(1 if quick else 3)}


def ten_million(quick: bool) -> dict[str, pl.DataFrame]:
    """Return what the whole grid takes, played."""
    count = WHOLE // PER_JOB // (20 if quick else 1)
    return {"The whole grid, played": pl.DataFrame([grid(POLICY, count, "all cores")])}
