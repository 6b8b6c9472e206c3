"""Grids of approaches as jobs, here and on Ray, and how long an approach takes: the figures of docs/cost.md."""

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

from agents.evaluate import RESULTS
from agents.evaluate.play import play
from agents.jobs import Job, Result, gather
from agents.setups import load_setup
from impact_gym.envs import IDS
from impact_gym.envs.scenario import FIELDS as SCENARIO
from impact_gym.robot import default_approach

SEED = 30_000_000  # of the first scenario: only time is measured, so any will do
RULE, POLICY, BLANK = "paper-trapezoid", "linear-blind", "none, blank results"
CONTROLLERS = {RULE: {"baseline": RULE}, POLICY: {"shipped": POLICY}}
PER_JOB = 5000  # approaches
WHOLE = 10_000_000  # approaches of the grid that is spoken of
BLANKS = 1000  # jobs that do nothing, for what a job costs
GROWTH = 10_000  # approaches of each row of the tables of growth
NODES, CORES = (1, 10, 100), 16  # extrapolated to, and the cores of each
RTOLS = {"1e-4": 1e-4, "1e-6": 1e-6, "1e-8 (the default)": 1e-8, "1e-10": 1e-10, "1e-12": 1e-12}


def scenarios(count: int, first: int = 0) -> dict[str, Any]:
    """Return scenarios of the test ranges that nothing else uses."""
    return {"ranges": "test", "seed": SEED + first, "count": count}


def blank(number: int) -> Result:
    """Return at once what `play` returns for a job, as to size; no two are equal."""
    filled = np.random.default_rng(number).random(PER_JOB)
    kinds = {"contact_count": np.int64, "missed": np.bool_}
    return {name: filled.astype(kinds.get(name, np.float64)) for name in (*RESULTS, *SCENARIO)}


def job(controller: str, number: int) -> Job:
    """Return one of the jobs of a grid."""
    if controller == BLANK:
        return Job(f"{__name__}:blank", {"number": number})
    played = {"controller": CONTROLLERS[controller], "scenarios": scenarios(PER_JOB, number * PER_JOB)}
    return Job("agents.evaluate.play:play", played)


def gathered(controller: str, count: int, where: str, **engine: Any) -> dict[str, Any]:
    """Gather so many jobs of a controller, or BLANK, into an empty folder; return what it took.

    Rates leave out the first result. The time on cores is that of this process and those that it started, which hardly
    depends on what else the machine does; Ray's workers are not among them.
    """
    jobs = [job(controller, number) for number in range(count)]
    with tempfile.TemporaryDirectory() as folder:
        load, begun, used = os.getloadavg()[0], time.perf_counter(), sum(os.times()[:4])
        came = [time.perf_counter() - begun for _ in gather(jobs, folder, title=f"{controller}, {where}", **engine)]
        size = sum(path.stat().st_size for path in Path(folder).iterdir())
    hours, each = (sum(os.times()[:4]) - used) / 3600.0, (came[-1] - came[0]) / (count - 1)
    return {
        "controller": controller,
        "on": where,
        "approaches": count * PER_JOB,
        "first result, s": came[0],
        "all, s": came[-1],
        "ms a job": 1e3 * each,
        "kB a result": size / count / 1e3,
        "approaches a second": PER_JOB / each,
        f"{WHOLE:,} at that rate, min": (came[0] + WHOLE / PER_JOB * each) / 60.0,
        f"{WHOLE:,}, core hours": None if "cluster" in engine else hours * WHOLE / PER_JOB / count,
        "load before": load,
    }


def ray_here() -> Any:
    """Start a Ray cluster of one node with this machine's cores; at the latest it ends with this process."""
    from ray.cluster_utils import Cluster

    node = {"num_cpus": os.cpu_count() or 1, "object_store_memory": 200 * 2**20, "include_dashboard": False}
    return Cluster(initialize_head=True, head_node_args=node)


def extrapolated(one: dict[str, Any], last: dict[str, Any], blank: dict[str, Any]) -> pl.DataFrame:
    """Return what the whole grid would take with the core hours of `one`, the start of `last`, results like `blank`."""
    start, gathering = pl.lit(last["first result, s"]), pl.lit(WHOLE / PER_JOB * blank["ms a job"] / 1e3)
    compute = 3600.0 * one[f"{WHOLE:,}, core hours"] / CORES / pl.col("nodes")
    whole = start + pl.max_horizontal(compute, gathering)
    columns = {"start, s": start, "compute, s": compute, "gathering, s": gathering, "in all, s": whole}
    return pl.DataFrame({"nodes": NODES}).with_columns(**columns)


def growth(rounds: int) -> dict[str, pl.DataFrame]:
    """Return the time of an approach on one core, the best of so many rounds: by coupling, by robot, by tolerance."""
    constant, table = default_approach().at_impact(), default_approach().robot_table()
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
            "table along the way": {"robot": {"type": "RobotTable", **asdict(table)}},
        },
        "rtol, with the default coupling": {name: {"rtol": rtol} for name, rtol in RTOLS.items()},
        "rtol, with the paper's bistable coupling": {name: {"rtol": rtol, **bistable} for name, rtol in RTOLS.items()},
    }
    tables = {}
    for what, cases in varied.items():
        plays = [partial(play, CONTROLLERS[RULE], scenarios(GROWTH), environment=case) for case in cases.values()]
        times = [min(repeat(one, timer=time.process_time, repeat=rounds, number=1)) for one in plays]
        table = pl.DataFrame({"case": list(cases), "microseconds": 1e6 * np.array(times) / GROWTH})
        default = pl.col("microseconds").filter(pl.col("case").str.ends_with("(the default)")).first()
        ratio = pl.col("microseconds") / default
        tables[f"An approach of {RULE} on one core, by {what}"] = table.with_columns(ratio=ratio)
    return tables


def measure(quick: bool) -> dict[str, pl.DataFrame]:
    """Return what grids of approaches cost here and on Ray, what follows for clusters, and how the cost grows."""
    jobs, cores = 4 if quick else 80, os.cpu_count() or 1
    here = [(name, jobs, count) for name in CONTROLLERS for count in sorted({1, cores})]
    here.append((BLANK, BLANKS, 1))
    runs = [gathered(name, many, f"{count} of {cores} cores", processes=count) for name, many, count in here]
    if find_spec("ray"):
        ray = ray_here()
        runs += [gathered(name, count, "Ray", cluster=ray.address) for name, count in ((POLICY, jobs), (BLANK, BLANKS))]
        ray.shutdown()
    one, *_, last = (run for run in runs if run["controller"] == POLICY)
    *_, blank = (run for run in runs if run["controller"] == BLANK)
    title = f"Extrapolated, not measured: {WHOLE:,} approaches of {POLICY} on nodes of {CORES} such cores"
    grids = {f"Grids of approaches, {PER_JOB:,} a job": pl.DataFrame(runs), title: extrapolated(one, last, blank)}
    return grids | growth(1 if quick else 3)


def ten_million(quick: bool) -> dict[str, pl.DataFrame]:
    """Return what the whole grid takes, played."""
    jobs = WHOLE // PER_JOB // (20 if quick else 1)
    return {"The whole grid, played": pl.DataFrame([gathered(POLICY, jobs, "all cores")])}
