"""One whole approach with one contact, by us, by SciPy's solvers and by MuJoCo, each as fast as an error allows."""

from collections.abc import Iterable
from functools import cache
from itertools import islice

from experiments import reference
from experiments.paper.scenes import DURATION, MOTION, decoupled
from experiments.speed_vs_error import peer
from experiments.speed_vs_error.contenders import METHODS, Contender, Grid, mujoco, ours, scipy
from experiments.speed_vs_error.peer_fit import fitted
from experiments.speed_vs_error.quantities import Answer, answer_of
from experiments.speed_vs_error.scenes import Approach

ERROR = 1e-6  # m/s in V_p, at which SciPy's solvers are compared
PEER_ERROR = 1e-3  # m/s, at which MuJoCo is
SCENE = Approach("Fig. 17b", "", decoupled(1e4, 1.0, 150.0), MOTION, DURATION)
PEER_SCENE = Approach("Fig. 19a", "", decoupled(1e5, 0.1, 150.0), MOTION, DURATION)  # near MuJoCo's own law of contact
RTOLS = (1e-2, *Grid().rtols)
FIT = 60  # evaluations for the two parameters of MuJoCo's contact


@cache
def truth(approach: Approach) -> Answer:
    """Return what the independent solver says."""
    return answer_of(reference.simulate(approach.scene, approach.motion, approach.duration, rtol=1e-13), DURATION)


def cheapest(approach: Approach, candidates: Iterable[Contender], allowed: float) -> list[tuple[Contender, float]]:
    """Return the first that is within `allowed` (m/s) of V_p, with its error; nothing if there is none."""
    errors = ((one, abs(one.solve().velocity - truth(approach).velocity)) for one in candidates)
    return list(islice((found for found in errors if found[1] <= allowed), 1))


def contenders() -> dict[str, list[tuple[Contender, float]]]:
    """Return those to compare, by scene, ours first, each with its error in V_p (m/s)."""
    compared = {SCENE.name: cheapest(SCENE, (ours(SCENE, rtol) for rtol in RTOLS), ERROR)}
    for method in METHODS:
        compared[SCENE.name] += cheapest(SCENE, [scipy(method, SCENE, rtol) for rtol in RTOLS], ERROR)
    if peer.missing():
        print(f"experiments.bench: {peer.missing()}; it takes no part")
        return compared
    fit = fitted(PEER_SCENE, truth(PEER_SCENE), FIT)
    theirs = cheapest(PEER_SCENE, (mujoco(PEER_SCENE, fit, step) for step in Grid().mujoco_steps), PEER_ERROR)
    own = cheapest(PEER_SCENE, (ours(PEER_SCENE, rtol) for rtol in RTOLS), PEER_ERROR)
    if own and theirs:
        return compared | {PEER_SCENE.name: own + theirs}
    print(f"experiments.bench: MuJoCo's law, fitted, comes no closer than {PEER_ERROR:g} m/s; it takes no part")
    return compared
