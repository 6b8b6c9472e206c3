"""One whole approach with one contact, by us, by SciPy's solvers and by MuJoCo, each as fast as an error allows."""

import polars as pl

from experiments import reference
from experiments.paper.scenes import DURATION, MOTION, decoupled
from experiments.solver.approaches import Approach
from experiments.solver.in_mujoco import fitted
from experiments.solver.solutions import solve
from experiments.solver.timing import COARSE, FINE, MUJOCO, Settings, cheapest, settings, timed

SCENE = Approach("Fig. 17b", "", decoupled(1e4, 1.0, 150.0), MOTION, DURATION)
PEER_SCENE = Approach("Fig. 19a", "", decoupled(1e5, 0.1, 150.0), MOTION, DURATION)  # near MuJoCo's own law of contact
RTOLS = tuple(float(f"1e-{k}") for k in range(2, 9))
AMONG_SCIPY = settings(RTOLS, RTOLS, steps=(), mujoco_steps=())
AMONG_PEERS = settings(RTOLS, scipy_rtols=(), steps=())
FIT = 60  # evaluations for the two parameters of MuJoCo's contact


def compared(approach: Approach, error: float, tried: Settings, rounds: int) -> pl.DataFrame:
    """Return the fastest setting of each solver that keeps `error` (m/s in V_p), timed in turns, ours first."""
    truth = solve(approach, reference.simulate, rtol=1e-13)
    fit = fitted(approach, truth, FIT) if MUJOCO in dict(tried) else None
    rows = pl.DataFrame(timed(approach, truth, fit, tried, rounds))
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
    rounds, title = 1 if quick else 5, "One whole approach, {}, V_p within {:g} m/s"
    return {
        title.format(approach.name, error): compared(approach, error, tried, rounds)
        for approach, error, tried in ((SCENE, FINE, AMONG_SCIPY), (PEER_SCENE, COARSE, AMONG_PEERS))
    }
