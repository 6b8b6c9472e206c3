"""One whole approach with one contact, by us and by SciPy's solvers, each as fast as an error allows."""

import polars as pl

from experiments import reference
from experiments.paper.scenes import DURATION, MOTION, decoupled
from experiments.solver.approaches import Approach
from experiments.solver.solutions import solve
from experiments.solver.timing import FINE, Settings, cheapest, settings, timed

SCENE = Approach("Fig. 17b", "", decoupled(1e4, 1.0, 150.0), MOTION, DURATION)
RTOLS = tuple(float(f"1e-{k}") for k in range(2, 9))
AMONG_SCIPY = settings(RTOLS, RTOLS, steps=())


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


def measure(quick: bool) -> dict[str, pl.DataFrame]:
    """Return a row for each solver that comes near enough."""
    title = f"One whole approach, {SCENE.name}, V_p within {FINE:g} m/s"
    return {title: compared(SCENE, FINE, AMONG_SCIPY, 1 if quick else 5)}
