"""One whole approach with one contact, by us, by SciPy's solvers and by MuJoCo, each as fast as an error allows."""

from collections.abc import Iterable
from functools import cache

import numpy as np
import polars as pl
from tqdm import tqdm

from experiments import reference
from experiments.paper.scenes import DURATION, MOTION, decoupled
from experiments.speed_vs_error import peer
from experiments.speed_vs_error.contenders import METHODS, OURS, Contender, Grid, mujoco, ours, scipy
from experiments.speed_vs_error.peer_fit import fitted
from experiments.speed_vs_error.quantities import Answer, answer_of
from experiments.speed_vs_error.scenes import Approach

ERROR = 1e-6  # m/s in V_p, at which SciPy's solvers are compared
PEER_ERROR = 1e-3  # m/s, at which MuJoCo is
SCENE = Approach("Fig. 17b", "", decoupled(1e4, 1.0, 150.0), MOTION, DURATION)
PEER_SCENE = Approach("Fig. 19a", "", decoupled(1e5, 0.1, 150.0), MOTION, DURATION)  # near MuJoCo's own law of contact
RTOLS = (1e-2, *Grid().rtols)
FIT = 60  # evaluations for the two parameters of MuJoCo's contact
Found = list[tuple[str, Contender, float]]  # name of the scene, a solver, its error in V_p in m/s


@cache
def truth(approach: Approach) -> Answer:
    """Return what the independent solver says."""
    return answer_of(reference.simulate(approach.scene, approach.motion, approach.duration, rtol=1e-13), DURATION)


def cheapest(approach: Approach, candidates: Iterable[Contender], allowed: float) -> Found:
    """Return the first that is within `allowed` (m/s) of V_p; nothing if there is none."""
    for one in candidates:
        error = abs(one.solve().velocity - truth(approach).velocity)
        if error <= allowed:
            return [(approach.name, one, error)]
    return []


def contenders() -> Found:
    """Return those to compare, ours first in each scene."""
    compared = cheapest(SCENE, (ours(SCENE, rtol) for rtol in RTOLS), ERROR)
    for method in METHODS:
        compared += cheapest(SCENE, [scipy(method, SCENE, rtol) for rtol in RTOLS], ERROR)
    absent = peer.missing()
    if not absent:
        fit = fitted(PEER_SCENE, truth(PEER_SCENE), FIT)
        own = cheapest(PEER_SCENE, (ours(PEER_SCENE, rtol) for rtol in RTOLS), PEER_ERROR)
        theirs = cheapest(PEER_SCENE, (mujoco(PEER_SCENE, fit, step) for step in Grid().mujoco_steps), PEER_ERROR)
        if own and theirs:
            return compared + own + theirs
        absent = f"MuJoCo's law, fitted, comes no closer than {PEER_ERROR:g} m/s"
    print(f"experiments.bench: {absent}; it takes no part")
    return compared


def measure(quick: bool) -> dict[str, pl.DataFrame]:
    """Return a row for each solver: the best of some rounds in which they take turns, beside ours in the same scene."""
    compared = contenders()
    turns = [
        [1e6 * one.seconds(2000 if one.name == OURS else 5) for _, one, _ in compared]
        for _ in tqdm(range(1 if quick else 5), desc="approaches")
    ]
    rows = [
        (scene, one.name, one.setting, error, best)
        for (scene, one, error), best in zip(compared, np.min(turns, axis=0).tolist(), strict=True)
    ]
    names = ["scene", "solver", "rtol or step, s", "error in V_p, m/s", "microseconds"]
    ratio = pl.col("microseconds") / pl.col("microseconds").first().over("scene")
    return {"One whole approach": pl.DataFrame(rows, names, orient="row").with_columns(ratio.alias("times ours"))}
