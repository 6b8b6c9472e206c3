"""One whole approach with one contact, by us, by SciPy's solvers and by MuJoCo, each as fast as an error allows."""

from collections.abc import Callable, Iterable

from experiments import reference
from experiments.paper.scenes import DURATION, MOTION, decoupled
from experiments.speed_vs_error import peer
from experiments.speed_vs_error.contenders import METHODS, Contender, Grid, mujoco, ours, scipy
from experiments.speed_vs_error.peer_fit import fitted
from experiments.speed_vs_error.quantities import Answer, answer_of
from experiments.speed_vs_error.scenes import Approach

ERROR = 1e-6  # m/s in V_p, at which SciPy's solvers are compared
PEER_ERROR = 1e-3  # m/s, at which MuJoCo is
SCENE = Approach("Fig. 17b", "", decoupled(stiffness=1e4, restitution=1.0, coupling_stiffness=150.0), MOTION, DURATION)
PEER_SCENE = Approach(  # near MuJoCo's own law of contact
    "Fig. 19a", "", decoupled(stiffness=1e5, restitution=0.1, coupling_stiffness=150.0), MOTION, DURATION
)
RTOLS = (1e-2, *Grid().rtols)
FIT = 60  # evaluations for the two parameters of MuJoCo's contact


def truth(approach: Approach) -> Answer:
    """Return what the independent solver says."""
    return answer_of(reference.simulate(approach.scene, approach.motion, approach.duration, rtol=1e-13), DURATION)


def cheapest(candidates: Iterable[Contender], exact: Answer, allowed: float) -> tuple[Contender, float] | None:
    """Return the first that is within `allowed` (m/s) of V_p, and its error; None if there is none."""
    for contender in candidates:
        error = abs(contender.solve().velocity - exact.velocity)
        if error <= allowed:
            return contender, error
    return None


def contenders() -> dict[str, list[tuple[Contender, float]]]:
    """Return those to compare, by scene, ours first, each with its error in V_p (m/s)."""
    exact = truth(SCENE)
    solvers: list[Callable[[float], Contender]] = [lambda rtol: ours(SCENE, rtol)]
    solvers += [lambda rtol, method=method: scipy(method, SCENE, rtol) for method in METHODS]  # type: ignore[misc]
    found = [cheapest(map(solver, RTOLS), exact, ERROR) for solver in solvers]
    compared = {SCENE.name: [one for one in found if one is not None]}
    if peer.missing():
        print(f"experiments.bench: {peer.missing()}; it takes no part")
        return compared
    exact = truth(PEER_SCENE)
    fit = fitted(PEER_SCENE, exact, FIT)
    theirs = cheapest((mujoco(PEER_SCENE, fit, step) for step in Grid().mujoco_steps), exact, PEER_ERROR)
    own = cheapest((ours(PEER_SCENE, rtol) for rtol in RTOLS), exact, PEER_ERROR)
    if theirs is None or own is None:
        print(f"experiments.bench: MuJoCo's law, fitted, comes no closer than {PEER_ERROR:g} m/s; it takes no part")
    else:
        compared[PEER_SCENE.name] = [own, theirs]
    return compared
