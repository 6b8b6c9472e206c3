"""Approaches: one beside SciPy's solvers, what simpler models save, what couplings, robots and tolerances cost."""

import time
from dataclasses import asdict
from functools import partial
from timeit import repeat
from typing import Any

import numpy as np
import polars as pl
from tqdm import tqdm

from agents.evaluate.play import play
from agents.setups import load_setup
from experiments import reference
from experiments.paper.scenes import DURATION, MOTION, decoupled
from experiments.solver.approaches import Approach, storm
from experiments.solver.solutions import solve
from experiments.solver.timing import FINE, Settings, cheapest, settings, timed
from impact_gym.envs import IDS
from impact_gym.fidelity import ROUNDS, advise
from impact_gym.robot import IMPACT, default_approach

TOLERANCE = 0.05  # relative error of V_p allowed


def models(quick: bool) -> dict[str, pl.DataFrame]:
    """Ask for advice on scenes of the storm one by one; return a row for each model tried, and what advice saves."""
    scenes, tried = 30 if quick else 300, []
    for number in tqdm(range(scenes), desc="models"):
        approach = storm(number)
        advice = advise(approach.scene, approach.motion, TOLERANCE, duration=approach.duration)
        tried += [(model.name, model.bound, model.time_saved, model is advice.model) for model in advice.tried[1:]]
    found = pl.DataFrame(tried, ["model", "error", "saved", "advised"], orient="row")
    error, saved = pl.col("error"), pl.col("saved").median().alias("median share of time saved")
    count, within = pl.len().alias("scenes"), (error <= TOLERANCE).sum().alias("within")
    middle, largest = error.median().alias("median error"), error.max().alias("largest error")
    by_model = found.group_by("model").agg(count, within, middle, largest, saved).sort("model")
    advised = found.filter("advised").select(pl.len().alias("scenes that need no more"), saved)
    return {
        f"Simpler models, V_p within {TOLERANCE:.0%}, best of {ROUNDS} runs": by_model,
        f"What advice on each of the {scenes} scenes of the storm saves": advised,
    }


SCENE = Approach("Fig. 17b", "", decoupled(1e4, 1.0, 150.0), MOTION, DURATION)
OF_SCIPY = [float(f"1e-{k}") for k in range(2, 9)]
AMONG_SCIPY = settings(OF_SCIPY, OF_SCIPY, steps=())


def compared(approach: Approach, error: float, tried: Settings, rounds: int) -> pl.DataFrame:
    """Return the fastest setting of each solver that keeps `error` (m/s in V_p), timed in turns, ours first."""
    truth = solve(approach, reference.simulate, rtol=1e-13)
    rows = pl.DataFrame(timed(approach, truth, tried, rounds))
    fastest = [cheapest(rows, [name], error) for name in dict.fromkeys(name for name, _ in tried)]
    took = pl.col("microseconds")
    return pl.DataFrame([row for row in fastest if row]).select(
        pl.col("contender").alias("solver"),
        pl.col("setting").alias("rtol or step, s"),
        (1e6 * pl.col("velocity_error")).alias("error in V_p, µm/s"),
        took,
        (took / took.first()).alias("times ours"),
    )


def solvers(quick: bool) -> dict[str, pl.DataFrame]:
    """Return a row for each solver that comes near enough."""
    title = f"One whole approach, {SCENE.name}, V_p within {FINE:g} m/s"
    return {title: compared(SCENE, FINE, AMONG_SCIPY, 1 if quick else 5)}


RULE = "paper-trapezoid"
COUNT, SEED = 10_000, 30_000_000  # of the scenarios: only time is measured, so any will do
RTOLS = {"1e-4": 1e-4, "1e-6": 1e-6, "1e-8 (the default)": 1e-8, "1e-10": 1e-10, "1e-12": 1e-12}


def cost(quick: bool) -> dict[str, pl.DataFrame]:
    """Return a table for each of these: processor time of an approach, the best of some rounds."""
    robot = default_approach().at(IMPACT)
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
