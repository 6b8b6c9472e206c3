"""What makes other solvers fall, one cause at a time, beside what ours does there.

onset       across the onset of contact, where the force is not smooth, RK4 at a fixed step is no better than Euler
graze       a test of signs at the ends of steps does not see what touches and parts within one
slow        the damping of a slow contact grows as 1/v_in (paper, eq. 7): explicit steps shrink with it
tolerance   an absolute tolerance in metres is far too coarse for a stiff contact, and floors the error
"""

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import lambertw

import impact_gym as ig
from agents.jobs import Result
from experiments.lab.tables import Gather, Row, result_of, solver_and
from experiments.speed_vs_error import by_hand
from experiments.speed_vs_error.contenders import OURS
from experiments.speed_vs_error.scenes import Approach
from experiments.stability import rivals
from experiments.stability.scenes import velocity

SPEED = 0.5  # m/s
STAGES = {"RK45": 6, "Radau": 4}  # evaluations in an attempted step
PUSH = 0.1  # s
PATIENCE = 20.0  # s of processor time for a slow contact
MARGINS = tuple(float(f"1e-{k}") for k in range(3, 11))  # m, by which the tool passes the face of the object


def row(panel: str, contender: str, x: float, y: float) -> Row:
    """A point of a figure."""
    return {"scene": panel, "contender": contender, "x": x, "y": y}


def isolated(k_c: float, e: float, speed: float, distance: float) -> tuple[Approach, float]:
    """Return a tool at constant `speed` that strikes, and V_p in closed form: v (1 + e_eff), by Lambert's W."""
    d = 1.5 * (1 - e) / e
    e_eff = (1 + float(lambertw(-(1 + d) * math.exp(-(1 + d))).real)) / d
    scene = ig.Scene(ig.Tool(1.0), ig.Object(0.25, distance), ig.Contact(k_c, e))
    motion = ig.Trapezoid(speed, 100 * speed)
    return Approach("isolated", "", scene, motion, distance / speed + 0.1), speed * (1 + e_eff)


def onset(places: int) -> Iterator[Row]:
    """Error of V_p against steps in the contact, each the median over some places of the object."""
    approaches = [isolated(1e4, 0.5, SPEED, 0.05 * (1 + 0.0137 * place)) for place in range(places)]
    lasts = approaches[0][0].solved().contact_duration
    for method in by_hand.METHODS:
        for step in np.geomspace(1e-3, 1e-6, 10).tolist():
            error = median(abs(by_hand.solve(method, a, step).velocity - true) for a, true in approaches)
            yield row("onset", f"{method}, fixed step", lasts / step, error / SPEED)
    for rtol in (10.0 ** -np.arange(2, 13)).tolist():
        found = [(a.solved(rtol=rtol), true) for a, true in approaches]
        error = median(abs(solution.velocity - true) for solution, true in found)
        yield row("onset", OURS, median(solution.steps for solution, _ in found), max(error / SPEED, 1e-16))


def swaying(number: int) -> tuple[ig.Scene, ig.Trapezoid]:
    """A tool that sways on a compliant robot, far from the object, with a speed that changes sign."""
    rng = np.random.default_rng([5, number])
    robot = ig.Robot(2.0, float(rng.uniform(1500, 3000)), 0.0)
    coupling = ig.SpringDamper(float(rng.uniform(40, 90)), 0.0)
    return ig.Scene(ig.Tool(0.125), ig.Object(0.25, 10.0), ig.Contact(1e5, 1.0), coupling, robot), ig.Trapezoid(0.3, 40)


def free_tool(scene: ig.Scene, motion: ig.Trapezoid) -> Any:
    """Return the rates of tool and robot, undamped, under the ramp and then the cruise (paper, eq. 8 and 17)."""
    robot, coupling, ramp = scene.robot, scene.coupling, motion.speed / motion.acceleration

    def rates(t: float, y: Any) -> list[float]:
        early = min(t, ramp)
        command = motion.acceleration * early * (t - early / 2)
        pull = coupling.stiffness * (y[2] - y[0])
        return [y[1], pull / scene.tool.mass, y[3], (robot.stiffness * (command - y[2]) - pull) / robot.mass]

    return rates


def summit(scene: ig.Scene, motion: ig.Trapezoid) -> tuple[float, float] | None:
    """Return when, and how far out, the tool first turns back, s and m; None if it does not."""
    turn = rivals.event(lambda _, y: y[1], -1.0)
    run = solve_ivp(free_tool(scene, motion), (0, 0.6), [0.0] * 4, "DOP853", events=turn, rtol=1e-13, atol=1e-16)
    return (float(run.t_events[0][0]), float(run.y_events[0][0, 0])) if run.status else None


