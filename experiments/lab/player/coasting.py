"""What follows a trace that ends first: nothing is touched any more, and the flange rests.

The object keeps its velocity. The tool swings out on what holds it, m_t y'' = the coupling's force (paper, eq. 17 and
23-24 without contact force), integrated here because an episode simulates no longer than its result needs.
"""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from experiments.reference.laws import BistableForce
from impact_gym.scene import Bistable, SpringDamper
from impact_gym.task import Task

STEP = 0.002  # s, between points
TOLERANCE = 1e-9

Columns = dict[str, NDArray[np.float64]]


def coast(columns: Mapping[str, NDArray[np.float64]], end: float, task: Task) -> Columns:
    """Return the time histories with what follows them until `end` (s); a compliant robot stays where it is."""
    last = {name: float(column[-1]) for name, column in columns.items()}
    elapsed = np.linspace(0.0, end - last["time"], 1 + int(np.ceil((end - last["time"]) / STEP)))[1:]
    more = {name: np.full(len(elapsed), value) for name, value in last.items()}
    more["time"] += elapsed
    more["object_position"] += last["object_velocity"] * elapsed
    more["contact_force"][:] = more["flange_velocity"][:] = 0.0
    force = coupling_force(task)
    if force is None:
        more["tool_velocity"][:] = 0.0
    else:
        start = [last["tool_position"] - last["flange_position"], last["tool_velocity"] - last["flange_velocity"]]
        times = {"t_span": (0.0, elapsed[-1]), "t_eval": elapsed}
        tight = {"method": "LSODA", "rtol": TOLERANCE, "atol": TOLERANCE}
        swing = solve_ivp(lambda _, y: [y[1], force(*y) / task.tool_mass], y0=start, **times, **tight).y
        more["tool_position"] = more["flange_position"] + swing[0]
        more["tool_velocity"] = swing[1]
    return {name: np.concatenate([column, more[name]]) for name, column in columns.items()}


def coupling_force(task: Task) -> Callable[[float, float], float] | None:
    """Return the coupling's force on the tool, N, of its deflection (m) and that one's rate (m/s); None if rigid."""
    coupling = task.coupling
    if isinstance(coupling, SpringDamper):
        k, c = coupling.stiffness, 2.0 * coupling.damping_ratio * np.sqrt(coupling.stiffness * task.tool_mass)
        return lambda y, y_dot: -k * y - c * y_dot
    if not isinstance(coupling, Bistable):
        return None
    law = BistableForce(coupling, task.tool_mass)  # of the flange's way ahead of the tool

    def force(y: float, y_dot: float) -> float:
        pushes = {"front": law.front(-y, -y_dot) > 0.0, "rear": law.rear(-y, -y_dot) > 0.0}
        return law.force(-y, -y_dot, pushes)

    return force
