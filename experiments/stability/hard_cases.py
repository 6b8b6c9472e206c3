"""What makes other solvers fall, one cause at a time, beside what ours does there.

onset       across the onset of contact, where the force is not smooth, RK4 at a fixed step is no better than Euler
graze       a test of signs at the ends of steps does not see what touches and parts within one
slow        the damping of a slow contact grows as 1/v_in (paper, eq. 7): explicit steps shrink with it
tolerance   an absolute tolerance in metres is far too coarse for a stiff contact, and floors the error
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import lambertw

import impact_gym as ig
from experiments.speed_vs_error import by_hand
from experiments.speed_vs_error.contenders import OURS
from experiments.speed_vs_error.records import Row
from experiments.speed_vs_error.scenes import Approach
from experiments.stability import plain_ivp
from experiments.stability.plain_ivp import OutOfTimeError

SPEED = 0.5  # m/s
STAGES = 6  # evaluations in an attempted step of RK45
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


def onset(places: int = 9) -> Iterator[Row]:
    """Error of V_p against steps in the contact, each the median over some places of the object."""
    approaches = [isolated(1e4, 0.5, SPEED, 0.05 * (1 + 0.0137 * place)) for place in range(places)]
    first = approaches[0][0]
    contact = ig.simulate(first.scene, first.motion, first.duration).contacts[0]
    lasts = (contact.end or math.nan) - contact.start
    for method in by_hand.METHODS:
        for step in np.geomspace(1e-3, 1e-6, 10):
            errors = [
                abs(by_hand.solve(method, approach, float(step)).velocity - true) for approach, true in approaches
            ]
            yield row("onset", f"{method}, fixed step", lasts / float(step), float(np.median(errors)) / SPEED)
    for rtol in 10.0 ** -np.arange(2, 13):
        found = [ig.simulate(a.scene, a.motion, a.duration, float(rtol)) for a, _ in approaches]
        errors = [abs(outcome.object_velocity - true) for outcome, (_, true) in zip(found, approaches, strict=True)]
        steps = float(np.median([outcome.steps for outcome in found]))
        yield row("onset", OURS, steps, max(float(np.median(errors)) / SPEED, 1e-16))


def swaying(number: int) -> tuple[ig.Scene, ig.Trapezoid]:
    """A tool that sways on a compliant robot, far from the object, with a speed that changes sign."""
    rng = np.random.default_rng([5, number])
    robot = ig.Robot(2.0, float(rng.uniform(1500, 3000)), 0.0)
    coupling = ig.SpringDamper(float(rng.uniform(40, 90)), 0.0)
    return ig.Scene(ig.Tool(0.125), ig.Object(0.25, 10.0), ig.Contact(1e5, 1.0), coupling, robot), ig.Trapezoid(0.3, 40)


def free_tool(scene: ig.Scene, motion: ig.Trapezoid) -> Any:
    """Return the rates of tool and robot, undamped, under the ramp and then the cruise (paper, eq. 8 and 17)."""
    robot: Any = scene.robot
    coupling: Any = scene.coupling
    ramp = motion.speed / motion.acceleration

    def rates(t: float, y: Any) -> list[float]:
        early = min(t, ramp)
        command = motion.acceleration * early * (t - early / 2)
        pull = coupling.stiffness * (y[2] - y[0])
        return [y[1], pull / scene.tool.mass, y[3], (robot.stiffness * (command - y[2]) - pull) / robot.mass]

    return rates


def summit(scene: ig.Scene, motion: ig.Trapezoid) -> tuple[float, float] | None:
    """Return when, and how far out, the tool first turns back, s and m; None if it does not."""
    run = solve_ivp(free_tool(scene, motion), (0, 0.6), [0.0] * 4, "DOP853", rtol=1e-13, atol=1e-16, dense_output=True)
    speed = lambda t: float(run.sol(t)[1])  # noqa: E731
    times = np.linspace(0.01, 0.6, 3000)
    falls = np.flatnonzero((run.sol(times)[1][:-1] > 0) & (run.sol(times)[1][1:] <= 0))
    if not len(falls):
        return None
    when = float(brentq(speed, times[falls[0]], times[falls[0] + 1], xtol=1e-15))
    return when, float(run.sol(when)[0])


def graze(scenes: int = 40) -> Iterator[Row]:
    """Share of touches that are found, against how far the tool passes the face of the object, which stands just so."""
    found: dict[str, list[list[bool]]] = {}
    for number in range(scenes):
        scene, motion = swaying(number)
        top = summit(scene, motion)
        if top is not None:
            for name, saw in _grazes_of(scene, motion, *top):
                found.setdefault(name, []).append(saw)
    for name, saws in found.items():
        for margin, share in zip(MARGINS, np.mean(saws, axis=0).tolist(), strict=True):
            yield row("graze", name, margin, share)


def _grazes_of(scene: ig.Scene, motion: ig.Trapezoid, when: float, far: float) -> Iterator[tuple[str, list[bool]]]:
    """Yield, for each of MARGINS, who sees the touch before the tool is at its summit."""
    saw = []
    for margin in MARGINS:
        target = ig.Object(scene.object.mass, far - margin)
        there = ig.Scene(scene.tool, target, scene.contact, scene.coupling, scene.robot)
        outcome = ig.simulate(there, motion, when + 0.02, 1e-12)
        saw.append(bool(outcome.contacts) and outcome.contacts[0].start <= when)
    yield OURS, saw
    touches = [plain_ivp.event(_passes(far - margin), 1.0, terminal=False) for margin in MARGINS]
    for method in ("RK45", "DOP853", "LSODA", "Radau"):
        # tolerances far below the margins, so that only the search for events is judged
        run = solve_ivp(
            free_tool(scene, motion), (0, when + 0.02), [0.0] * 4, method, events=touches, rtol=1e-10, atol=1e-13
        )
        yield f"{method}, solve_ivp events", [bool(np.any(times <= when)) for times in run.t_events]


def _passes(face: float) -> Callable[[float, Any], float]:
    """Return how far the tool is beyond a face, m."""
    return lambda _, y: float(y[0]) - face


def slow() -> Iterator[Row]:
    """Attempted steps of a push of PUSH s that begins with a touch at v_in; nan where there was no end in PATIENCE."""
    for v_in in 10.0 ** -np.arange(0, 9):
        v, a = float(v_in), 8.0
        scene = ig.Scene(ig.Tool(0.125), ig.Object(0.25, v**2 / (2 * a)), ig.Contact(1e8, 0.1))
        approach = Approach("slow", "", scene, ig.Trapezoid(v + 0.5, a), v / a + PUSH)
        try:
            steps = float(ig.simulate(approach.scene, approach.motion, approach.duration).steps)
        except RuntimeError:
            steps = math.nan
        yield row("slow", OURS, v, steps)
        for method in ("RK45", "Radau"):
            try:
                evaluations = plain_ivp.solve(approach, method, 1e-6, 1e-12, PATIENCE).steps
            except (OutOfTimeError, RuntimeError):
                evaluations = 0
            stages = STAGES if method == "RK45" else 4
            yield row("slow", f"{method}, solve_ivp", v, evaluations / stages or math.nan)


def tolerance() -> Iterator[Row]:
    """Error of V_p against rtol where delta0 is 3e-7 m."""
    approach, true = isolated(1e10, 0.5, 0.01, 0.001)
    for rtol in 10.0 ** -np.arange(3, 13):
        for atol in (1e-6, 1e-9):
            answer = plain_ivp.solve(approach, "RK45", float(rtol), atol, PATIENCE)
            yield row("tolerance", f"RK45, solve_ivp, atol {atol:g}", float(rtol), abs(answer.velocity / true - 1))
        outcome = ig.simulate(approach.scene, approach.motion, approach.duration, float(rtol))
        yield row("tolerance", OURS, float(rtol), max(abs(outcome.object_velocity / true - 1), 1e-16))


def rows() -> list[Row]:
    """Return all points."""
    return [*onset(), *graze(), *slow(), *tolerance()]
