"""Fig. 7: duration of the contact against k_c for several e, tool fixed (a) and free (b); no brake."""

import numpy as np

from experiments.paper.figure_06 import CUT, RESTITUTIONS, STIFFNESSES, draw, grid_values, sweep
from experiments.paper.layouts import Panels, panels
from experiments.paper.scenes import OBJECT_MASS, TOOL_MASS
from experiments.paper.statements import Statements, section_2_2
from experiments.paper.tables import Table, where
from impact_gym.physics import impact

TITLE = "Influence of contact stiffness and restitution on the duration of the contact"
ALT = """Two panels, duration of the contact against contact stiffness, both logarithmic: a falling straight line per
restitution; the smaller the restitution, the longer the contact; shorter with the tool free."""
VANISHING = (0.05, 0.02, 0.01, 0.005)  # restitutions below those of the curves


def compute() -> Table:
    """Simulate the grid, and at one k_c what becomes of a restitution that tends to zero."""
    return sweep([(k, e) for e in RESTITUTIONS for k in STIFFNESSES] + [(CUT, e) for e in VANISHING])


@panels(10.0, 4.2, columns=2)
def plot(table: Table, grid: Panels) -> None:
    draw(grid, table, "duration", "duration of the contact (s)")


def statements(table: Table) -> Statements:
    fixed, free = durations = [grid_values(table, "duration", free) for free in (0, 1)]
    e = np.array(RESTITUTIONS)  # along axis 0
    instantaneous = impact.free_tool(TOOL_MASS, OBJECT_MASS, 1.0, 0.0, e)[1]
    error = np.abs(grid_values(table, "object_velocity", 1)[:, 0] / instantaneous - 1.0)
    at_cut = where(table, free=1, contact_stiffness=CUT)
    parting = [where(at_cut, restitution=e)["separation_velocity"][0] for e in VANISHING]
    yield section_2_2.given.claim(
        "An increase in k_c leads to a decrease in the impact duration",
        all((np.diff(duration, axis=1) < 0).all() for duration in durations),
        "falls at every e, with k_c^(-2/5)",
        "falls from each k_c to the next, at every e, in both cases",
    )
    yield section_2_2.claim(
        "The impact duration increases with the decrease in e",
        all((np.diff(duration, axis=0) < 0).all() for duration in durations),
        f"{fixed[0, 0] / fixed[-1, 0]:.2f} times as long at e = {e[0]:g} as at e = 1",
        "rises from each e to the next lower one, at every k_c, in both cases",
    )
    yield section_2_2.claim(
        "If e tends to zero (inelastic impact), the two masses move together after the impact",
        (np.diff(parting) < 0.0).all() and parting[-1] < 0.01,
        f"they part with {parting[0]:.3f} m/s at e = {VANISHING[0]:g} and {parting[-1]:.4f} m/s at {VANISHING[-1]:g}",
        "the speed at which they part falls with e, to less than 1 % of the approach velocity",
    )
    yield section_2_2.repeated.claim(
        "The contact is shorter with the decoupled tool (panels a and b, and Fig. 5)",
        (fixed > free).all(),
        f"by a factor {(fixed / free).mean():.3f} everywhere",
        "shorter at every e and k_c",
    )
    yield section_2_2.claim(
        "The theory of instantaneous impact gives a good prediction of final velocities in many practical cases",
        error.max() < 0.05,
        f"eq. 4 is off by at most {100 * error.max():.1f} % (at e = {e[np.argmax(error)]:g})",
        "V_p of the simulated free tool within 5 % of eq. 4 at every e",
        why="What is left is not the duration of the contact but eq. 7, which delivers less restitution than it is "
        "given.",
    )