def graze(scenes: int) -> Iterator[Row]:
    """Share of touches that are found, against how far the tool passes the face of the object, which stands just so."""
    tops = [(scene, motion, summit(scene, motion)) for scene, motion in map(swaying, range(scenes))]
    seen = [seen_by(scene, motion, *top) for scene, motion, top in tops if top is not None]
    for name in seen[0]:
        for margin, share in zip(MARGINS, np.mean([saw[name] for saw in seen], axis=0).tolist(), strict=True):
            yield row("graze", name, margin, share)


def seen_by(scene: ig.Scene, motion: ig.Trapezoid, when: float, far: float) -> dict[str, list[bool]]:
    """Return, for each of MARGINS, whether the touch is seen before the tool is at its summit, by who looks for it."""
    rates, end = free_tool(scene, motion), when + 0.02

    def ours(margin: float) -> bool:
        there = replace(scene, object=ig.Object(scene.object.mass, far - margin))
        contacts = ig.simulate(there, motion, end, 1e-12).contacts
        return bool(contacts) and contacts[0].start <= when

    seen = {OURS: [ours(margin) for margin in MARGINS]}
    touches = [rivals.event(lambda _, y, face=far - margin: y[0] - face, 1.0, terminal=False) for margin in MARGINS]
    for method in ("RK45", "DOP853", "LSODA", "Radau"):
        # tolerances far below the margins, so that only the search for events is judged
        run = solve_ivp(rates, (0, end), [0.0] * 4, method, events=touches, rtol=1e-10, atol=1e-13)
        seen[f"{method}, solve_ivp events"] = [bool(np.any(times <= when)) for times in run.t_events]
    return seen


def attempts(approach: Approach, method: str) -> float:
    """Return the attempted steps of ours or of solve_ivp; nan where there was no end in PATIENCE."""
    with suppress(TimeoutError, RuntimeError), rivals.limited(PATIENCE):
        if method == OURS:
            return approach.solved().steps
        return rivals.plain(approach, method, 1e-6, 1e-12).steps / STAGES[method]
    return math.nan


def slow(slowest: int) -> Iterator[Row]:
    """Attempted steps of a push of PUSH s that begins with a touch at v_in, from 1 m/s down to 10^-slowest."""
    for v in (10.0 ** -np.arange(0, slowest + 1)).tolist():
        a = 8.0
        scene = ig.Scene(ig.Tool(0.125), ig.Object(0.25, v**2 / (2 * a)), ig.Contact(1e8, 0.1))
        approach = Approach("slow", "", scene, ig.Trapezoid(v + 0.5, a), v / a + PUSH)
        for method in (OURS, *STAGES):
            name = OURS if method == OURS else f"{method}, solve_ivp"
            yield row("slow", name, v, attempts(approach, method))


def tolerance(finest: int) -> Iterator[Row]:
    """Error of V_p against rtol down to 10^-finest where delta0 is 3e-7 m."""
    approach, true = isolated(1e10, 0.5, 0.01, 0.001)
    for rtol in (10.0 ** -np.arange(3, finest + 1)).tolist():
        for atol in (1e-6, 1e-9):
            solution = rivals.plain(approach, "RK45", rtol, atol)
            yield row("tolerance", f"RK45, solve_ivp, atol {atol:g}", rtol, abs(solution.velocity / true - 1))
        yield row("tolerance", OURS, rtol, max(abs(velocity(approach, rtol) / true - 1), 1e-16))


CAUSES = {cause.__name__: cause for cause in (onset, graze, slow, tolerance)}
SIZES = {"onset": (9, 1), "graze": (40, 1), "slow": (8, 3), "tolerance": (12, 12)}  # all, and a few


def points(cause: str, size: int) -> Result:
    """Return the points of one cause."""
    return result_of(list(CAUSES[cause](size)))


def rows(gather: Gather, quick: bool) -> list[Row]:
    """Return all points, or a few for each cause if it has to be `quick`."""
    by_hand.compile_now()
    depends = solver_and("experiments.stability.scenes", "experiments.stability.rivals", by_hand.__name__, __name__)
    asked = [{"cause": cause, "size": size[quick]} for cause, size in SIZES.items()]
    return gather("hard_cases", points, asked, depends)
