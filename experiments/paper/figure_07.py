"""Fig. 7: duration of the contact against k_c for several e, tool fixed (a) and free (b); no brake."""

import numpy as np
from matplotlib.figure import Figure

from experiments.paper.limit_cases import OBJECT_MASS, RESTITUTIONS, STIFFNESSES, TOOL_MASS, draw, gridded, sweep
from experiments.paper.statements import Statement, claim
from experiments.paper.tables import Table
from impact_gym.physics import impact

TITLE = "Influence of contact stiffness and restitution on the duration of the contact"
ALT = (
    "Two panels, duration of the contact against contact stiffness, both logarithmic: a falling straight line per "
    "restitution; the smaller the restitution, the longer the contact; shorter with the tool free."
)


def compute() -> Table:
    """Simulate the grid."""
    return sweep((float(k), float(e)) for e in RESTITUTIONS for k in STIFFNESSES)


def plot(table: Table) -> Figure:
    """Draw duration against k_c as the paper does."""
    return draw(table, "duration", "duration of the contact (s)")[0]


def statements(table: Table) -> tuple[Statement, ...]:
    """Compare with section 2.2."""
    durations = {free: gridded(table, "duration", free) for free in (0, 1)}
    falling = all(bool((np.diff(d, axis=1) < 0).all()) for d in durations.values())
    longer = all(bool((np.diff(d, axis=0) < 0).all()) for d in durations.values())  # e rises along axis 0
    e = np.array(RESTITUTIONS)
    simulated = gridded(table, "object_velocity", 1)[:, 0]
    instantaneous = impact.free_tool(TOOL_MASS, OBJECT_MASS, 1.0, 0.0, e)[1]
    error = np.abs(simulated / instantaneous - 1.0)
    factor = durations[0] / durations[1]
    return (
        claim(
            "2.2",
            "An increase in k_c leads to a decrease in the impact duration",
            falling,
            "falls at every e, with k_c^(-2/5)",
            "falls from each k_c to the next, at every e, in both cases",
        ),
        claim(
            "2.2",
            "The impact duration increases with the decrease in e",
            longer,
            f"{durations[0][0, 0] / durations[0][-1, 0]:.2f} times as long at e = {e[0]:g} as at e = 1",
            "rises from each e to the next lower one, at every k_c, in both cases",
        ),
        claim(
            "2.2",
            "The contact is shorter with the decoupled tool (panels a and b, and Fig. 5)",
            bool((factor > 1.0).all()),
            f"by a factor {factor.mean():.3f} everywhere",
            "shorter at every e and k_c",
        ),
        claim(
            "2.2",
            "The theory of instantaneous impact gives a good prediction of final velocities in many practical cases",
            bool(error.max() < 0.05),
            f"eq. 4 is off by at most {100 * error.max():.1f} % (at e = {e[np.argmax(error)]:g})",
            "V_p of the simulated free tool within 5 % of eq. 4 at every e",
            why="What is left is not the duration of the contact but eq. 7, which delivers less restitution than it is "
            "given.",
        ),
    )
